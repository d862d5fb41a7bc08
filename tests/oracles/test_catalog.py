"""The shipped oracles on hand-computed runs."""

import math

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.catalog.navigation import spectral_arc_length, stops
from vastflow.oracles.catalog.performance import path_rmse_m, resampled
from vastflow.oracles.catalog.robustness import full_meters
from vastflow.oracles.judgment.registry import OracleError, oracle_of
from vastflow.oracles.observation.goals import missed_goals
from vastflow.oracles.observation.obstacle_tracks import obstacle_tracks_of
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import NoReference, Reference, Trace
from vastflow.sim.model.obstacle import Obstacle, Trigger
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run
from vastflow.sim.model.shape import Box, Disc

STRAIGHT = Reference(np.array([[0.0, 0.0], [10.0, 0.0]]), 10.0)
NO_MAP = NoReference("the scenario has no map")
NO_ROWS = np.empty((0, 2))


def along(y_m=0.0, to_x_m=10.0, rows=101):
    """A straight path in x at constant y."""
    return np.column_stack((np.linspace(0.0, to_x_m, rows), np.full(rows, y_m)))


def judged(
    oracle, xy_m, *obstacles, outcome="succeeded", reason="", missed=0, events=(), reference=STRAIGHT, parameters=None, **columns
):  # fmt: skip
    """The verdict as judgment, reason, and values of metrics."""
    xy = np.asarray(xy_m, dtype=float).reshape(-1, 2)
    run = Run(3, "0", outcome, 0, reason, 20.0, 10.0, 2, missed, tuple(events))
    signals = {"t_s": np.arange(len(xy)) * 0.1, "x_m": xy[:, 0], "y_m": xy[:, 1]}
    signals |= {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    situation = Situation(Pose(0.0, 0.0), (Pose(10.0, 0.0),), obstacles, circumscribed_radius_m=0.15)
    verdict = oracle_of(oracle, parameters or {}).judge(Trace(run, signals, reference), situation)
    assert verdict.run_index == 3
    return verdict.judgment, verdict.reason, {name: metric.value for name, metric in verdict.metrics.items()}


# success


@each_row(
    ("xy_m", "given", "judgment", "reason"),
    [
        (along(0.2), {}, "pass", ""),
        (along(), {"outcome": "aborted", "reason": "no path"}, "fail", "mission aborted: no path"),
        (along(), {"outcome": "timed_out", "reason": "no path"}, "fail", "mission timed out: no path"),
        (along(), {"missed": 1}, "fail", "gave up 1 of 1 goals"),
        (along(), {"missed": 1, "parameters": {"allow_missed": True}}, "pass", ""),
        (NO_ROWS, {"outcome": "aborted"}, "fail", "mission aborted"),
    ],
)
def test_success_judges_outcome(xy_m, given, judgment, reason):
    found = judged("success", xy_m, **given)
    assert found[:2] == (judgment, reason)
    final_m = None if len(xy_m) == 0 else pytest.approx(xy_m[-1, 1], abs=1e-12)
    rest = {"time": 20.0, "distance": 10.0, "recoveries": 2, "missed_goals": given.get("missed", 0)}
    assert found[2] == {"final_distance": final_m, **rest}


@each_row(
    ("xy_m", "missed"),
    [
        ([[0, 0], [10, 0], [0, 0]], 0),
        ([[0, 0], [9.1, 0], [0, 0]], 0),  # within 1 m
        ([[0, 0], [8.9, 0], [0, 0]], 1),
        ([[0, 0], [0, 0]], 1),  # the last goal is where the robot stands: Nav2 ends the mission at once
    ],
)
def test_success_fails_mission_through_poses_without_its_first_goals(xy_m, missed):
    far, home = Pose(10.0, 0.0), Pose(0.0, 0.0)
    situation = Situation(home, (far, home), (), passed=(far,))
    xy, run = np.array(xy_m, dtype=float), Run(3, "0", "succeeded", 0, "", 0.2, 0.0, 0, 0, ())
    trace = Trace(run, {"t_s": 0.1 * np.arange(len(xy)), "x_m": xy[:, 0], "y_m": xy[:, 1]}, STRAIGHT)
    verdict = oracle_of("success", {}).judge(trace, situation)
    assert (verdict.judgment, verdict.reason) == (("fail", "never passed 1 of 2 goals") if missed else ("pass", ""))
    assert verdict.metrics["missed_goals"].value == missed
    assert oracle_of("success", {"allow_missed": True}).judge(trace, situation).judgment == "pass"
    efficient = oracle_of("navigation", {}).judge(trace, situation).metrics["spl"].value
    assert efficient == 0.0 if missed else efficient > 0.0


@each_row(
    ("xs_m", "passed", "missed"),
    [
        (range(11), (5.0, 10.0), 0),
        (range(11), (10.0, 5.0), 1),  # in their order
        ((0.0, 0.0), (10.0, 5.0), 2),
        ((0.0, 0.2), (0.5,), 0),  # the robot stands at the first goal
        ((0.0, 0.2), (4.0, 0.5), 1),
        ((0.0, 10.0, 0.0), (10.0, 10.0), 0),  # the same goal twice
        ((0.0, 5.0, 0.0), (5.0, 0.0, 5.0), 1),
    ],
)
def test_goals_of_mission_through_poses_count_in_their_order(xs_m, passed, missed):
    poses, home = tuple(Pose(x_m, 0.0) for x_m in passed), Pose(0.0, 0.0)
    run, x_m = Run(3, "0", "succeeded", 0, "", 0.2, 0.0, 0, 0, ()), np.array([*xs_m], dtype=float)
    trace = Trace(run, {"t_s": 0.1 * np.arange(len(x_m)), "x_m": x_m, "y_m": np.zeros_like(x_m)}, STRAIGHT)
    assert missed_goals(trace, Situation(home, (*poses, home), (), passed=poses)) == missed


@each_row(
    ("true_m", "estimated_m", "missed"),
    [
        (
            (0.0, 0.0),
            (0.0, 0.0),
            1,
        ),  # 0.9 m from the start, and Nav2 passes within 0.7 m (navigate_through_poses_w_replanning_and_recovery.xml:15)
        ((0.0, 0.0), (0.0, 0.3), 0),
        ((0.0, 0.9), (0.0, 0.9), 0),
        ((0.0, -0.2), (0.0, 0.9), 1),  # the estimate alone was there
    ],
)
def test_goal_beside_the_start_is_passed_where_nav2_takes_it_for_passed(true_m, estimated_m, missed):
    run, home, beside = Run(3, "0", "succeeded", 0, "", 0.2, 0.0, 0, 0, ()), Pose(0.0, 0.0), Pose(0.9, 0.0)
    xs = {"x_m": np.array(true_m), "estimated_x_m": np.array(estimated_m)}
    zeros = dict.fromkeys(("y_m", "estimated_y_m", "t_s"), np.zeros(2))
    trace = Trace(run, {**xs, **zeros}, STRAIGHT)
    assert missed_goals(trace, Situation(home, (beside, home), (), passed=(beside,))) == missed


# performance


@each_row(
    ("xy_m", "given", "judgment", "metrics"),
    [
        (along(0.3), {}, "pass", {"rmse": 0.3, "length_ratio": 1.0, "threshold": 2.2}),
        (along(0.3), {"parameters": {"local_robot_radius_m": 0.03}}, "pass", {"threshold": 0.3}),  # exactly the bound
        # Never moved: distances to 11 points at 0, 1, .., 10 m have the mean square 385 / 11 = 35.
        (np.zeros((5, 2)), {"outcome": "aborted", "parameters": {"samples": 11}}, "fail", {"rmse": 35**0.5, "length_ratio": 0.0}),
        # Half the path: at fraction f the robot is at 5f m, the reference at 10f m: 5² mean of f² = 25 · 0.35.
        (along(to_x_m=5.0), {"outcome": "timed_out", "parameters": {"samples": 11}}, "fail", {"rmse": (25 * 0.35) ** 0.5}),
        (along(), {"reference": NO_MAP}, "not judged", dict.fromkeys(("rmse", "threshold", "reference_length", "length_ratio"))),
        (along(), {"reference": Reference(np.zeros((1, 2)), 0.0)}, "not judged", {"reference_length": 0.0}),
        (NO_ROWS, {}, "not judged", {"reference_length": 10.0}),
    ],
)  # fmt: skip
def test_performance_compares_path_with_reference(xy_m, given, judgment, metrics):
    found = judged("performance", xy_m, **given)
    assert found[0] == judgment
    assert {name: found[2][name] for name in metrics} == pytest.approx(metrics)


def test_performance_states_deviation_from_reference_path():
    said = judged("performance", along(0.3), parameters={"local_robot_radius_m": 0.029})[1]
    assert said == "RMSE 0.30 m to the reference path, more than 0.29 m"
    assert judged("performance", along(), reference=NO_MAP)[1] == "no reference path: the scenario has no map"
    crowded = np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0], [2.0, 0.0], [2.0, 2.0]])
    np.testing.assert_allclose(resampled(crowded, 5), [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2]])
    assert path_rmse_m(along(), along(rows=7), 100) == pytest.approx(0.0, abs=1e-12)


# safety: separation


def box(edge_m, x_m=5.0):
    return Obstacle("box", Box(edge_m, edge_m), Pose(x_m, 0.0))


DRUM = Obstacle("drum", Disc(0.3), Pose(0.0, 0.0))


def passing(separation_m, *, events=(), obstacles=None, **parameters):
    """The verdict on a robot with the smallest separations from obstacles."""
    columns = {f"separation_m/{o.shape}": [max(3.0, s), s, max(3.0, s)] for o, s in separation_m.items()}
    present = separation_m if obstacles is None else obstacles
    return judged("safety", along(rows=3), *present, events=events, parameters=parameters, **columns)


NONE_THERE = {"smallest_separation": None, "margin": None}


@each_row(
    ("separation_m", "parameters", "judgment", "metrics"),
    [
        # The paper's cubes: required 0.554 and 0.766 m, or 0.633 and 0.893 m read in space.
        ({box(0.5): 1.0}, {}, "pass", {"margin": 1.0 - 0.554}),
        ({box(0.8): 1.0}, {}, "pass", {"margin": 1.0 - 0.766}),
        ({box(0.5): 0.634}, {"obstacle_radius": "cube"}, "pass", {"margin": 0.001}),
        ({box(0.8): 0.892}, {"obstacle_radius": "cube"}, "fail", {"margin": -0.001}),
        ({box(0.8): 0.8}, {}, "pass", {"margin": 0.034, "footprint_margin": 0.034, "cube_margin": -0.093}),
        ({box(0.8): 0.8}, {"obstacle_radius": "cube"}, "fail", {"margin": -0.093, "footprint_margin": 0.034}),
        ({DRUM: 1.0}, {"obstacle_radius": "cube"}, "pass", {"cube_margin": 0.5, "footprint_margin": 0.5}),
        # The smallest margin counts, not the nearest obstacle: 0.60 - 0.554 > 0, 0.70 - 0.766 < 0.
        ({box(0.5): 0.60, box(0.8): 0.70}, {}, "fail", {"smallest_separation": 0.60}),
        ({box(0.5): 1.0}, {"max_speed_mps": 1.0, "max_deceleration_mps2": 1.0}, "fail", {"margin": 1 - (2**0.5 / 4 + 0.65)}),
        ({}, {}, "pass", NONE_THERE),
        ({box(0.8): np.inf, box(0.5): 1.0}, {}, "pass", {"smallest_separation": 1.0, "margin": 1.0 - 0.554}),
        ({box(0.5): np.inf}, {}, "pass", NONE_THERE),
    ],
)  # fmt: skip
def test_safety_requires_separation(separation_m, parameters, judgment, metrics):
    found = passing(separation_m, **parameters)
    assert found[0] == judgment
    assert {name: found[2][name] for name in metrics} == pytest.approx(metrics, abs=5e-4)


def test_safety_names_obstacle_when_too_close():
    said = passing({box(0.5): 0.60, box(0.8): 0.70})[1]
    assert said == "0.700 m from the center of a box 0.8 x 0.8 m, less than 0.766 m"
    assert judged("safety", NO_ROWS, box(0.5))[0] == "not judged"


def contact(what):
    return Event(0.1, "contact", 0.0, 0.0, what, 0.2)


def test_safety_fails_contacts_as_requested():
    for fails, touched, reason in (
        ("none", ["box"], ""),
        ("obstacle", ["box"], "touched 'box'"),
        ("obstacle", ["wall"], ""),
        ("any", ["wall"], "touched 'wall'"),
        ("obstacle", ["wall", "box", "box"], "touched 'box' and 1 more"),
    ):
        events = (*map(contact, touched), Event(2.0, "recovery", 0, 0, "spin"))
        found = passing({box(0.5): 5.0}, events=events, fail_on_contact=fails)
        assert found[:2] == ("fail" if reason else "pass", reason)
        assert (found[2]["contacts"], found[2]["obstacle_contacts"]) == (len(touched), touched.count("box"))


# robustness

BASES = ("update", "step", "metre", "mean", "maximum")


def localized(error_mm, at, x_m=None, **parameters):
    error, at = np.asarray(error_mm, dtype=float) * 1e-3, np.asarray(at, dtype=float)
    xy = np.column_stack((np.zeros(len(error)) if x_m is None else x_m, np.zeros(len(error))))
    return judged("robustness", xy, parameters=parameters, localization_error_m=error, localized=at)


def test_robustness_measures_every_basis():
    # Updates at rows 1 and 3; meters are full at rows 2 (1.2 m) and 4 (2.0 m); row 0 is before AMCL's first pose.
    said, _, metrics = localized([900, 10, 20, 40, 80], [0, 1, 0, 1, 0], x_m=[0, 0.5, 1.7, 2.4, 2.5])
    expected = {"update": 0.05, "step": 0.15, "metre": 0.1, "mean": 0.0375, "maximum": 0.08}
    assert (said, metrics) == ("pass", pytest.approx({**expected, "updates": 2, "threshold": 0.3}))
    metrics = localized([50] * 40, [1] + [0] * 39)[2]
    assert (metrics["metre"], metrics["update"]) == (0.0, 0.05)
    xy_m = np.column_stack(([0.0, 0.6, 0.6, 0.6, 0.6], [0.0, 0.0, 0.4, 0.4, 2.6]))
    np.testing.assert_array_equal(full_meters(xy_m), [2, 4, 4])  # lengths 0, 0.6, 1.0, 1.0, 3.2
    assert full_meters(xy_m[:2]).size == 0


@each_row(
    ("basis", "what"),
    [
        ("update", "summed localization error over 2 updates of AMCL 0.050 m"),
        ("step", "summed localization error over time steps 0.150 m"),
        ("metre", "summed localization error over meters driven 0.100 m"),
        ("mean", "mean localization error 0.037 m"),
        ("maximum", "greatest localization error 0.080 m"),
    ],
)
def test_robustness_judges_by_requested_basis(basis, what):
    found = localized([0, 10, 20, 40, 80], [0, 1, 0, 1, 0], [0, 0.5, 1.7, 2.4, 2.5], basis=basis, threshold_m=0.01)
    assert found[:2] == ("fail", f"{what}, more than 0.01 m")
    for error_mm, judgment in ((300, "pass"), (301, "fail")):
        expected = "pass" if basis == "metre" else judgment  # no meter is full
        assert localized([0, error_mm], [0, 1], basis=basis)[0] == expected


def test_robustness_passes_exact_threshold_for_any_duration():
    # As floating-point numbers 0.1 + 0.1 + 0.1 is more than 0.3.
    assert [localized([100, 100, last], [1] * 3, basis="update")[0] for last in (100, 101)] == ["pass", "fail"]
    for n in (10, 100, 1000):
        assert [localized([50, last] * n, [1, 1] * n)[0] for last in (300, 301)] == ["pass", "fail"]


def test_robustness_needs_rows_poses_and_signals():
    unknown = {**dict.fromkeys((*BASES, "updates")), "threshold": 0.3}
    assert localized([], []) == ("not judged", "the recording has no rows", unknown)
    assert localized([10, 10], [0, 0]) == ("not judged", "AMCL published no pose", {**unknown, "updates": 0})
    said = judged("robustness", along(rows=2))[1]
    assert said == "the trace has no localization_error_m and no localized"
    with pytest.raises(OracleError, match="'update', 'step', 'metre', 'mean' or 'maximum'"):
        oracle_of("robustness", {"basis": "second"})


# navigation

DETOUR = [(0, 0), (0, 1.25), (10, 1.25), (10, 0)]  # 12.5 m
FAR = [math.inf] * 4
REACHED = [Event(t_s, "goal_reached", 0, 0, "0") for t_s in (8.0, 21.5)]
STOPPED = [1] * 20 + [0] * 5 + [1] * 11 + [0] * 5 + [1] * 2 + [0] * 5 + [1] * 30


@each_row(
    ("xy_m", "given", "metrics"),
    [
        (DETOUR, {}, {"spl": 0.8, "path_efficiency": 0.8, "time_to_goal": 20.0, "minimum_clearance": None}),
        *((DETOUR, failed, {"spl": 0.0, "path_efficiency": None, "time_to_goal": None})
          for failed in ({"outcome": "aborted"}, {"outcome": "timed_out"}, {"missed": 1})),
        ([(0, 0), (8, 0)], {}, {"spl": 1.0, "path_efficiency": 1.25}),  # shorter than the octile path
        ([(0, 0), (0, 0)], {}, {"spl": 1.0, "path_efficiency": None, "turning": None}),
        (DETOUR, {"reference": NO_MAP}, {"spl": None, "path_efficiency": None}),
        (DETOUR, {"events": REACHED}, {"time_to_goal": 21.5}),
        (DETOUR, {"wall_clearance_m": [1, 0.6, 1, 1], "appearing_clearance_m": [*FAR[:2], 0.4, 2]}, {"minimum_clearance": 0.4}),
        (DETOUR, {"appearing_clearance_m": FAR}, {"minimum_clearance": None}),
        # Stops are between driving and driving, and last half a second.
        (np.zeros((len(STOPPED), 2)), {"stopped": STOPPED}, {"stops": 1, "stopped_time": 1.0}),
        (np.zeros((30, 2)), {"stopped": np.ones(30), "speed_mps": np.zeros(30)}, {"stops": 0, "smoothness": None}),
        (NO_ROWS, {}, {"recoveries": 2, "spl": None, "stops": None, "smoothness": None, "time_to_goal": None}),
    ],
)  # fmt: skip
def test_navigation_measures_run(xy_m, given, metrics):
    said, _, found = judged("navigation", xy_m, **given)
    assert (said, {name: found[name] for name in metrics}) == ("pass", pytest.approx(metrics))


def test_navigation_measures_nothing_without_robot():
    trace = Trace(Run(0, "0", "succeeded", 0, "", 1.0, 0.0, 0, 0), {}, NoReference("no robot"))
    verdict = oracle_of("navigation", {}).judge(trace, Situation(None, (), ()))
    assert {metric.value for metric in verdict.metrics.values()} == {None}
    for rows, count in ((5, 0), (6, 1)):
        stopped = np.array([0] + [1] * rows + [0]) > 0
        assert len(stops(np.arange(len(stopped)) * 0.1, stopped, 0.5)) == count


def test_navigation_measures_as_mrpb():
    """By hand, rows 0.1 s apart: displacements 1, 2, 2, 0 m along x, then 1 m along y."""
    xy_m = [(0, 0), (1, 0), (3, 0), (5, 0), (5, 0), (5, 1)]
    near = {"wall_clearance_m": [0.3, 0.2, 1, 0.1, 0.5, 0.2], "static_clearance_m": [1, 1, 0.25, 1, 0.3, 1]}
    found = judged("navigation", xy_m, **near, speed_mps=[0, 1, 2, 2, 0, -1])[2]
    assert found["path_smoothness"] == pytest.approx(1 + 0 + 4 + 1)
    assert found["velocity_smoothness"] == pytest.approx((1 + 1 + 0 + 2 + 1) / 5 / 0.1)
    assert found["minimum_clearance"] == 0.1 and found["near_obstacles"] == 1.0
    near["static_clearance_m"][2] = 0.31  # two of five steps touch that row
    assert judged("navigation", xy_m, **near)[2]["near_obstacles"] == pytest.approx(3 / 5)
    assert judged("navigation", xy_m, parameters={"near_m": 0.05}, **near)[2]["near_obstacles"] == 0.0
    alone = judged("navigation", xy_m[:1], wall_clearance_m=[0.1], speed_mps=[1])[2]
    assert [alone[name] for name in ("near_obstacles", "path_smoothness", "velocity_smoothness")] == [None] * 3


def test_navigation_gives_final_pose_seen_from_goal():
    found = judged("navigation", [(0, 0), (10.2, -0.1)], yaw_rad=[0.0, 2 * math.pi - 0.05])[2]
    assert [found[f"final_{name}"] for name in ("x", "y", "yaw")] == pytest.approx([0.2, -0.1, -0.05])
    found = judged("navigation", [(0, 0), (10.2, -0.1)], yaw_rad=[0.0, -0.05], outcome="timed_out")[2]
    assert {found[f"final_{name}"] for name in ("x", "y", "yaw")} == {None}


def test_turning_is_curvature_of_circle():
    angle = np.linspace(0.0, 2 * math.pi, 2001)
    circle = 2.0 * np.column_stack((np.cos(angle), np.sin(angle)))
    for sense in (1.0, -1.0):
        yaw_rad = (sense * angle + math.pi) % (2 * math.pi) - math.pi
        assert judged("navigation", circle, yaw_rad=yaw_rad)[2]["turning"] == pytest.approx(1 / 2.0, rel=1e-5)


def bell(step_s=0.01):
    return np.exp(-5.0 * np.arange(-1.0, 1.0, step_s) ** 2)


def test_smoothness_is_published_value_and_falls_with_stops():
    # The example of the authors' own implementation gives -1.41403; a tenth of its rate of samples about as much.
    for scale in (0.01, 1.0, 100.0):
        assert spectral_arc_length(scale * bell(), 0.01) == pytest.approx(-1.41403, abs=5e-6)
    slow = judged("navigation", np.zeros((20, 2)), speed_mps=bell(0.1))[2]["smoothness"]
    assert slow == pytest.approx(-1.414, abs=0.01)
    values = [spectral_arc_length(np.concatenate([bell(), np.zeros(50)] * n), 0.01) for n in (1, 2, 3)]
    assert values == sorted(set(values), reverse=True)
    for speed in ([], [0.5], [0.0, 0.0, 0.0]):
        assert spectral_arc_length(np.array(speed), 0.1) is None


STEP_S = 0.1


def carton(x_m, name="carton", *, appears=True, edge_m=0.5):
    return Obstacle(name, Box(edge_m, edge_m), Pose(x_m, 0.0), Trigger(x_m, 0.0, 1.0) if appears else None)


def answered(speed_mps, obstacles, appears_s, **parameters):
    """The verdict on a robot that drives along x from 0; separations and clearances are observed from the events."""
    speed = np.asarray(speed_mps, dtype=float)
    x_m = np.r_[0.0, np.cumsum(speed[1:] * STEP_S)]
    xy_m = np.column_stack((x_m, 0 * x_m))
    t_s = np.arange(len(speed)) * STEP_S
    events = [
        Event(appears_s[o.name], "spawned", o.pose.x_m, o.pose.y_m, o.name) for o in obstacles if o.name in appears_s
    ]
    run = Run(0, "0", "succeeded", 0, "", 1.0, 1.0, 0, 0, tuple(events))
    situation = Situation(None, (), tuple(obstacles), circumscribed_radius_m=0.15)
    t_ms = np.rint(t_s * 1000).astype(np.int32)
    columns = {"t_s": t_s, "x_m": x_m, "y_m": 0 * x_m, "speed_mps": speed}
    for each in obstacle_tracks_of(situation, run):
        for name, apart_m in (
            (f"separation_m/{each.obstacle.shape}", np.hypot(*(xy_m - each.at(t_ms)).T)),
            ("appearing_clearance_m", each.clearance_m(t_ms, xy_m)),
        ):
            columns[name] = np.minimum(columns.get(name, math.inf), apart_m)
    verdict = oracle_of("safety", parameters).judge(Trace(run, columns, NoReference("none is needed")), situation)
    return verdict.judgment, {name: metric.value for name, metric in verdict.metrics.items()}


CRUISE, BRAKE = [0.5] * 11, [0.4, 0.2, 0.0]  # rows 0..10, then at 1 and 2 m/s²
SLOWLY = [*CRUISE, *np.arange(0.485, 0.1, -0.015)]
GENTLY = [*CRUISE, *np.arange(0.49, 0.005, -0.01), 0.0, 0.0]
TWO = [carton(2.0, "near"), carton(4.0, "far", edge_m=0.8)]


@each_row(
    ("speed_mps", "obstacles", "appears_s", "parameters", "response_s", "unanswered"),
    [
        # It appears at 0.7 s; the speed begins to fall after the row at 1.0 s.
        ([*CRUISE, *BRAKE, 0.0], [carton(2.0)], 0.7, {}, 0.3, 0),
        # Braking loses 0.1 m/s within 0.5 s, or what the campaign file says.
        ([*CRUISE, 0.48, 0.46, 0.44, 0.42, *[0.4] * 5], [carton(2.0)], 0.7, {}, 0.3, 0),
        ([*CRUISE, 0.48, 0.46, 0.44, 0.42, *[0.401] * 5], [carton(2.0)], 0.7, {}, None, 1),
        (SLOWLY, [carton(4.0)], 0.7, {}, None, 1),
        (SLOWLY, [carton(4.0)], 0.7, {"braking_mps": 0.03, "braking_s": 0.2}, 0.3, 0),
        ([0.5, 0.45, 0.5, 0.42] * 5, [carton(1.2)], 0.2, {}, None, 1),  # uneven driving
        (GENTLY, [carton(4.0)], 0.5, {"stopped_speed_mps": 0.0}, (len(GENTLY) - 3) * STEP_S - 0.5, 0),
        ([*CRUISE, *BRAKE, 0.0], [carton(2.0)], 1.0, {}, 0.0, 0),  # brakes already
        ([0.0, 0.0, 0.2, 0.4], [carton(1.5)], 0.1, {}, 0.0, 0),  # stands, and drives on
        ([0.5] * 20, [carton(0.95)], 0.7, {}, None, 1),  # runs into it
        ([*[0.5] * 30, 0.0], [carton(0.6)], 0.2, {}, None, 1),  # brakes after it is passed
        ([0.5] * 30, [carton(-1.0)], 0.2, {}, None, 0),  # behind the robot
        ([*CRUISE, *BRAKE, *CRUISE, *BRAKE, 0.0], TWO, {"near": 0.9, "far": 1.6}, {}, 0.8, 0),  # the slowest counts
        ([*CRUISE, *BRAKE], [carton(2.0, appears=False)], {}, {}, None, 0),
        (CRUISE, [carton(2.0)], 9.0, {}, None, 0),  # after the last row
    ],
)
def test_response_time_is_until_braking_begins(speed_mps, obstacles, appears_s, parameters, response_s, unanswered):
    times = appears_s if isinstance(appears_s, dict) else {"carton": appears_s}
    _, metrics = answered(speed_mps, obstacles, times, **parameters)
    expected = None if response_s is None else pytest.approx(response_s)
    assert (metrics["response_time"], metrics["unanswered"] or 0) == (expected, unanswered)


BARREL = Obstacle("drum", Disc(0.25), Pose(0.45, 0.0))


@each_row(
    ("speed_mps", "obstacle", "appears_s", "judgment", "metrics"),
    [
        # The required separation from a cube of 0.5 m is 0.5536 m. Centers 0.60, 0.55, 0.50, 0.50, 0.50 m apart: 3.5 steps.
        ([0.5, 0.5, 0.5, 0.0, 0.0], carton(0.6, appears=False), {}, "fail", {"violation_time": 0.35, "violation_clearance": 0.1}),
        ([0.0, 0.0], carton(0.3, appears=False), {}, "fail", {"violation_clearance": 0.3 - 0.25 - 0.15}),
        ([0.0, 0.0], carton(1.0, appears=False), {}, "pass", {"violation_time": 0.0, "violation_clearance": None}),
        ([0.0] * 11, carton(0.5), {"carton": 0.6}, "fail", {"violation_time": 0.45}),
        # 0.25 + 0.15 + 0.05 = 0.45 m, which floating-point sums miss by 1e-17.
        ([0.0, 0.0], BARREL, {}, "pass", {"margin": 0.0}),
    ],
)  # fmt: skip
def test_violation_has_duration_and_clearance(speed_mps, obstacle, appears_s, judgment, metrics):
    said, found = answered(speed_mps, [obstacle], appears_s)
    assert (said, {name: found[name] for name in metrics}) == (judgment, pytest.approx(metrics))


# safety: bodies that move


def met(cart_x_m, cart_speed_mps, robot_x_m=0.0, **parameters):
    """Judge a second of a robot that stands and a cart that moves along x."""
    t_s = np.arange(11) * STEP_S
    zero = 0 * t_s
    x_m = cart_x_m + cart_speed_mps * t_s
    situation = Situation(None, (), (), circumscribed_radius_m=0.15, movers={"cart": Disc(0.3)})
    columns = {"t_s": t_s, "x_m": zero + robot_x_m, "y_m": zero, "speed_mps": zero, "yaw_rad": zero}
    columns |= {"mover_x_m/cart": x_m, "mover_y_m/cart": zero, "mover_yaw_rad/cart": zero}
    columns |= {"separation_m/cart": np.abs(x_m - robot_x_m), "moving_clearance_m": np.abs(x_m - robot_x_m) - 0.3}
    trace = Trace(Run(0, "0", "succeeded", 0, "", 1.0, 1.0, 0, 0), columns, NoReference("none is needed"))
    return oracle_of("safety", parameters).judge(trace, situation)


@each_row(
    ("cart_x_m", "cart_speed_mps", "judgment", "margin_m"),
    [
        # 0.3 + 0.15 + (0.5 + 1.0)² / 5 = 0.9 m: nearest at the end, 2.0 - 1.0 m away.
        (2.0, -1.0, "pass", 0.1),
        (1.8, -1.0, "fail", -0.1),
        # It goes away: the robot's own 0.5 m/s alone, 0.5 m.
        (0.6, 1.0, "pass", 0.1),
        # It stands.
        (0.6, 0.0, "pass", 0.1),
    ],
)
def test_separation_from_a_mover_takes_the_closing_speed(cart_x_m, cart_speed_mps, judgment, margin_m):
    verdict = met(cart_x_m, cart_speed_mps)
    assert verdict.judgment == judgment
    assert verdict.metrics["margin"].value == pytest.approx(margin_m, abs=1e-9)
    if judgment == "fail":
        assert verdict.reason == "0.800 m from the center of 'cart', less than 0.900 m"


def test_robot_that_touches_a_mover_fails():
    event = Event(0.5, "contact", 0.0, 0.0, "cart", 0.1)
    situation = Situation(None, (), (), movers={"cart": Disc(0.3)})
    zero = np.zeros(3)
    columns = {"t_s": np.arange(3.0), "x_m": zero, "y_m": zero, "speed_mps": zero}
    columns |= {"mover_x_m/cart": zero + 5, "mover_y_m/cart": zero, "mover_yaw_rad/cart": zero}
    columns |= {"separation_m/cart": zero + 5, "moving_clearance_m": zero + 4.7}
    run = Run(0, "0", "succeeded", 0, "", 1.0, 1.0, 0, 0, (event,))
    verdict = oracle_of("safety", {}).judge(Trace(run, columns, NoReference("none is needed")), situation)
    assert (verdict.judgment, verdict.reason) == ("fail", "touched 'cart'")
