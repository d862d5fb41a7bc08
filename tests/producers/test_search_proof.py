"""Searches of spaces whose truth is known: `docs/studies/search.py` in short."""

import numpy as np
import pytest
import search as proof
from table import each_row


@each_row(("strategy", "library"), [("optuna", "optuna"), ("qd", "ribs")])
def test_driven_strategy_finds_a_narrow_pocket_with_a_third_of_randoms_runs(strategy, library):
    pytest.importorskip(library)
    runs = {
        name: np.median([proof.runs_to_confirmed(name, seed, proof.NARROW, sloped=True) for seed in range(7)])
        for name in ("random", strategy)
    }
    assert runs["random"] >= proof.FASTER * runs[strategy]


def test_boundary_needs_a_fifth_of_a_grids_runs():
    assert proof.boundary(1)
