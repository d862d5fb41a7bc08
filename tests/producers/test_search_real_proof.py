"""Searches of real spaces: `docs/studies/search_real.py` in short."""

import pytest
import search_real

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def proof(one_server, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch, one_server(tmp_path_factory.mktemp("search-real") / "prefect"):
        sizes = {"PER_BATCH": 2, "RUNS": 1, "CONFIRMING_RUNS": 1, "CONFIRMING_FAILURES": 1, "NOISES": 3}
        sizes |= {"PASSAGES": 3, "GRID_RUNS": 1, "BOUNDARY_BATCH": 2, "BOUNDARY_RUNS": 1}
        for name, value in sizes.items():
            patch.setattr(search_real, name, value)
        yield search_real


@pytest.fixture(scope="module")
def place(proof, tmp_path_factory):
    folder = tmp_path_factory.mktemp("search-real")
    return proof.Place(folder, folder / "store", workers=1)


def test_passable_door_uses_all_runs(proof, place, monkeypatch):
    monkeypatch.setitem(proof.SPACES, "door", ({"x": (1.5, 1.6), "y": (0.6, 0.7)}, proof.SPACES["door"][1]))
    assert proof.runs_to_confirmed(place, "door", "random", 0, batches=1) == 2


def test_box_that_blocks_the_door_is_found_at_once_and_confirmed(proof, place, monkeypatch):
    monkeypatch.setitem(proof.SPACES, "door", ({"x": (2.6, 2.65), "y": (2.45, 2.5)}, proof.SPACES["door"][1]))
    assert proof.runs_to_confirmed(place, "door", "random", 0, batches=2) == 1 + 1


def test_grid_and_search_prefer_a_wide_passage(proof, place):
    rates = proof.grid_rates(place)
    assert rates.shape == (3, 3) and rates[:, 0].mean() > rates[:, -1].mean()
    expected = proof.searched_rates(place, 0, runs=2)
    assert expected.shape[0] == expected.shape[1] > 3
