"""Minimization: the smallest failing scenario, and the candidates tried to find it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from table import each_row

from vastflow.producers.campaign_file.document import read_document
from vastflow.producers.campaign_file.scenario import FROM_GOAL, abstract_scenario_of
from vastflow.producers.minimization.circumstance import LEVELS, Circumstance, Subject
from vastflow.producers.minimization.minimize import (
    Candidate,
    Candidates,
    NotBuilt,
    Outcome,
    Unconfirmed,
    ddmin,
    least_level,
    minimize,
)
from vastflow.producers.places.start_check import StartCheck
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.world.world import map_content

FAILS, PASSES = Outcome("fails", 7, 7), Outcome("does not fail", 0, 10)


def thing(name, default=None):
    return Circumstance("parameter", name, None, name, default)


@given(st.integers(0, 20).flatmap(lambda n: st.tuples(st.just(n), st.sets(st.integers(0, max(n - 1, 0))))))
def test_minimization_keeps_jointly_failing_circumstances(drawn):
    n, planted = drawn
    planted = {each for each in planted if each < n}
    assert set(ddmin(range(n), lambda kept: planted <= set(kept))) == planted


@given(st.lists(st.sets(st.integers(0, 9), min_size=1), min_size=1, max_size=4))
def test_result_of_ddmin_is_minimal(reasons):
    def fails(kept):
        return any(reason <= set(kept) for reason in reasons)

    left = ddmin(range(10), fails)
    assert fails(left)
    assert not any(fails([other for other in left if other != each]) for each in left)


@each_row("least", range(1, LEVELS + 1))
def test_least_level_that_fails_is_found(least):
    assert least_level(lambda level: level >= least) == least


def test_kept_value_moves_toward_default_while_failing():
    noise, other = thing("noise", 0.0), thing("other", 0.0)

    def judge(candidate):
        return FAILS if noise in candidate.kept and dict(candidate.levels).get(noise, LEVELS) >= 3 else PASSES

    found = minimize((noise, other), judge, judge)
    assert found.candidate == Candidate(frozenset([noise]), frozenset([(noise, 3)]))
    assert (list(found.cause), found.not_tried) == ([noise], {})
    assert found.tried.keys() >= {Candidate(frozenset()), found.candidate}


def test_untried_circumstance_remains_and_is_no_cause():
    a, b = thing("a"), thing("b")
    untried = Outcome("not tried", reason="it can't be built")

    def judge(candidate):
        return FAILS if {a, b} <= candidate.kept else PASSES if b in candidate.kept else untried

    found = minimize((a, b), judge, judge)
    assert (found.cause, found.not_tried) == ({a: PASSES}, {b: untried})


def test_minimum_that_fresh_runs_do_not_confirm_is_passed_over():
    things = tuple(map(thing, "abc"))

    asked = []

    def judge(candidate):  # as if a trial had been wrong once
        asked.append(candidate)
        return FAILS if things[0] in candidate.kept else PASSES

    found = minimize(things, judge, lambda candidate: FAILS if things[1] in candidate.kept else PASSES)
    assert len(set(asked)) == len(asked)
    assert found.candidate.kept == {things[0], things[1]}


def test_unconfirmed_failure_is_reported():
    found = minimize((thing("a"),), lambda candidate: FAILS, lambda candidate: Outcome("undecided", 3, 20))
    assert isinstance(found, Unconfirmed)
    assert found.text == "failed 7 of 7 runs, and only 3 of 20 fresh ones"


DIMENSIONS = {"world": "environment", "boxes": "environment", "goal_poses": "task"}


def subject(tmp_path, **more):
    cells = np.full((40, 100), 254, dtype=np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 0
    Image.fromarray(cells).save(tmp_path / "hall.pgm")
    (tmp_path / "hall.yaml").write_text("{image: hall.pgm, resolution: 0.1, origin: [0, 0, 0]}\n")
    task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 9.0, "y": 2.0}}
    tags = {key: "environment" if key.startswith("spawn_") else DIMENSIONS.get(key, "system") for key in more}
    tags = {"map_file": "environment", "start_pose": "task", "goal_pose": "task", **tags}
    return Subject({"map_file": map_content(tmp_path / "hall.yaml"), **task, **more}, tags)


def named(subject, *beginnings):
    return {each for each in subject.circumstances if each.text.startswith(beginnings)}


def box(name, x, y):
    return {"entity_name": name, "model": "box", "spawn_pose": {"x": x, "y": y}}


A, B, C = (box(name, x, 3) for name, x in (("a", 3), ("b", 5), ("c", 7)))
GOALS = [{"x": x, "y": 1} for x in (2, 4, 6)]
TRIGGER = {"spawn_trigger_point": {"x": 5, "y": 3}, "spawn_trigger_threshold": 1.0}
WORLD = {"seed": 4, "wall_offset": 0.2}


@each_row(
    ("values", "kept", "left"),
    [
        ({"boxes": [A, B, C]}, ("obstacle a", "obstacle c"), {"boxes": [A, C]}),
        ({"boxes": [A, B, C]}, (), {"boxes": []}),
        ({"boxes": [A, B], **TRIGGER}, ("obstacle b",), {"boxes": [B], **TRIGGER}),
        ({"boxes": [A, B], **TRIGGER}, ("obstacle a",), {"boxes": [A]}),
        ({"world": {**WORLD, "missing_furniture": 0.5}}, ("moved walls",), {"world": WORLD}),
        ({"world": {**WORLD, "missing_furniture": 0.5}}, (), {}),
        ({"goal_poses": GOALS}, ("waypoint 2",), {"goal_poses": GOALS[1:]}),
        ({"goal_poses": GOALS}, (), {"goal_poses": GOALS[2:]}),
    ],
)
def test_circumstances_are_left_out_one_by_one(tmp_path, values, kept, left):
    it = subject(tmp_path, **values)
    reduced = it.reduced(named(it, *kept) if kept else (), {})
    assert {key: value for key, value in reduced.items() if key in {**DIMENSIONS, **TRIGGER}} == left


def test_minimization_removes_parameters_and_moves_numbers_to_defaults(tmp_path):
    it = subject(tmp_path, laserscan_gaussian_noise_std_deviation=0.4, robot_radius=0.3, note="text")
    (noise,) = named(it, "laserscan")
    assert it.reduced([noise], {noise: 2}) == {**subject(tmp_path).values, noise.key: 0.1}
    assert {each.text: each.default for each in it.circumstances if each.kind == "parameter"} == {
        "laserscan_gaussian_noise_std_deviation 0.4": 0.0,
        "robot_radius 0.3": 0.22,
        "note text": None,
    }


def test_path_gets_shorter_from_both_ends(tmp_path):
    it = subject(tmp_path)
    end, beginning = (each for each in it.circumstances if each.kind == "path")
    left = it.reduced((), {end: 4, beginning: 4})
    assert left["goal_pose"]["position"]["x"] == pytest.approx(5.0, abs=0.2)
    assert left["start_pose"]["position"]["x"] == pytest.approx(3.0, abs=0.2)
    assert left["start_pose"]["orientation"]["yaw"] == pytest.approx(0.0)


def test_shorter_path_does_not_end_in_an_obstacle(tmp_path):
    it = subject(tmp_path, boxes=[box("a", 5.0, 2.0)])
    (end, _) = (each for each in it.circumstances if each.kind == "path")
    with pytest.raises(ValueError, match=r"begin or end at \(5\.05, 2\.05\), where a stands"):
        it.reduced(named(it, "obstacle"), {end: 4})


def candidates(it, **more):
    parts = {"environment": {}, "task": {}, "system": {}}
    for key, value in it.values.items():
        parts[it.dimensions[key]][key] = value
    whole = Scenario("builtin:navigate_to_pose", 20.0, **parts)
    return Candidates(it, whole, **{"abstract": FROM_GOAL, "start_check": StartCheck("own", {}), **more})


def test_candidate_is_scenario_of_remaining_circumstances(tmp_path):
    it = subject(tmp_path, boxes=[box("a", 3, 3), box("b", 5, 3)], robot_radius=0.3)
    made = candidates(it).scenario(Candidate(frozenset(named(it, "obstacle b"))))
    assert (made.abstract, made.timeout_s, made.system) == ("builtin:navigate_to_pose", 20.0, {})
    assert made.environment == {"map_file": it.values["map_file"], "boxes": [box("b", 5, 3)]}
    assert made.task == {key: it.values[key] for key in ("start_pose", "goal_pose")}


@each_row(
    ("values", "message"),
    [
        ({"robot_radius": 3.0}, r"does not fit at start_pose \(1, 2\)"),
        ({"boxes": [box("a", 1.1, 2.0)]}, r"does not fit at start_pose \(1, 2\).*into a"),
        ({"boxes": [{**box("a", 5.0, 3.0), "xacro_arguments": "width:=wide"}]}, "width"),
        ({"robot_radius": "wide"}, "wide"),
        ({"global_costmap.global_costmap.plugins": ["static_layer", "unheard_of"]}, "unheard_of"),
    ],
)
def test_candidate_with_conflicting_values_is_skipped(tmp_path, values, message):
    it = subject(tmp_path, **values)
    whole = Candidate(frozenset(each for each in it.circumstances if each.can_be_left_out))
    with pytest.raises(NotBuilt, match=message):
        candidates(it).scenario(whole)
    candidates(it).scenario(Candidate(frozenset()))


def test_candidate_has_parameters_of_scenario_file(tmp_path):
    osc = "import osc.standard\nscenario own:\n    speed: float\n    do serial:\n        wait elapsed(1s)\n"
    (tmp_path / "own.osc").write_text(osc)
    (tmp_path / "x.vast").write_text("execution: {scenario_file: own.osc}\n")
    abstract, _ = abstract_scenario_of(read_document(tmp_path / "x.vast"), tmp_path)
    it = subject(tmp_path, speed=0.5)
    with pytest.raises(NotBuilt, match="The scenario needs speed"):
        candidates(it, abstract=abstract).scenario(Candidate(frozenset()))
    assert candidates(it, abstract=abstract).scenario(Candidate(frozenset(named(it, "speed")))).system == {"speed": 0.5}
