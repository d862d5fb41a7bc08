"""A run that was exported as a bag and imported again: poses, scans, and verdicts."""

import numpy as np
import pytest
from real_bags import drawn_map

from vastflow.flows.bags.bag import read_bag
from vastflow.flows.bags.drive import clock_of, drive_of
from vastflow.flows.bags.recorded import recording_of
from vastflow.flows.export.mcap.mcap import bag_of
from vastflow.oracles.judgment.judge import judge_block
from vastflow.oracles.judgment.registry import oracles_of
from vastflow.oracles.observation.observe import observe_block
from vastflow.oracles.replay.recorded import RecordedRun
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.navigator.state import Stack
from vastflow.sim.run import run
from vastflow.sim.world.world import map_content

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
ORACLES = [("performance", {}), ("safety", {"fail_on_contact": "any"}), ("robustness", {}), ("navigation", {})]
METADATA = {"name": "room", "vastflow": "0", "created": "", "versions": {}, "host": {}}


def pose(x, y, yaw=0.0):
    return {"position": {"x": x, "y": y}, "orientation": {"yaw": yaw}}


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A scenario, its recording, its scans by time, and its bag."""
    folder = tmp_path_factory.mktemp("exported")
    task = {"start_pose": pose(1.5, 1.2), "goal_pose": pose(6.0, 4.5)}
    system = {"laserscan_gaussian_noise_std_deviation": 0.02, "laserscan_random_drop_percentage": 0.1}
    content = map_content(drawn_map(folder / "map"))
    scenario = Scenario("builtin:navigate_to_pose", 60.0, {"map_file": content}, task, system)
    scans: list[np.ndarray] = []

    def watch(stack: Stack, tick: int) -> None:
        m = stack.m[0]
        ranges = m["ranges"][: m["beams"]].copy()
        if not scans or not np.array_equal(scans[-1], ranges):
            scans.append(ranges)

    recording = run(scenario, 0, 0, watch, range(1200))
    files = bag_of(RecordedRun("room", scenario, recording, 0, "pass", METADATA))
    (folder / "bag").mkdir()
    for name, raw in files.items():
        (folder / "bag" / name).write_bytes(raw)
    return scenario, recording, scans, folder / "bag"


@pytest.fixture(scope="module")
def back(exported):
    bag = read_bag(exported[3], scans=True)
    clock, notes = clock_of(bag)
    drive = drive_of(bag, clock)
    return bag, recording_of(bag, clock, drive), notes


def test_import_gives_the_poses_of_an_exported_run(exported, back):
    recorded, imported = exported[1].columns, back[1].columns
    told = {name: imported[name] for name in recorded if not name.startswith("covariance_")}
    assert imported.keys() == told.keys()
    for name, column in told.items():
        assert column.shape == recorded[name].shape, name
        assert np.abs(recorded[name] - column).max() <= 1, name


def test_import_gives_the_scans_of_an_exported_run(exported, back):
    scans, ranges = np.array(exported[2]), back[0].ranges_m
    returned = np.isfinite(ranges)
    assert returned.any() and not returned.all()
    np.testing.assert_allclose(ranges, scans, rtol=0.0, atol=1e-5)


def test_import_gives_the_verdicts_of_an_exported_run(exported, back):
    scenario, recording = exported[:2]
    said = []
    for each in (recording, back[1]):
        block = write_recordings([each])
        said.append(judge_block(scenario, block, observe_block(scenario, block), oracles_of(ORACLES)).verdicts)
    for ours, theirs in zip(*said, strict=True):
        assert (ours.oracle, ours.judgment, ours.reason) == (theirs.oracle, theirs.judgment, theirs.reason)
        for name, metric in ours.metrics.items():
            # A bag tells no tick of the goal: it is the end of the run, at most a row later.
            off = 0.11 if name == "time_to_goal" else 0.002
            value = None if metric.value is None else pytest.approx(metric.value, abs=off)
            assert theirs.metrics[name].value == value, (ours.oracle, name)
