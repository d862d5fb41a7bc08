"""A body that meets the robot on its path, at a time and an angle."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.producers.catalog.crossing import CrossingVariation, free_m
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.conformance import check_producer
from vastflow.producers.model.producer import evaluate
from vastflow.producers.places.ground import ground_of
from vastflow.sim.reading.movers import movers_of

HALL = ["#" * 34, *["#" + "." * 32 + "#"] * 12, "#" * 34]
"""16 × 6 m, its free ground from (-0.5, -1.5) m on."""
STOPS = {"start_pose": {"x": 2.0, "y": 1.5}, "goal_pose": {"x": 12.0, "y": 1.5}}


@pytest.fixture(scope="module")
def inputs(drawn_map):
    return {"map_file": drawn_map(*HALL, cells=10), **STOPS}


def crossing(**parameters):
    return CrossingVariation(CrossingVariation.Parameters.model_validate({"encounter_s": 10.0, **parameters}))


def rule_of(item):
    (body,) = movers_of(item.values)
    return body.rule


def test_crossing_variation_keeps_the_contract(inputs, drawn_map):
    check_producer(
        crossing(encounter_s=[6.0, 10.0, 99.0], angle_deg=[0, 90], speed=[0.5, 2.0], late_s=[-1, 1]),
        [inputs, {**inputs, "start_pose": {"x": 2.0, "y": 0.5}}],
    )


@given(
    encounter_s=st.floats(7.0, 16.0),
    angle_deg=st.floats(-180.0, 180.0),
    speed=st.floats(0.3, 2.0),
    late_s=st.floats(-2.0, 2.0),
)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_body_is_where_the_robot_is_expected_from_the_asked_side(inputs, encounter_s, angle_deg, speed, late_s):
    asked = crossing(
        encounter_s=encounter_s, angle_deg=angle_deg, speed=speed, late_s=late_s, departure_s=1.0, run_up=0.5
    )
    (item,) = evaluate(asked, inputs)
    if isinstance(item, Rejection):
        assert "begins where the robot does" in item.reason  # it comes from behind, and slowly
        return
    rule, there_s = rule_of(item), encounter_s + late_s
    # From (2, 1.5) along x at 0.5 m/s from 1 s on, on the grid's cells.
    assert rule.pose_at(there_s)[:2] == pytest.approx((2.0 + 0.5 * (encounter_s - 1.0), 1.5), abs=0.06)
    before, after = (np.array(rule.pose_at(there_s + dt)) for dt in (-0.2, 0.2))
    if math.dist(before[:2], rule.pose_at(there_s)[:2]) > 0.19 * speed:  # not at a wall
        heading_rad = math.atan2(*(after - before)[1::-1])
        assert math.remainder(heading_rad - math.radians(angle_deg), math.tau) == pytest.approx(0.0, abs=1e-3)
    assert math.dist(rule.waypoints[0], rule.pose_at(there_s)[:2]) >= 0.5 - 1e-6


def test_angle_counts_from_the_direction_of_the_path(inputs):
    upward = {"start_pose": {"x": 7.0, "y": -1.0}, "goal_pose": {"x": 7.0, "y": 4.0}}
    for item in evaluate(crossing(encounter_s=5.0, angle_deg=[60, -90], run_up=0.5), {**inputs, **upward}):
        (x0, y0, _), (x1, y1, _) = (rule_of(item).pose_at(t_s) for t_s in (4.8, 5.2))
        turned_rad = math.remainder(math.atan2(y1 - y0, x1 - x0) - math.pi / 2, math.tau)
        assert math.degrees(turned_rad) == pytest.approx(
            item.values["_requested_movers.crossing"]["angle_deg"], abs=0.1
        )


def test_body_walks_on_free_ground_and_is_not_late_for_lack_of_it(inputs):
    ground = ground_of(inputs["map_file"], 0.5)
    for item in evaluate(crossing(angle_deg=[30, 90, 160, -120], speed=[0.4, 3.0]), inputs):
        rule = rule_of(item)
        for t_s in np.arange(0.0, 40.0, 0.1):
            assert ground.stands(*rule.pose_at(float(t_s))[:2])
        assert rule.start_s >= 0.0


def test_free_ground_ends_a_radius_before_the_wall(inputs):
    ground = ground_of(inputs["map_file"], 0.5)
    assert free_m(ground, (7.0, 1.5), (0.0, 1.0)) == pytest.approx(4.5 - 1.5 - 0.25, abs=0.08)
    assert free_m(ground, (7.0, 4.4), (0.0, 1.0)) == 0.0


@each_row(
    ("change", "asked", "reason"),
    [
        ({}, {"encounter_s": 40.0}, r"the robot is 20.00 m along its path at 40 s, and the path is 10.00 m long"),
        ({}, {"departure_s": 10.0}, r"the robot is 0.00 m along its path"),
        ({}, {"speed": 0.1}, r"at 10 s and 90 degrees the body has 1.00 m to the robot's path, and run_up is 1.5 m"),
        ({}, {"angle_deg": 0, "speed": 0.5}, r"at 10 s, 0 degrees, 0.5 m/s the body begins where the robot does"),
        (
            {"goal_poses": [{"x": 6.0, "y": 1.5}, {"x": 2.0, "y": 1.5}]},
            {"encounter_s": 8.0},
            r"the robot's path turns back at 8 s, and has no direction there",
        ),
        ({"goal_pose": None}, {}, r"there is no path to cross: no start_pose with goal_pose or goal_poses"),
    ],
)
def test_encounter_that_cannot_be_is_a_rejection(inputs, change, asked, reason):
    given_values = {key: value for key, value in {**inputs, **change}.items() if value is not None}
    (item,) = evaluate(crossing(**asked), given_values)
    assert isinstance(item, Rejection)
    with pytest.raises(AssertionError, match=reason):
        raise AssertionError(item.reason)


def test_walls_between_start_and_goal_are_a_rejection(drawn_map):
    rows = [row[:16] + "#" + row[17:] for row in HALL]
    (item,) = evaluate(crossing(), {"map_file": drawn_map(*rows, cells=10), **STOPS})
    assert item == Rejection(
        "there is no path from the start to the goals for a robot 0.35 m across",
        {"encounter_s": 10.0, "angle_deg": 90.0, "speed": 1.0, "late_s": 0.0},
    )


def test_second_crossing_keeps_the_first_and_what_was_requested_of_it(inputs):
    (first,) = evaluate(crossing(name="one"), inputs)
    (second,) = evaluate(crossing(name="two", angle_deg=-90), {**inputs, **first.values})
    assert isinstance(second, Fragment)
    assert [entry["name"] for entry in second.values["movers"]] == ["one", "two"]
    assert second.values["movers"][0] == first.values["movers"][0]
    assert (
        first.values["_requested_movers.one"]["angle_deg"],
        second.values["_requested_movers.two"]["angle_deg"],
    ) == (
        90,
        -90,
    )


def test_shape_without_a_size_is_refused():
    with pytest.raises(ValueError, match=r"shape: expected \{radius_m: …\} or \{length_m: …, width_m: …\} above 0"):
        crossing(shape={"diameter": 1.0})
