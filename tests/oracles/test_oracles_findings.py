"""What is found of a synthetic campaign directory."""

import json

import pytest

from vastflow.oracles.evidence.findings import findings_json, findings_of, shape_of, stopping_rule
from vastflow.oracles.evidence.varied import named
from vastflow.oracles.results.tables import read_tables

TASK = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
WAY = [(1.0 + 0.1 * i, 2.0) for i in range(41)]


@pytest.fixture
def found(synthetic_campaign, tmp_path, build):
    """Twelve configurations of two families with the same keys, where noise does harm; and one family with others."""
    room = build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))

    def add(name, family, factors, failed):
        runs = [build.a_recording(WAY, run_index=i, outcome="aborted" if i < failed else "succeeded") for i in range(4)]
        synthetic_campaign.add(name, family, room, TASK, recordings=runs, factors=factors)

    for k in range(12):
        family = ("east", "west")[k % 2]
        add(f"{family}-{k}", family, {"noise": (0.0, 0.4)[k // 2 % 2]}, 4 * (k // 2 % 2))
    for k in range(2):
        add(f"other-{k}", "other", {"boxes": k}, k)
    return findings_of(read_tables(synthetic_campaign.write()))


def test_families_in_which_the_same_varies_are_compared_with_each_other_and_no_others(found):
    assert [design.families for design in found.designs] == [("east", "west"), ("other",)]
    names = {factor.name for factor in found.designs[0].analysis.factors}
    assert names == {"family", "noise"}


def test_factor_that_does_harm_comes_first(found):
    noise = found.designs[0].analysis.factors[0]
    assert (noise.name, noise.highest, noise.lowest, noise.difference) == ("noise", "0.4", "0.0", 1.0)


def test_configurations_that_always_and_never_and_sometimes_fail_are_counted(found):
    assert shape_of(found) == {"always": 7, "never": 6, "mixed": 1}
    assert (found.total_failures.failures, found.total_failures.of_failures) == (24, 25)


def test_requested_length_of_the_path_is_a_factor_and_a_drawn_one_is_not(synthetic_campaign, tmp_path, build):
    room = build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))
    for k in range(24):
        task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 1.0 + 0.1 * k}}
        failed = k // 6  # of four runs, and longer by 5 m each time
        runs = [build.a_recording(WAY, run_index=i, outcome="aborted" if i < failed else "succeeded") for i in range(4)]
        asked = 5.0 * (1 + k // 6)
        noted = {"_path_length": asked + 0.01 * (k % 6), "_requested_goal_pose": {"path_length": asked}}
        synthetic_campaign.add(f"way-{k}", "way", room, task, recordings=runs, provenance=noted, factors=task)
    (design,) = findings_of(read_tables(synthetic_campaign.write())).designs
    (factor,) = design.analysis.factors
    assert (factor.name, factor.these.p_value, factor.others.shown) == ("path_length", None, True)
    assert [level.level for level in factor.levels] == ["5.0", "10.0", "15.0", "20.0"]
    assert factor.trend is not None
    assert factor.trend.change == pytest.approx(0.75, abs=1e-3)


def test_runs_beyond_the_least_number_of_a_stopping_rule_are_in_no_contrast(synthetic_campaign, tmp_path, build):
    room = build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))
    for radius, runs, failed in ((0.2, 4, 0), (0.4, 12, 3)):
        outcomes = ["aborted" if i < failed else "succeeded" for i in range(runs)]
        recordings = [build.a_recording(WAY, run_index=i, outcome=outcome) for i, outcome in enumerate(outcomes)]
        given = {"robot_radius": radius}
        synthetic_campaign.add(f"r-{radius}", "r", room, TASK, recordings=recordings, factors=given, system=given)
    synthetic_campaign.metadata["sequential"] = {"min": 4, "max": 12}
    (design,) = findings_of(read_tables(synthetic_campaign.write())).designs
    assert [(level.failed, level.runs) for level in design.analysis.factors[0].levels] == [(0, 4), (3, 4)]


def test_findings_are_json(found):
    said = json.loads(json.dumps(findings_json(found), allow_nan=False))
    assert set(said) == {"classes", "total_failures", "dispersion", "factors", "weighted", "saved"}
    assert (said["weighted"], said["saved"]) == (None, None)


def test_fixed_number_of_runs_has_no_stopping_rule():
    assert stopping_rule({}) is None


def test_stopping_rule_is_read_with_what_the_campaign_says_of_it():
    rule = stopping_rule({"sequential": {"min": 4, "max": 30, "reliable": 0.9}})
    assert (rule.min_runs, rule.max_runs, rule.bounds.reliable, rule.bounds.systematic) == (4, 30, 0.9, 0.2)


def test_file_is_called_by_its_name_where_there_is_one():
    assert named({"file": "abcdef0123"}, {"abcdef0123": "office"}) == "office"
    assert named({"file": "abcdef0123"}, {}) == "abcdef01"
    assert named(0.4, {}) == 0.4
