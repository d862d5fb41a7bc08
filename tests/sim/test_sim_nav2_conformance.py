"""Controllers and planner beside the answers of Nav2's own code: `tests/proofs/nav2_conformance.py`, part by part.

The answers are not part of vastflow: without them these tests are skipped, and nothing else stands in for them.
"""

import nav2_conformance
import pytest


@pytest.fixture(scope="module")
def answers():
    """The folder with Nav2's answers."""
    place = nav2_conformance.folder()
    if place is None:
        pytest.skip(f"Nav2's answers are neither in ${nav2_conformance.VARIABLE} nor in {nav2_conformance.BESIDE}")
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
