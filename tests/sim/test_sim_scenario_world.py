"""Scenario files that change the world: what they spawn and delete, and when the robot's way sets something off."""

import math

import numpy as np
import pytest
from recorded import ends, happened
from table import each_row

from vastflow.oracles.observation.observe import ScenarioObserver
from vastflow.oracles.observation.obstacle_tracks import obstacle_tracks_of
from vastflow.oracles.observation.situation import situation_of
from vastflow.oracles.observation.trace import NoReference
from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Entity, si
from vastflow.sim.model.scenario import Mission
from vastflow.sim.model.shape import Box
from vastflow.sim.nav2.controllers.rpp import Rpp
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.navigator.state import SUCCEEDED
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.run import run
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World

PLUG = {
    "entity_name": "plug",
    "model": "box",
    "xacro_arguments": "width:=1.4, length:=0.3",
    "spawn_pose": {"x": 4.2, "y": 2.4},
}


def box(name, x, y, arguments="width:=0.4"):
    return f"spawn_entity('{name}', pose_3d(position_3d({float(x)}m, {float(y)}m)), 'box', '{arguments}')"


def way(recording):
    return np.column_stack([si(recording.columns["x_mm"]), si(recording.columns["y_mm"])])


def place_at(recording, t_s):
    return way(recording)[np.searchsorted(recording.columns["t_ms"], round(t_s * 1000))]


def test_box_without_mass_is_fixed_and_driven_round(staged):
    recording = run(staged(f"spawn_multiple([{box('crate', 2, 1)}])\nrobot.nav_to_pose(near)"), 0)
    assert recording.run.outcome == "succeeded"
    assert recording.run.entities == (Entity("crate", "box", 0.4, 0.4),)
    assert [(e.t_s, e.x_m, e.y_m, e.what) for e in happened(recording, "spawned")] == [(0.2, 2.0, 1.0, "crate")]
    assert happened(recording, "contact", "obstacle_moved") == []
    assert np.abs(way(recording) - [2.0, 1.0]).max(axis=1).min() > 0.3


def test_entities_are_spawned_and_deleted_by_their_names(golden, staged):
    def told(text):
        """Return the end and all that came and went."""
        found = run(staged(text), 0).run
        end = f"{found.simulated_s} s: {found.outcome}" if "nav_to_pose" not in text else found.outcome
        events = [event for event in found.events if event.kind in ("spawned", "deleted")]
        came = [f"{e.t_s} s: {e.kind} {e.what} at {e.x_m}, {e.y_m}" for e in events]
        stood = [f"{each.name}: {each.shape}, {each.length_m} x {each.width_m} m" for each in found.entities]
        return [*came, *stood, f"{end}: {found.reason}" if found.reason else end]

    golden("scenarios", "spawns", told, key="told")


@each_row(("arguments", "gives_way"), [("width:=0.3", False), ("width:=0.3, mass:=2.0", True)])
def test_box_in_front_of_a_robot_is_struck(staged, arguments, gives_way):
    text = f"""
        parallel:
            robot.nav_to_pose(near)
            serial:
                robot.tf_close_to(0.5m, reference_point: position_3d(2.0m, 1.0m))
                spawn_multiple([{box("crate", 1.84, 1, arguments)}])
    """
    scenario = staged(text)
    recording = run(scenario, 0)
    contacts, moved = happened(recording, "contact"), happened(recording, "obstacle_moved")
    assert contacts and {event.what for event in contacts} == {"crate"}
    told = "a contact" if len(contacts) == 1 else f"{len(contacts)} contacts, the first"
    assert recording.run.reason.endswith(f"{told} with crate at {contacts[0].t_s:.1f} s")
    assert bool(moved) == gives_way
    (crate,), (spawned,) = obstacle_tracks_of(situation_of(scenario), recording.run), happened(recording, "spawned")
    t_ms = recording.columns["t_ms"]
    places = crate.at(t_ms)
    assert np.isinf(places[t_ms < spawned.t_s * 1000]).all()
    assert places[-1].tolist() == ([moved[-1].x_m, moved[-1].y_m] if moved else [1.84, 1.0])


def test_deleted_entity_frees_name(staged):
    text = f"""
        spawn_multiple([{box("crate", 2, 3)}])
        delete_entity('crate')
        spawn_multiple([{box("crate", 3, 3, "width:=0.2")}])
        wait elapsed(1s)
    """
    scenario = staged(text)
    recording = run(scenario, 0)
    assert recording.run.outcome == "succeeded"
    first, second = obstacle_tracks_of(situation_of(scenario), recording.run)
    assert (first.obstacle.width_m, second.obstacle.width_m) == (0.4, 0.2)
    assert np.isinf(first.at(np.array([1000]))).all()
    assert second.at(np.array([1000])).tolist() == [[3.0, 3.0]]


def test_scenario_with_an_entity_that_can_not_be_read_can_not_work(staged):
    scenario = staged(f"spawn_multiple([{box('a', 2, 3)}, {box('b', 3, 3, 'breadth:=1')}])")
    with pytest.raises(
        ScenarioError, match=r"entity 2: a box has no argument 'breadth'.*; spawn_multiple at trial\.osc:"
    ):
        run(scenario, 0)


def test_environment_obstacles_exist_from_start_and_can_be_deleted(staged):
    scenario = staged("delete_entity('plug')\nrobot.nav_to_pose(beyond)", obstacles=[PLUG])
    recording = run(scenario, 0)
    assert (recording.run.outcome, recording.run.entities) == ("succeeded", ())
    (plug,) = obstacle_tracks_of(situation_of(scenario), recording.run)
    assert plug.at(np.array([0, 100])).tolist() == [[4.2, 2.4]] * 2
    assert np.isinf(plug.at(np.array([300]))).all()
    stays = run(staged("robot.nav_to_pose(beyond)", obstacles=[PLUG]), 0)
    assert stays.run.outcome != "succeeded"


def test_obstacle_parameters_appear_when_spawned(staged):
    text = """
        crates: list of spawn_entity
        do serial:
            robot.init_nav2(start)
            wait elapsed(1s)
            spawn_multiple(crates)
            wait elapsed(1s)
    """
    scenario = staged(text, crates=[PLUG])
    recording = run(scenario, 0)
    assert situation_of(scenario).obstacles == ()
    assert isinstance(ScenarioObserver(scenario).observed(recording)[0], NoReference)
    assert [event.t_s for event in happened(recording, "spawned")] == [1.2]
    assert recording.run.entities == (Entity("plug", "box", 0.3, 1.4),)


def test_relative_spawn_is_ahead_of_the_robot_and_turned_like_it(staged):
    text = "crate: osc_actor\ndo serial:\n    crate.relative_spawn(distance: 1m, model: 'box')"
    recording = run(staged(text, start_pose={"x": 2.0, "y": 2.0, "yaw": 2.0}), 0)
    (spawned,) = happened(recording, "spawned")
    assert (spawned.x_m, spawned.y_m) == pytest.approx((2 + math.cos(2.0), 2 + math.sin(2.0)), abs=1e-4)
    assert spawned.value == 2.0


def test_lidar_sees_spawned_and_not_deleted_obstacles(staged):
    text = f"spawn_multiple([{box('crate', 2, 1)}])\nwait elapsed(1s)\ndelete_entity('crate')\nwait elapsed(1s)"
    ahead_m = {}

    def look(stack, tick):
        m = stack.m[0]
        forward = int(np.argmax(m["directions"][: m["beams"], 0]))
        ahead_m[tick] = float(m["ranges"][forward]) + float(stack.p[0]["mount_x"])

    run(staged(text), 0, watch=look, watch_ticks=[2, 12, 40])
    assert ahead_m[2] == ahead_m[40] == pytest.approx(3.1, abs=0.15)
    assert ahead_m[12] == pytest.approx(0.8, abs=0.15)


@pytest.mark.parametrize("pushable", [False, True])
def test_robot_is_free_after_touching_obstacle_is_deleted(two_rooms, pushable):
    parameters = NavParameters(controller=Rpp())
    prepared, start = prepare(World(load_map(two_rooms.path)), Lidar(), parameters), Pose(1.0, 1.0)
    loop = ClosedLoop(prepared, parameters, Lidar(), Robot(), start, (), (0, 1, 2), 60.0)
    loop.localize(start)
    loop.navigate(Mission("navigate_to_pose", (Pose(3.0, 1.0),)))
    loop.advance(30)
    loop.spawn(Obstacle("crate", Box(0.3, 0.3), Pose(loop.body.pose[0] + 0.34, 1.0)), pushable)
    loop.advance(36)
    assert [event.kind for event in loop.events][:2] == ["spawned", "contact"]
    assert loop.delete("crate")
    contacts = len(loop.events)
    loop.advance()
    assert (loop.status, len(loop.events)) == (SUCCEEDED, contacts)


def test_tf_close_to_triggers_at_position(staged):
    text = """
        parallel:
            robot.nav_to_pose(near)
            close: robot.tf_close_to(0.7m, reference_point: position_3d(2.5m, 1.0m))
    """
    recording = run(staged(text), 0)
    row = round(ends(recording, "close")[0][0] * 10)
    estimate = si(recording.columns["estimated_x_mm"])[row], si(recording.columns["estimated_y_mm"])[row]
    # Ten looks a second at 0.5 m/s are 5 cm apart.
    assert 0.65 - 0.01 < math.dist(estimate, (2.5, 1.0)) < 0.7 + 0.06


def test_way_of_the_wheels_is_counted_from_where_the_action_begins(staged):
    text = """
        parallel:
            robot.nav_to_pose(near)
            serial:
                wait elapsed(1s)
                driven: robot.odometry_distance_traveled(1m)
    """
    recording = run(staged(text), 0)
    began, ended = place_at(recording, 1.2), place_at(recording, ends(recording, "driven")[0][0])
    assert math.dist(began, ended) == pytest.approx(1.0, abs=0.06)


def test_shipped_scenario_spawns_like_distance_trigger(staged, scenario):
    crate = {**PLUG, "entity_name": "crate", "xacro_arguments": "width:=0.4", "spawn_pose": {"x": 3.0, "y": 2.4}}
    given = {"controller": "rpp", "spawn_trigger_point": {"x": 3.0, "y": 2.4}, "spawn_trigger_threshold": 1.2}
    by_file = run(scenario("obstacle_appears", **given, static_objects=[crate]), 0)
    by_environment = run(scenario(**given, obstacles=[crate]), 0)
    (one,), (other,) = happened(by_file, "spawned"), happened(by_environment, "spawned")
    assert one.what == other.what == "crate"
    assert one.t_s == pytest.approx(other.t_s, abs=0.3)
    assert by_file.run.outcome == by_environment.run.outcome == "succeeded"
