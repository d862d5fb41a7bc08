"""Controllers and planner beside the answers of Nav2's own code: `tests/proofs/nav2_conformance.py`, part by part.

Each test has the answers that the checkout keeps, and the whole set where it is present.
"""

import shutil

import nav2_conformance
import numpy as np
import pytest
from nav2_conformance import BESIDE, DRAWN, VARIABLE


@pytest.fixture(scope="module", params=["kept", "whole"])
def answers(request):
    """The folder with Nav2's answers."""
    if request.param == "kept":
        return DRAWN
    place = nav2_conformance.folder()
    if place == DRAWN:
        pytest.skip(
            f"the whole set of Nav2's answers is neither in ${VARIABLE} nor in {BESIDE}; the kept one is tested"
        )
    return place


def too_great(distances):
    """Rows of the distances that are greater than they may be, or no number; there are some distances."""
    found = list(distances)
    assert found and all(each.cases > 0 for each in found)
    return [each.row for each in found if not each.found <= each.most]


def test_distance_beyond_its_bound_is_too_great():
    distances = [nav2_conformance.Distance("DWB", 29, "other commands", found, 0) for found in (0, 1, float("nan"))]
    assert too_great(distances) == [each.row for each in distances[1:]]


def test_mppi_matches_nav2_with_equal_noise(answers):
    assert too_great(nav2_conformance.of_mppi(answers)) == []


@pytest.mark.slow
def test_dwb_cuts_scores_and_commands_as_nav2_does(answers):
    assert too_great(nav2_conformance.of_dwb(answers)) == []


def test_rpp_cuts_and_commands_as_nav2_does(answers):
    assert too_great(nav2_conformance.of_rpp(answers)) == []


def test_navfn_matches_nav2_potential_and_path(answers):
    assert too_great(nav2_conformance.of_navfn(answers)) == []


def test_kept_answers_are_found_where_there_is_no_whole_set(monkeypatch, tmp_path):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(nav2_conformance, "BESIDE", tmp_path / "nowhere")
    assert nav2_conformance.folder() == DRAWN
    assert sum(file.stat().st_size for file in DRAWN.iterdir()) <= 300_000


def test_missing_answers_are_an_error_that_names_their_source(monkeypatch, tmp_path, capsys):
    shutil.copytree(DRAWN, tmp_path / "answers")
    (tmp_path / "answers" / "rpp.npz").unlink()
    monkeypatch.setenv(VARIABLE, str(tmp_path / "answers"))
    assert nav2_conformance.main() == 2
    told = capsys.readouterr().err
    assert "rpp.npz: expected recorded answers" in told and str(DRAWN) in told and VARIABLE in told


def test_missing_map_is_an_error_that_names_its_case(monkeypatch, tmp_path):
    monkeypatch.setattr(nav2_conformance, "BESIDE", tmp_path / "shared" / "reference" / "answers")
    with np.load(DRAWN / "navfn.npz") as kept:
        cases = {name: kept[name] for name in kept.files if not name.endswith("/cells")}
    numbers = {name.partition("/")[0] for name in cases}
    np.savez(tmp_path / "navfn.npz", **cases, **{f"{number}/map": "maps/lost.pgm" for number in numbers})
    with pytest.raises(nav2_conformance.MissingAnswersError, match=r"maps/lost.pgm: expected a map in a folder above"):
        list(nav2_conformance.of_navfn(tmp_path))
