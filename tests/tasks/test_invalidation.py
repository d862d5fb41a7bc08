"""Recomputation after an edit: some rows of the table of `tests/proofs/invalidation.py`."""

from pathlib import Path

import invalidation as proof
import pytest

import vastflow

CHOSEN = frozenset(
    {
        "campaign: an oracle is gone",
        "campaign: an oracle is added",
        "campaign: oracles in another order",
        "helper: a comment",
        "helper: a constant",
        "vastflow: code of the judging",
        "meanwhile: oracle: code",
    }
)


def test_edit_of_vastflow_finds_its_text():
    tables = [proof.MUST_NOT.values(), *([edit for edit, _ in table.values()] for table in (proof.MUST, proof.ROBOT))]
    swaps = [edit for table in tables for edit in table if isinstance(edit, proof.swap)]
    own = [edit for edit in swaps if edit.name.startswith("vastflow/")]
    source = Path(vastflow.__path__[0])
    assert len(own) >= 5
    assert [edit for edit in own if edit.old not in (source / edit.name.removeprefix("vastflow/")).read_text()] == []


@pytest.mark.slow
def test_edit_recomputes_only_what_it_reaches(tmp_path):
    rows = list(proof.rows(tmp_path, CHOSEN.__contains__))
    assert len(rows) == 1 + len(CHOSEN)
    assert [(edit, wrong) for edit, _, wrong in rows if wrong] == []
