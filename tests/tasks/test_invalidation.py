"""Recomputation after an edit: some rows of the table of `tests/proofs/invalidation.py`."""

import invalidation as proof
import pytest

pytestmark = pytest.mark.slow

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


def test_edit_recomputes_only_what_it_reaches(tmp_path):
    rows = list(proof.rows(tmp_path, CHOSEN.__contains__))
    assert len(rows) == 1 + len(CHOSEN)
    assert [(edit, wrong) for edit, _, wrong in rows if wrong] == []
