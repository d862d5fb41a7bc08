"""Runs on a map whose origin is turned: those on the map that is not, turned."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.oracles.observation.observe import ScenarioObserver
from vastflow.sim.loop.simulation import Simulation
from vastflow.sim.model.pose import GridFrame, Pose
from vastflow.sim.model.recording import si
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.replay import Box, replay
from vastflow.sim.run import run
from vastflow.sim.scenario.tree.messages import message
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World

ORIGIN = (-2.0, 1.5)
"""Origin of the two rooms in these tests; the poses below are measured from it."""
START, GOAL = (1.0, 1.0, 0.25), (7.0, 4.0, 1.0)
AHEAD = (3.0, 2.0)


@pytest.fixture(scope="module")
def rooms(two_rooms_map, saved):
    """The two rooms as a map file whose origin has a yaw."""
    return lambda yaw_rad: saved(OccupancyMap(two_rooms_map.cells, 0.05, ORIGIN, yaw_rad))


@pytest.fixture(scope="module")
def trip(rooms, scenario):
    """From room to room on the map turned by `yaw_rad`, past an obstacle and one that appears, poses turned likewise."""

    def make(yaw_rad, **values):
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)

        def at(x, y, yaw=0.0):
            return {"x": ORIGIN[0] + c * x - s * y, "y": ORIGIN[1] + s * x + c * y, "yaw": yaw + yaw_rad}

        crate = {"entity_name": "crate", "model": "box", "xacro_arguments": "width:=0.4, length:=0.6"}
        made = scenario(
            map_file=rooms(yaw_rad),
            start_pose=at(*START),
            goal_pose=at(*GOAL),
            obstacles=[
                {**crate, "spawn_pose": at(2.5, 1.5, 0.5)},
                {
                    **crate,
                    "entity_name": "sudden",
                    "spawn_pose": at(*AHEAD, 1.0),
                    "spawn_trigger": {"point": at(*AHEAD), "threshold": 1.2},
                },
            ],
            **{"controller": "rpp", **values},
        )
        made.__dict__["situation_digest"] = "0" * 64  # the same noise, though the situations are written otherwise
        return made

    return make


def frame(yaw_rad):
    return GridFrame(ORIGIN, yaw_rad)


def turned_mm(columns, yaw_rad, prefix=""):
    xy_m = np.column_stack([si(columns[f"{prefix}x_mm"]), si(columns[f"{prefix}y_mm"])])
    return frame(yaw_rad).points_to_map(xy_m) * 1000.0


@given(st.floats(-math.pi / 4, math.pi / 4))
@settings(max_examples=3, deadline=None)
def test_run_on_a_turned_map_is_the_run_on_the_map_turned(trip, yaw_rad):
    plain, turned = run(trip(0.0), 1), run(trip(yaw_rad), 1)
    assert plain.run.outcome == "succeeded"
    for prefix in ("", "estimated_"):
        xy_mm = np.column_stack([turned.columns[f"{prefix}x_mm"], turned.columns[f"{prefix}y_mm"]])
        # Half a millimeter of rounding on either side, one of them turned.
        assert np.abs(xy_mm - turned_mm(plain.columns, yaw_rad, prefix)).max() <= 0.5 + math.sqrt(0.5) + 1e-6
        yaws = (turned.columns[f"{prefix}yaw_mrad"], plain.columns[f"{prefix}yaw_mrad"])
        apart_rad = si(yaws[0] - yaws[1]) - yaw_rad
        assert np.abs(np.remainder(apart_rad + math.pi, math.tau) - math.pi).max() <= 1e-3 + 1e-9
    for name in ("t_ms", "speed_mmps", "yaw_rate_mradps", "sent_speed_mmps", "localized", "covariance_yaw_mrad2"):
        assert np.array_equal(turned.columns[name], plain.columns[name]), name
    sums = [c["covariance_xx_mm2"] + c["covariance_yy_mm2"] for c in (turned.columns, plain.columns)]
    assert np.abs(sums[0] - sums[1]).max() <= 2
    assert [(e.t_s, e.kind, e.what) for e in turned.run.events] == [(e.t_s, e.kind, e.what) for e in plain.run.events]
    assert "spawned" in {event.kind for event in plain.run.events}
    for event, other in zip(turned.run.events, plain.run.events, strict=True):
        assert (event.x_m, event.y_m) == pytest.approx(frame(yaw_rad).to_map(other.x_m, other.y_m), abs=1.3e-3)
    assert (turned.run.distance_m, turned.run.simulated_s) == (plain.run.distance_m, plain.run.simulated_s)


def test_moments_and_snapshots_turn_with_the_map(trip):
    yaw_rad, look = 0.6, {60: Box(-50.0, -50.0, 50.0, 50.0)}
    plain, turned = (replay(trip(angle, controller="mppi", timeout_s=4.0), 2, 0, look) for angle in (0.0, yaw_rad))
    turn = frame(yaw_rad)
    for there, here in zip(plain.moments, turned.moments, strict=True):
        for pose, other in ((there.true, here.true), (there.estimate, here.estimate)):
            expected = turn.pose_to_map(pose)
            assert (other.x_m, other.y_m) == pytest.approx((expected.x_m, expected.y_m), abs=1e-9)
            assert math.remainder(other.yaw_rad - expected.yaw_rad, math.tau) == pytest.approx(0.0, abs=1e-9)
    (saw,), (sees,) = plain.snapshots, turned.snapshots
    for name in ("plan_xy_m", "ahead_xy_m", "intended_xy_m", "scan_xy_m"):
        np.testing.assert_allclose(getattr(sees, name), turn.points_to_map(getattr(saw, name)), atol=1e-9)
        assert len(getattr(saw, name)) > 0
    np.testing.assert_allclose(sees.particles[:, :2], turn.points_to_map(saw.particles[:, :2]), atol=1e-9)
    np.testing.assert_allclose(sees.obstacles[0], turn.points_to_map(saw.obstacles[0]), atol=1e-9)
    for patch, other in ((saw.global_costs, sees.global_costs), (saw.overview, sees.overview)):
        assert np.array_equal(patch.costs, other.costs)
        assert other.corner.yaw_rad == pytest.approx(yaw_rad)
        assert (other.corner.x_m, other.corner.y_m) == pytest.approx(turn.to_map(patch.corner.x_m, patch.corner.y_m))


def test_observation_is_the_same_on_the_turned_map(trip):
    yaw_rad = -0.4
    (reference, plain), (turned_reference, turned) = (
        ScenarioObserver(made).observed(run(made, 1)) for made in (trip(0.0), trip(yaw_rad))
    )
    assert turned_reference.length_m == pytest.approx(reference.length_m, abs=2e-3)
    assert list(turned) == list(plain)
    for name, column in plain.items():
        assert np.abs(turned[name] - column).max() <= 3, name


def test_plan_and_pose_messages_use_map_frame(rooms):
    heard, yaw_rad = [], 0.5
    for angle in (0.0, yaw_rad):
        parameters = parameters_of({"controller": "rpp"})
        prepared = prepare(World(load_map(rooms(angle).path)), Lidar(), parameters)
        start, goal = (frame(angle).pose_to_map(Pose(ORIGIN[0] + x, ORIGIN[1] + y, a)) for x, y, a in (START, GOAL))
        simulation = Simulation(prepared, parameters, Lidar(), Robot(), start, (), (0, 0, 1), 20.0)
        simulation.localize(start)
        simulation.navigate(Mission("navigate_to_pose", (goal,)))
        simulation.advance(60)
        heard.append([message(simulation, topic) for topic in ("/plan", "/amcl_pose")])
    (plan, pose), (turned_plan, turned_pose) = heard
    there, here = (
        np.array([(p["pose"]["position"]["x"], p["pose"]["position"]["y"]) for p in found["poses"]])
        for found in (plan, turned_plan)
    )
    assert len(here) > 50
    np.testing.assert_allclose(here, frame(yaw_rad).points_to_map(there), atol=1e-9)
    covariances = [np.array(found["pose"]["covariance"]).reshape(6, 6)[:2, :2] for found in (pose, turned_pose)]
    turn = np.array([[math.cos(yaw_rad), -math.sin(yaw_rad)], [math.sin(yaw_rad), math.cos(yaw_rad)]])
    np.testing.assert_allclose(covariances[1], turn @ covariances[0] @ turn.T, atol=1e-9)
    assert covariances[0][0, 1] != 0.0
