"""Equal scenario, run and seed give equal bytes, whatever ran before."""

import hashlib
import json
import subprocess
import sys
from functools import partial

import numpy as np
import pytest

from vastflow.sim.kernels.streams import LIDAR, run_entropy, streams_of
from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.pose import pose_of
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.run import run
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World

NOISE = {"laserscan_gaussian_noise_std_deviation": 0.05, "laserscan_random_drop_percentage": 0.1}
CRATE = {"entity_name": "crate", "model": "box", "xacro_arguments": "width:=0.6", "spawn_pose": {"x": 2.6, "y": 1.7}}
LATE = {
    "entity_name": "late",
    "model": "box",
    "xacro_arguments": "width:=0.4, mass:=1.0",
    "spawn_pose": {"x": 5.2, "y": 2.7},
    "spawn_trigger": {"point": {"x": 5.2, "y": 2.7}, "threshold": 0.5},
}

IN_A_NEW_PROCESS = """
import hashlib, json, sys
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.digest import FileContent
from vastflow.sim.run import run
from vastflow.sim.model.scenario import Scenario
task = json.load(sys.stdin)
environment = {**task["environment"], "map_file": FileContent(*task["map_file"])}
scenario = Scenario(task["abstract"], task["timeout_s"], environment, task["task"], task["system"])
print(hashlib.sha256(write_recordings([run(scenario, 1, 5)])).hexdigest())
"""


@pytest.fixture(scope="module")
def scenario(scenario):
    """The two rooms' missions with the controller that is quickest to compute."""
    return partial(scenario, controller="rpp")


@pytest.fixture(scope="module")
def noisy(scenario):
    """A fixed crate, and a light box that appears so late that it is struck."""
    return scenario(obstacles=[CRATE, LATE], **NOISE)


@pytest.fixture(scope="module")
def first(noisy):
    """Its first run; all that is repeated meets the physics engine."""
    recording = run(noisy, 1, 5)
    assert {"spawned", "contact", "obstacle_moved"} <= {event.kind for event in recording.run.events}
    assert recording.run.seed == f"5:{int(noisy.situation_digest, 16):x}:1"
    return recording


def test_run_bytes_are_independent_of_previous_runs(noisy, first, scenario, saved):
    other = np.zeros((70, 90), dtype=np.int8)
    other[[0, -1]], other[:, [0, -1]] = 100, 100
    goals = [{"x": 3.0, "y": 2.0}, {"x": 1.0, "y": 2.5}]
    run(scenario("follow_waypoints", map_file=saved(OccupancyMap(other, 0.05, (0.0, 0.0))), goal_poses=goals), 3)
    run(scenario(obstacles=[CRATE], robot_radius=0.3, max_particles=700, **NOISE), 1, 5)
    assert write_recordings([run(noisy, 1, 5)]) == write_recordings([first])


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["rpp", "mppi"])
def test_run_in_a_new_process_is_the_same_bytes(scenario, controller):
    """Cold and warm kernel caches give the same bytes too: the new process loads kernels compiled here."""
    noisy = scenario(obstacles=[CRATE, LATE], controller=controller, **NOISE)
    map_file = noisy.environment["map_file"]
    task = {
        "abstract": noisy.abstract,
        "timeout_s": noisy.timeout_s,
        "environment": {key: value for key, value in noisy.environment.items() if key != "map_file"},
        "map_file": [map_file.path, map_file.digest],
        "task": dict(noisy.task),
        "system": dict(noisy.system),
    }
    found = subprocess.run(
        [sys.executable, "-c", IN_A_NEW_PROCESS],
        input=json.dumps(task),
        capture_output=True,
        text=True,
        timeout=600,
        check=True,
    )
    assert found.stdout.strip() == hashlib.sha256(write_recordings([run(noisy, 1, 5)])).hexdigest()


def first_scan(scenario):
    """Ranges that the robot sees in the first tick, and the states of the random streams after it."""
    start, parameters = pose_of(scenario.task["start_pose"]), parameters_of(scenario.system)
    prepared = prepare(World(load_map(scenario.environment["map_file"].path)), Lidar(), parameters)
    entropy = run_entropy(0, scenario.situation_digest, 1)
    loop = ClosedLoop(prepared, parameters, Lidar(), Robot(), start, (), entropy, 60.0)
    loop.localize(start)
    loop.advance(1)
    streams = loop.stack.m[0]["streams"].copy()
    streams[LIDAR] = loop.stack.noise.memory.stream
    return loop.stack.m[0]["ranges"][:360].copy(), streams


def test_noise_depends_on_the_situation_and_not_on_the_system(scenario):
    one, other = scenario(**NOISE), scenario(robot_radius=0.3, inflation_radius=0.5, max_particles=700, **NOISE)
    elsewhere = scenario(goal_pose={"x": 6.0, "y": 4.0}, **NOISE)
    assert one.digest != other.digest
    np.testing.assert_array_equal(first_scan(one)[0], first_scan(other)[0])
    assert (first_scan(one)[0] != first_scan(elsewhere)[0]).any()


def test_lidar_and_amcl_draw_from_streams_of_their_own(scenario):
    noisy = scenario(**NOISE)
    before = streams_of(run_entropy(0, noisy.situation_digest, 1))
    after, fewer_particles = first_scan(noisy)[1], first_scan(scenario(max_particles=700, **NOISE))[1]
    assert (after[LIDAR] != before[LIDAR]).all()
    assert (first_scan(scenario())[1][LIDAR] == before[LIDAR]).all()
    assert (after[0] == fewer_particles[0]).all()
    assert (after[1] != fewer_particles[1]).all()
