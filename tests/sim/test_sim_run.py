"""Whole runs in two small rooms: missions, failures, obstacles, contacts."""

import gc
import math
import weakref
from functools import partial

import numpy as np
import pytest
from recorded import final, happened
from shapely.geometry import Point
from table import each_row

from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.obstacle import obstacle_of
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import si
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.controllers.rpp import Rpp
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.navigator.state import COLUMNS
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.run import ScenarioError, run
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World


@pytest.fixture(scope="module")
def scenario(scenario):
    """The two rooms' missions with the controller that is quickest to compute."""
    return partial(scenario, controller="rpp")


GOALS = [{"x": 3.0, "y": 4.0}, {"x": 6.0, "y": 1.5}, {"x": 7.0, "y": 4.0}]


def kinds(recording, kind):
    return [event.what for event in happened(recording, kind)]


@pytest.fixture(scope="module")
def through_the_door(scenario):
    return run(scenario(goal_pose={"x": 7.0, "y": 4.0, "yaw": 2.5}), 0)


def test_robot_goes_through_the_door_to_its_goal_and_turns_to_its_heading(through_the_door):
    found = through_the_door.run
    assert (found.outcome, found.error_code, found.reason, found.recoveries) == ("succeeded", 0, "", 0)
    assert (kinds(through_the_door, "goal_reached"), kinds(through_the_door, "contact")) == (["0"], [])
    assert math.dist(final(through_the_door), (7.0, 4.0)) < 0.4
    assert 6.5 < found.distance_m < 9.0
    yaw_error = si(through_the_door.columns["estimated_yaw_mrad"])[-1] - 2.5
    assert abs(math.remainder(yaw_error, 2 * math.pi)) <= 0.251


def test_columns_are_aligned_rows_at_ten_hertz_that_agree_with_the_run(through_the_door):
    columns, found = through_the_door.columns, through_the_door.run
    assert tuple(columns) == COLUMNS
    t_ms = columns["t_ms"]
    assert {(len(column), column.dtype) for column in columns.values()} == {(len(t_ms), np.dtype(np.int32))}
    assert t_ms[0] == 0 and (np.diff(t_ms)[:-1] == 100).all() and np.diff(t_ms)[-1] in (50, 100)
    assert found.simulated_s == pytest.approx(t_ms[-1] / 1000, abs=0.051)
    x, y, speed, yaw_rate = (si(columns[name]) for name in ("x_mm", "y_mm", "speed_mmps", "yaw_rate_mradps"))
    driven = np.hypot(np.diff(x), np.diff(y)).sum()
    assert driven == pytest.approx(found.distance_m, rel=0.02)
    assert np.abs(speed).sum() * 0.1 == pytest.approx(driven, rel=0.03)
    assert np.abs(speed).max() <= 0.501 and np.abs(yaw_rate).max() <= 2.001
    localized = columns["localized"]
    assert localized[:4].tolist() in ([0, 1, 0, 0], [0, 0, 1, 0]) and localized.max() == 1
    assert 5 < localized.sum() < len(localized) / 2


@each_row(
    ("mission", "values", "reached"),
    [
        ("navigate_through_poses", {"goal_poses": GOALS}, ["2"]),
        ("follow_waypoints", {"goal_poses": GOALS}, ["0", "1", "2"]),
        ("follow_waypoints", {"goal_poses": GOALS[:2], "number_of_loops": 2, "timeout_s": 300.0}, ["0", "1"] * 3),
    ],
)
def test_missions_of_several_goals_pass_each_in_order(scenario, mission, values, reached):
    recording = run(scenario(mission, **values), 0)
    assert (recording.run.outcome, recording.run.missed_goals) == ("succeeded", 0)
    assert kinds(recording, "goal_reached") == reached
    x, y = si(recording.columns["x_mm"]), si(recording.columns["y_mm"])
    nearest = [np.hypot(x - goal["x"], y - goal["y"]).argmin() for goal in values["goal_poses"]]
    assert nearest == sorted(nearest) or "number_of_loops" in values
    for goal in values["goal_poses"]:
        assert np.hypot(x - goal["x"], y - goal["y"]).min() < 1.0
    assert math.dist(final(recording), values["goal_poses"][-1].values()) < 0.4


def test_blocked_body_stays_while_odometry_advances(two_rooms):
    """A body of 0.65 m that plans for 0.22 m sticks in the door."""
    parameters, start = NavParameters(controller=Rpp()), Pose(1.0, 1.0)
    prepared = prepare(World(load_map(two_rooms.path)), Lidar(), parameters)
    loop = ClosedLoop(prepared, parameters, Lidar(), Robot(radius_m=0.65), start, (), (0, 1, 2), 60.0)
    loop.localize(start)
    loop.navigate(Mission("navigate_to_pose", (Pose(7.0, 4.0),)))
    m = loop.stack.m[0]
    rolled_m, truly_m = 0.0, 0.0
    for tick in range(1, round(12 / TICK_S)):
        here, odometry = tuple(loop.body.pose), (m["odom_x"], m["odom_y"])
        loop.advance(tick)
        if loop.events:
            truly_m += math.dist(here[:2], loop.body.pose[:2])
            rolled_m += math.dist(odometry, (m["odom_x"], m["odom_y"]))
    assert {event.what for event in loop.events} == {"wall"}
    assert rolled_m > truly_m + 0.2


def test_run_leaves_nothing_in_memory(scenario):
    seen = []
    gc.disable()
    try:
        run(scenario(timeout_s=2.0), 0, 0, lambda stack, _: seen.append(weakref.ref(stack.grids.costs)), [30])
        assert [grids() for grids in seen] == [None]
    finally:
        gc.enable()


def appearing(distance_m, x=3.0, y=2.4, **trigger):
    """A carton that appears when the robot comes that near, by default on the way to the door."""
    entry = {"entity_name": "carton", "model": "box", "xacro_arguments": "width:=0.4", "spawn_pose": {"x": x, "y": y}}
    return {**entry, "spawn_trigger": {"point": {"x": x, "y": y}, "threshold": distance_m, **trigger}}


def test_obstacle_appears_when_the_robot_comes_within_its_distance(scenario):
    recording = run(scenario(obstacles=[appearing(1.0)]), 0)
    (spawned,) = happened(recording, "spawned")
    assert (spawned.what, spawned.x_m, spawned.y_m) == ("carton", 3.0, 2.4)
    row = np.searchsorted(recording.columns["t_ms"], round(spawned.t_s * 1000))
    at = si(recording.columns["x_mm"])[row], si(recording.columns["y_mm"])[row]
    assert math.dist(at, (3.0, 2.4)) == pytest.approx(1.0, abs=0.03)
    assert recording.run.outcome == "succeeded"


def test_delayed_obstacle_appears_later_and_is_driven_round(scenario, delay_s=0.8):
    (at_once,) = happened(run(scenario(obstacles=[appearing(1.9)]), 0), "spawned")
    recording = run(scenario(obstacles=[appearing(1.9, delay=delay_s)]), 0)
    (spawned,) = happened(recording, "spawned")
    assert spawned.t_s == pytest.approx(at_once.t_s + delay_s)
    assert (recording.run.outcome, happened(recording, "contact")) == ("succeeded", [])
    later = si(recording.columns["t_ms"]) >= spawned.t_s
    way = zip(si(recording.columns["x_mm"])[later], si(recording.columns["y_mm"])[later], strict=True)
    footprint = obstacle_of(appearing(1.9)).footprint()
    assert min(footprint.distance(Point(*point)) for point in way) > Robot().radius_m


@each_row(("obstacle", "times_s"), [(appearing(0.5, x=1.0, y=4.5), []), (appearing(5.0), [0.0])])
def test_obstacle_appears_at_once_if_near_and_never_if_far(scenario, obstacle, times_s):
    recording = run(scenario(obstacles=[obstacle]), 0)
    assert [event.t_s for event in happened(recording, "spawned")] == times_s
    assert recording.run.outcome == "succeeded"


@each_row(
    ("changes", "error", "message"),
    [
        ({"map_file": "map.yaml"}, ScenarioError, "expected a map file that the campaign names, got 'map.yaml'"),
        ({"robot_radius": 30}, ValueError, r"robot_radius: expected a number in \["),
        ({"map_file": None}, ScenarioError, ".* changed since the campaign was read. Run the campaign again"),
    ],
)
def test_unexecutable_scenario_has_reason(scenario, two_rooms, changes, error, message):
    changed = FileContent(two_rooms.path, "0" * 64)
    with pytest.raises(error, match=message):
        run(scenario(**{key: changed if value is None else value for key, value in changes.items()}), 0)
