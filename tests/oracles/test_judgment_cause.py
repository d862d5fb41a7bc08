"""Causes of failed runs that are built to have one."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.evidence.causes import causes_of
from vastflow.oracles.judgment.cause import cause_of
from vastflow.oracles.judgment.judge import judge_block
from vastflow.oracles.judgment.registry import oracles_of
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.observation.observe import observe_block
from vastflow.oracles.observation.trace import NoReference, Trace
from vastflow.oracles.page.report import write_report
from vastflow.oracles.results.tables import read_tables
from vastflow.sim.loop.standstill import STOOD_STILL
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.recording import Event, Run
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.run import run as simulated
from vastflow.sim.world.world import map_content

START, GOAL = (1.0, 2.0), (9.0, 2.0)
ALONG = [(1.0 + 0.05 * k, 2.0) for k in range(161)]
"""From the start to the goal at 0.5 m/s."""
HALF = ALONG[:80]


@pytest.fixture
def room(tmp_path, build):
    return build.write_map(tmp_path / "room", build.walled_room(10.0, 4.0))


@pytest.fixture
def judged(room, build):
    """The cause of one recording of a robot in a room, judged by `success` and the oracles that are named."""

    def cause(recording, *oracles, obstacles=()):
        scenario = scenario_in(room, START, GOAL, obstacles)
        return causes_in(scenario, recording, [(name, {}) for name in oracles]).get(0)

    return cause


def scenario_in(room, start, goal, obstacles=(), system=(), timeout_s=60.0):
    environment = {"map_file": map_content(room), "static_objects": list(obstacles)}
    ends = (("start_pose", start), ("goal_pose", goal))
    poses = {name: {"position": {"x": x, "y": y}, "orientation": {"yaw": 0.0}} for name, (x, y) in ends}
    return Scenario("builtin:navigate_to_pose", timeout_s, environment, poses, dict(system))


def causes_in(scenario, recording, oracles):
    block = write_recordings([recording])
    return dict(judge_block(scenario, block, observe_block(scenario, block), oracles_of(oracles)).causes)


def stopping(recording, outcome="aborted", error_code=105):
    """The recording as that of a failed mission."""
    return replace(recording, run=replace(recording.run, outcome=outcome, error_code=error_code, recoveries=0))


def at_end(kind, what, t_s=7.9, x_m=4.95):
    return Event(t_s, kind, x_m, 2.0, what)


def jumping(build, jump_m, failed_s=5.2):
    recording = build.a_recording(ALONG[:53], events=(at_end("control_failed", "103", failed_s, 3.6),))
    recording.columns["estimated_y_mm"][50:] += round(1000 * jump_m)
    return stopping(recording, error_code=103)


def detour():
    """A path far off the reference."""
    corners = [(1.0, 2.0), (1.0, 3.9), (5.0, 3.9), (9.0, 3.9), (9.0, 0.2), (1.0, 0.2), (9.0, 0.3), (9.0, 2.0)]
    return [tuple(point) for a, b in itertools.pairwise(corners) for point in np.linspace(a, b, 40)]


CONTACT, SPIN, JUMPED = at_end("contact", "wall"), at_end("recovery", "spin"), at_end("control_failed", "103")
RECOVERIES = tuple(at_end("recovery", what, t_s) for what, t_s in (("spin", 3.0), ("wait", 6.0)))
STOOD = (Event(0.0, STOOD_STILL, *START, "no command"),)
LOST = {"error_xy_m": (0.0, 0.8)}
SLOW = [START] * 10 + [(1.0 + 0.01 * k, 2.0) for k in range(600)]
MISSED = {"events": (at_end("recovery", "spin", 3.0, 2.5), at_end("goal_missed", "0", 4.0, 3.0)), "missed_goals": 1}


@each_row(
    ("path", "given", "ending", "oracles", "box", "cause"),
    [
        # Passed runs have no cause, whatever happened in them.
        (ALONG, {"events": (CONTACT, SPIN, JUMPED)}, None, ["performance", "safety"], None, None),
        ([START] * 80, {"events": STOOD}, {}, ["performance"], None, "stood still"),
        (HALF, LOST, {}, [], None, "lost"),
        (ALONG, LOST, None, ["robustness"], None, "lost"),
        (HALF, {"events": (CONTACT,)}, {}, [], None, "contact"),
        (HALF, {"events": (at_end("contact", "wall", 2.0, 2.0),)}, {}, [], None, "unknown"),  # left behind
        (ALONG, {"events": (at_end("contact", "box_5_2.4"),)}, None, ["safety"], (5.0, 2.4), "contact"),
        (ALONG, {}, None, ["safety"], (5.0, 2.5), "too close"),
        # The robot ends at 4.95 m, 0.4 m from the face of a box.
        (HALF, {}, {}, [], (5.6, 2.0), "blocked by an obstacle"),
        (HALF, {}, {}, [], (1.0, 3.5), "unknown"),
        (HALF, {}, {"error_code": 208}, [], (7.0, 2.0), "blocked by an obstacle"),
        (HALF, {}, {"error_code": 208}, [], None, "no path"),
        (HALF, {"events": RECOVERIES}, {"outcome": "timed_out"}, [], None, "timed out recovering"),
        (HALF, {"events": RECOVERIES}, {}, [], None, "gave up recovering"),
        (SLOW, {"events": (at_end("recovery", "spin", 2.0, 1.1),)}, {"outcome": "timed_out"}, [], None, "unknown"),
        (detour(), {}, None, ["performance"], None, "left the path"),
        # A goal that was given up is judged by where that was.
        (ALONG, MISSED, None, [], (3.6, 2.0), "blocked by an obstacle"),
        (ALONG, MISSED, None, [], None, "gave up recovering"),
        (HALF, {}, {}, [], None, "unknown"),
        # The first cause in order of precedence counts.
        (HALF, {**LOST, "events": (CONTACT, SPIN)}, {}, ["safety", "performance"], (5.6, 2.0), "lost"),
        (HALF, {"events": (CONTACT, SPIN)}, {}, ["safety", "performance"], (5.6, 2.0), "contact"),
        (HALF, {"events": (SPIN,)}, {}, ["safety", "performance"], (5.6, 2.0), "blocked by an obstacle"),
    ],
)
def test_cause_of_failure_is_found(judged, build, path, given, ending, oracles, box, cause):
    recording = build.a_recording(path, **given)
    recording = recording if ending is None else stopping(recording, **ending)
    assert judged(recording, *oracles, obstacles=[] if box is None else [build.box_at(*box)]) == cause


def test_cause_of_wrong_estimates_depends_on_time(judged, build):
    assert judged(jumping(build, 1.6)) == "jump of the estimate"
    assert judged(jumping(build, 0.3)) == "unknown"
    assert judged(jumping(build, 1.6, failed_s=3.0)) == "lost"
    recording = build.a_recording(ALONG)
    recording.columns["estimated_y_mm"][40:60] += 700
    assert judged(recording, "robustness") == "mislocalized"
    trace = Trace(Run(0, "0", "timed_out", 0, "", 1.0, 0.0, 0, 0), {}, NoReference("no map"))
    assert cause_of(trace, [Verdict("success", 0, "not judged", "fault")]) is None


@pytest.fixture(scope="module")
def driven(tmp_path_factory, build):
    """A function that simulates a run in a room of 10 m × 4 m and finds its cause."""
    free, divided = build.walled_room(10.0, 4.0), build.walled_room(10.0, 4.0)
    divided[:, 98:102] = 100
    divided[36:44, 98:102] = 0
    maps = {
        name: build.write_map(tmp_path_factory.mktemp(name), cells)
        for name, cells in (("free", free), ("divided", divided))
    }

    def causes(system=(), oracles=(), obstacles=(), *, room="free", start=(1.0, 2.0), timeout_s=60.0):
        system = {"controller": "rpp", **dict(system)}
        scenario = scenario_in(maps[room], start, (8.0, 2.0), obstacles, system, timeout_s)
        return causes_in(scenario, simulated(scenario, 0), oracles)

    return causes


BLIND, NOISY = {"laserscan_random_drop_percentage": 1.0}, {"laserscan_gaussian_noise_std_deviation": 2.0}
SAFETY = ("safety", {})


def test_simulated_runs_fail_of_planted_causes(driven, build):
    assert driven(oracles=[SAFETY, ("performance", {}), ("robustness", {})]) == {}
    planted = {
        "stood still": driven({"robot_radius": 0.3}, start=(1.0, 0.32)),  # scan points of the wall in the footprint
        "lost": driven(BLIND, [("robustness", {})]),  # no scan, so no correction of odometry
        "contact": driven(BLIND, [SAFETY], [build.box_at(2.0, 2.0)]),  # a box that it can't see
        "blocked by an obstacle": driven(obstacles=[build.box_at(3.0, 0.25 + 0.5 * k) for k in range(8)]),
        "no path to the goal": driven(room="divided"),  # a door that is narrower than the robot
        "timed out recovering": driven(NOISY, timeout_s=20.0),  # points everywhere, and no time to give up
        "gave up recovering": driven(NOISY),
        "too close": driven(oracles=[("safety", {"max_deceleration_mps2": 0.1})], obstacles=[build.box_at(4.5, 2.9)]),
        "mislocalized": driven({**NOISY, "laserscan_gaussian_noise_std_deviation": 0.1}, [("robustness", {"threshold_m": 0.05})]),
    }  # fmt: skip
    assert planted == {cause: {0: cause} for cause in planted}


def test_evidence_and_report_show_causes_with_example(synthetic_campaign, room, build):
    task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 9.0, "y": 2.0}}
    lost = [stopping(build.a_recording(HALF, run_index=k, error_xy_m=(0.0, 0.8))) for k in (1, 2)]
    fine = build.a_recording(ALONG)
    synthetic_campaign.add("a-1", "a", room, task, recordings=[fine, lost[0]])
    synthetic_campaign.add("a-2", "a", room, task, recordings=[fine, *lost])
    synthetic_campaign.add("a-3", "a", room, task, recordings=[stopping(build.a_recording(HALF))])
    directory = synthetic_campaign.write()
    tables = read_tables(directory)
    found = causes_of(tables)
    assert [(each.cause, each.runs, each.configurations) for each in found] == [("lost", 3, 2), ("unknown", 1, 1)]
    assert causes_of(replace(tables, runs=tables.runs.drop_columns(["cause"]))) == ()  # of an earlier version
    write_report(directory)
    assert "vastflow replay . a-2 1" in (directory / "report.html").read_text(encoding="utf-8")
