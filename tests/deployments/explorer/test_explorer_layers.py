"""Layers of runs against replays of them; what is refused; what is kept."""

import asyncio
import gzip
import time
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from starlette.exceptions import HTTPException
from synthetic import walled_room, write_map
from unpacked import unpacked

from vastflow.deployments.explorer import run_page
from vastflow.deployments.explorer.layers import Parts, Watched, layers_of
from vastflow.deployments.explorer.run_page import KeptExecutions
from vastflow.oracles.replay.recorded import RecordedRun
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.sim.model.nodes import Nodes
from vastflow.sim.model.scenario import ProcessSetup, Scenario
from vastflow.sim.replay import Box, replay
from vastflow.sim.world.world import map_content
from vastflow.tasks.engine.executor import WorkerDied

METADATA = {
    "source": {"execute": "another"},
    "numeric_class": "another",
    "versions": {},
    "vastflow": "0.1.0",
    "host": {},
}
HERE = Box(-3.0, -3.0, 7.0, 7.0)
"""The part of the global costmap around the start, (1, 2) rounded to steps of 2 m."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> RecordedRun:
    """Three seconds of a run past a box."""
    room = map_content(write_map(tmp_path_factory.mktemp("room"), walled_room(6.0, 4.0)))
    box = {"entity_name": "carton", "spawn_pose": {"x": 3.0, "y": 2.4, "yaw": 0.3}}
    task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
    noise = {"laserscan_gaussian_noise_std_deviation": 0.02}
    scenario = Scenario("builtin:navigate_to_pose", 3.0, {"map_file": room, "boxes": [box]}, task, noise)
    recording = replay(scenario, 2, 7, {}).recording
    return RecordedRun("office-1", scenario, recording, 7, "fail", METADATA)


@pytest.fixture(scope="module")
def layers(recorded: RecordedRun):
    return unpacked(layers_of(recorded))


def test_layers_of_equal_run_name_no_difference_and_have_all_moments(layers):
    header, arrays = layers
    assert (header["sentence"], header["every_s"]) == ("", 0.1)
    assert header["note"] == "The layers have a moment every 0.1 s, and the global costmap 10 m round the robot."
    assert len(arrays["scan spans"]) == len(arrays["global places"]) == 30
    assert [kind for _, _, kind in header["activities"]][:2] == ["resting", "following"]
    assert header["activities"][-1][1] == pytest.approx(3.0)


def test_layers_hold_points_of_snapshots_to_the_millimeter(recorded: RecordedRun, layers):
    _, arrays = layers
    moment = 12
    (snapshot,) = replay(recorded.scenario, 2, 7, {2 * moment: HERE}).snapshots
    expected = {
        "plan": snapshot.plan_xy_m,
        "scan": snapshot.scan_xy_m,
        "horizon": snapshot.intended_xy_m,
        "particles": snapshot.particles[:, :2],
    }
    for name, xy_m in expected.items():
        first, end = arrays[f"{name} spans"][moment]
        assert len(xy_m) > 10
        found = arrays[f"{name} points"][first:end] * 1e-3
        np.testing.assert_allclose(found, xy_m, atol=0.0006)


def test_layers_hold_costs_of_snapshots(recorded: RecordedRun, layers):
    _, arrays = layers
    moment = 12
    (snapshot,) = replay(recorded.scenario, 2, 7, {2 * moment: HERE}).snapshots
    assert snapshot.local_costs is not None
    for name, patch in (("global", snapshot.global_costs), ("local", snapshot.local_costs)):
        first, rows, columns = arrays[f"{name} spans"][moment]
        found = arrays[f"{name} cells"][first : first + rows * columns].reshape(rows, columns)
        np.testing.assert_array_equal(found, patch.costs)
        corner = patch.corner
        expected = (corner.x_m, corner.y_m, corner.yaw_rad, patch.resolution_m)
        np.testing.assert_allclose(arrays[f"{name} places"][moment], expected, atol=1e-6)


def test_layers_of_long_runs_have_fewer_moments():
    assert [Watched(100_000, t_s).every for t_s in (0.0, 120.0, 300.0, 301.0, 3000.0)] == [2, 2, 2, 3, 20]


def test_layers_of_another_run_say_how_it_differs(recorded: RecordedRun):
    columns = {**recorded.recording.columns, "x_mm": recorded.recording.columns["x_mm"] + 1}
    other = replace(recorded, recording=replace(recorded.recording, columns=columns))
    header, _ = unpacked(layers_of(other))
    assert header["sentence"].startswith("The layers are not those of the recorded run")
    assert "row 0 (0.00 s), x_mm: recorded 1001, executed 1000" in header["sentence"]
    assert "recorded with other source of the simulator" in header["sentence"]


def test_layers_are_refused_without_robot_or_with_programs(recorded: RecordedRun):
    still = replace(recorded, recording=replace(recorded.recording, columns={}))
    with pytest.raises(UnusableDirectory, match="no robot"):
        layers_of(still)
    for setup, why in (
        (ProcessSetup(), "programs would be started again"),
        (ProcessSetup(nodes=Nodes()), "Nodes of ROS 2 drove the run"),
    ):
        programs = replace(recorded, scenario=replace(recorded.scenario, programs=setup))
        with pytest.raises(UnusableDirectory, match=why):
            layers_of(programs)


def test_parts_share_ends_of_parts_before():
    parts = Parts(np.empty((0, 2)))
    path = np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 0.5), (3.0, 0.5)])
    for part in (path, path[1:], path[1:], path[:0], path):
        parts.add(part)
    assert parts.spans.tolist() == [[0, 4], [1, 4], [1, 4], [4, 4], [4, 8]]
    np.testing.assert_array_equal(parts.whole[:4], path)


class SlowPool:
    """A pool whose units end when the test says so."""

    def __init__(self, asked, workers):
        assert workers == 1
        self.asked, self.closed = asked, False

    def submit(self, function, directory, configuration, run_index, consent, priority):
        self.asked[configuration, run_index] = self, (done := Future())
        if configuration == "broken":
            done.set_exception(WorkerDied("the worker process died 3 times"))
        elif configuration != "slow":
            done.set_result(gzip.compress(bytes(30), 1))
        return done

    def close(self):
        self.closed = True


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch):
    """Kept layers, and what was executed: configuration and run to pool and future."""
    asked = {}
    monkeypatch.setattr(run_page, "Pool", lambda workers: SlowPool(asked, workers))
    monkeypatch.setattr(run_page, "LOOK_S", 0.01)
    return KeptExecutions(), asked


async def stays():
    return False


async def leaves():
    return True


async def turns(n=20):
    for _ in range(n):
        await asyncio.sleep(0)


def test_kept_layers_execute_a_run_once(kept, tmp_path: Path):
    layers, executed = kept

    async def asked():
        first, again = [await layers.result((tmp_path, "a", 0), stays) for _ in range(2)]
        assert (first, list(executed)) == (again, [("a", 0)])
        for run in range(1, 10):
            await layers.result((tmp_path, "a", run), stays)
        executed.clear()
        await layers.result((tmp_path, "a", 9), stays)
        await layers.result((tmp_path, "a", 0), stays)  # which was forgotten
        assert list(executed) == [("a", 0)]

    asyncio.run(asked())


def test_kept_layers_ask_again_after_an_error(kept, tmp_path: Path):
    layers, executed = kept

    async def asked():
        for _ in range(2):
            executed.clear()
            with pytest.raises(WorkerDied, match="the worker process died 3 times"):
                await layers.result((tmp_path, "broken", 0), stays)
            assert list(executed) == [("broken", 0)]

    asyncio.run(asked())


def test_server_executes_two_runs_at_once_and_forgets_no_waiting_run(kept, tmp_path: Path):
    layers, executed = kept

    async def asked():
        waiting = [asyncio.create_task(layers.result((tmp_path, "slow", run), stays)) for run in range(20)]
        await turns()
        for run in range(20):
            await turns()
            assert len(executed) == min(run + 2, 20)
            executed["slow", run][1].set_result(str(run).encode())
            await asyncio.wait({waiting[run]}, timeout=60)
        assert [await each for each in waiting] == [str(run).encode() for run in range(20)]

    asyncio.run(asked())


def test_300_clients_that_left_delay_nobody(kept, tmp_path: Path):
    layers, executed = kept

    async def asked():
        waiting = [asyncio.create_task(layers.result((tmp_path, "slow", run), leaves)) for run in range(300)]
        await asyncio.wait(waiting, timeout=60)
        assert {type(each.exception()) for each in waiting} == {HTTPException}
        await turns()
        # Ends of clients are looked for from time to time, so that more than the first two may have had a turn.
        assert list(executed)[:2] == [("slow", 0), ("slow", 1)] and len(executed) < 30
        assert len(await asyncio.wait_for(layers.result((tmp_path, "a", 0), stays), 60)) > 0

    asyncio.run(asked())
    for pool in {pool for (configuration, _), (pool, _) in executed.items() if configuration == "slow"}:
        deadline_s = time.monotonic() + 60
        while not pool.closed and time.monotonic() < deadline_s:
            time.sleep(0.01)
        assert pool.closed  # what nobody waits for is ended


def test_execution_goes_on_while_one_of_its_clients_waits(kept, tmp_path: Path):
    layers, executed = kept

    async def asked():
        left = asyncio.create_task(layers.result((tmp_path, "slow", 0), leaves))
        stayed = asyncio.create_task(layers.result((tmp_path, "slow", 0), stays))
        await asyncio.wait({left}, timeout=60)
        executed["slow", 0][1].set_result(b"whole")
        assert (await stayed, type(left.exception())) == (b"whole", HTTPException)

    asyncio.run(asked())
