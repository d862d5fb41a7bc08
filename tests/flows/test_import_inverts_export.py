"""A run that was exported as a bag and imported again: poses, scans, and verdicts."""

import re
from dataclasses import dataclass, field, replace

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


START, GOAL = pose(1.5, 1.2), pose(6.0, 4.5)
NOISE = {"laserscan_gaussian_noise_std_deviation": 0.02, "laserscan_random_drop_percentage": 0.1}
CART = {
    "name": "cart",
    "shape": {"length_m": 0.6, "width_m": 0.4},
    "waypoints": [[5.0, 5.5], [4.5, 1.5]],
    "speed_m_s": 0.8,
    "loop": "back_and_forth",
}
RAM = {
    "name": "ram",
    "shape": {"radius_m": 0.3},
    "waypoints": [[6.0, 4.5], [1.5, 1.2]],
    "speed_m_s": 2.0,
    "loop": "once",
}


@dataclass(frozen=True)
class Kind:
    """A kind of run: what differs from a drive to one goal."""

    expected: tuple[str, ...] = ("succeeded",)
    timeout_s: float = 60.0
    environment: dict = field(default_factory=dict)
    task: dict = field(default_factory=lambda: {"goal_pose": GOAL})
    system: dict = field(default_factory=dict)
    scenario: str = "navigate_to_pose"


KINDS = {
    "succeeds": Kind(),
    "times out": Kind(("timed_out",), timeout_s=6.0),
    "has no path": Kind(("aborted",), task={"goal_pose": pose(20.0, 20.0)}),
    "passes a cart": Kind(environment={"movers": [CART]}),
    "is hit": Kind(("contact",), environment={"movers": [RAM]}),
    "drops beams": Kind(
        system={"laserscan_gaussian_noise_std_deviation": 0.05, "laserscan_random_drop_percentage": 0.5}
    ),
    "goes through poses": Kind(
        task={"goal_poses": [pose(4.0, 1.5), pose(6.8, 2.0), GOAL]}, scenario="navigate_through_poses"
    ),
}


@pytest.fixture(scope="module", params=KINDS)
def exported(request, tmp_path_factory):
    """A scenario, its recording, its scans by time, and its bag."""
    kind = KINDS[request.param]
    folder = tmp_path_factory.mktemp("exported")
    environment = {"map_file": map_content(drawn_map(folder / "map")), **kind.environment}
    task = {"start_pose": START, **kind.task}
    scenario = Scenario(f"builtin:{kind.scenario}", kind.timeout_s, environment, task, NOISE | kind.system)
    scans: list[np.ndarray] = []

    def watch(stack: Stack, tick: int) -> None:
        m = stack.m[0]
        ranges = m["ranges"][: m["beams"]].copy()
        if not scans or not np.array_equal(scans[-1], ranges):
            scans.append(ranges)

    recording = run(scenario, 0, 0, watch, range(1200))
    happened = {recording.run.outcome, *(event.kind for event in recording.run.events)}
    assert {*kind.expected} <= happened, happened
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
    # A bag tells no mover's pose but as a marker, which is not read.
    told = {name: imported[name] for name in recorded if not name.startswith(("covariance_", "mover_"))}
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
    # The scenario of an import has no movers, so that distances to them are not judged.
    still = {name: value for name, value in scenario.environment.items() if name != "movers"}
    scenario = replace(scenario, environment=still)
    own = {name: column for name, column in recording.columns.items() if not name.startswith("mover_")}
    said = []
    for each in (replace(recording, columns=own), back[1]):
        block = write_recordings([each])
        said.append(judge_block(scenario, block, observe_block(scenario, block), oracles_of(ORACLES)).verdicts)
    for ours, theirs in zip(*said, strict=True):
        # Markers of contacts don't say with what.
        reason = re.sub("'(cart|ram)'", "'something'", ours.reason)
        assert (ours.oracle, ours.judgment, reason) == (theirs.oracle, theirs.judgment, theirs.reason)
        for name, metric in ours.metrics.items():
            # A bag tells no tick of the goal: it is the end of the run, at most a row later.
            off = 0.11 if name == "time_to_goal" else 0.005
            value = None if metric.value is None else pytest.approx(metric.value, abs=off)
            assert theirs.metrics[name].value == value, (ours.oracle, name)
