"""Searches of spaces whose truth is known: `tests/proofs/search.py` in short."""

import sys
from pathlib import Path

import numpy as np
import pytest
from table import each_row

PROOFS = Path(__file__).parents[1] / "proofs"


@pytest.fixture(scope="module")
def proof():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(PROOFS)
        patch.delitem(sys.modules, "search", raising=False)
        import search

        yield search


@each_row(("strategy", "library"), [("optuna", "optuna"), ("qd", "ribs")])
def test_driven_strategy_finds_a_narrow_pocket_with_a_third_of_randoms_runs(proof, strategy, library):
    pytest.importorskip(library)
    runs = {
        name: np.median([proof.runs_to_confirmed(name, seed, proof.NARROW, sloped=True) for seed in range(7)])
        for name in ("random", strategy)
    }
    assert runs["random"] >= proof.FASTER * runs[strategy]


def test_boundary_needs_a_fifth_of_a_grids_runs(proof):
    assert proof.boundary(1)
