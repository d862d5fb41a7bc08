"""Why runs failed: runs that are built so that one cause is the true one."""

import itertools
import json

import numpy as np
import pytest

from vastflow.oracles.evidence.causes import causes_of
from vastflow.oracles.judgement.cause import CAUSES, cause_of
from vastflow.oracles.judgement.judge import judge_block
from vastflow.oracles.judgement.oracle import oracles_of
from vastflow.oracles.judgement.verdict import Verdict
from vastflow.oracles.observation.observe import observe_block
from vastflow.oracles.observation.trace import NoReference, Trace
from vastflow.oracles.page.report import write_report
from vastflow.oracles.results.tables import read_tables
from vastflow.sim.loop.standstill import STOOD_STILL
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.recording import Event, Run
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.run import run as simulated
from vastflow.sim.world.map_file import load_map, map_content

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
        environment = {"map_file": FileContent(str(room), load_map(room).digest), "static_objects": list(obstacles)}
        poses = {
            f"{end}_pose": {"position": {"x": x, "y": y}, "orientation": {"yaw": 0.0}}
            for end, (x, y) in (("start", START), ("goal", GOAL))
        }
        scenario = Scenario("builtin:navigate_to_pose", 60.0, environment, poses, {})
        block = write_recordings([recording])
        requests = [(name, {}) for name in oracles]
        return judge_block(scenario, block, observe_block(scenario, block), oracles_of(requests)).causes.get(0)

    return cause


def stopping(recording, outcome="aborted", error_code=105, recoveries=0):
    """The recording of a mission that failed."""
    changed = {"outcome": outcome, "error_code": error_code, "recoveries": recoveries}
    return recording.__class__(Run(**{**_row(recording.run), **changed}), recording.columns)


def _row(run):
    return {name: getattr(run, name) for name in run.__dataclass_fields__}


def at_end(kind, what, t_s=7.9, x_m=4.95):
    return Event(t_s, kind, x_m, 2.0, what)


def test_passed_run_has_no_cause_whatever_happened_in_it(judged, build):
    events = (at_end("contact", "wall"), at_end("recovery", "spin"), at_end("control_failed", "103"))
    assert judged(build.a_recording(ALONG, events=events), "performance", "safety") is None


def test_run_that_nobody_judged_has_no_cause():
    trace = Trace(Run(0, "0", "timed_out", 0, "", 1.0, 0.0, 0, 0), {}, NoReference("no map"))
    assert cause_of(trace, [Verdict("success", 0, "not judged", "fault")]) is None


def test_robot_that_was_sent_and_never_moved_stood_still(judged, build):
    recording = build.a_recording([START] * 80, events=(Event(0.0, STOOD_STILL, *START, "no command"),))
    assert judged(stopping(recording), "performance") == "stood still"


def jumping(build, jump_m, failed_s=5.2):
    recording = build.a_recording(ALONG[:53], events=(at_end("control_failed", "103", failed_s, 3.6),))
    estimated = recording.columns["estimated_y_mm"].copy()
    estimated[50:] += round(1000 * jump_m)
    return stopping(
        recording.__class__(recording.run, {**recording.columns, "estimated_y_mm": estimated}), error_code=103
    )


def test_invalid_path_right_after_a_jump_of_the_estimate_is_its_doing(judged, build):
    assert judged(jumping(build, 1.6)) == "jump of the estimate"


def test_invalid_path_without_a_jump_or_long_after_one_is_not(judged, build):
    assert judged(jumping(build, 0.3)) == "unknown"
    assert judged(jumping(build, 1.6, failed_s=3.0)) == "lost"


def test_robot_that_is_not_where_it_believes_to_be_at_the_end_is_lost(judged, build):
    assert judged(stopping(build.a_recording(HALF, error_xy_m=(0.0, 0.8)))) == "lost"


def test_robot_that_arrives_where_it_believes_the_goal_to_be_is_lost_if_an_oracle_fails_it(judged, build):
    assert judged(build.a_recording(ALONG, error_xy_m=(0.0, 0.8)), "robustness") == "lost"


def test_estimate_that_was_wrong_under_way_and_right_in_the_end_is_mislocalized(judged, build):
    recording = build.a_recording(ALONG)
    recording.columns["estimated_y_mm"][40:60] += 700
    assert judged(recording, "robustness") == "mislocalized"


def test_robot_that_touches_the_wall_where_it_ends_failed_by_contact(judged, build):
    assert judged(stopping(build.a_recording(HALF, events=(at_end("contact", "wall"),)))) == "contact"


def test_contact_that_the_robot_left_behind_is_not_why_its_mission_failed(judged, build):
    passed_by = build.a_recording(HALF, events=(at_end("contact", "wall", 2.0, 2.0),))
    assert judged(stopping(passed_by)) == "unknown"


def test_contact_that_safety_fails_is_the_cause_although_the_mission_succeeded(judged, build):
    box = build.box_at(5.0, 2.4)
    assert (
        judged(build.a_recording(ALONG, events=(at_end("contact", box["entity_name"]),)), "safety", obstacles=[box])
        == "contact"
    )


def test_robot_that_passes_a_box_nearer_than_it_could_stop_is_too_close(judged, build):
    assert judged(build.a_recording(ALONG), "safety", obstacles=[build.box_at(5.0, 2.5)]) == "too close"


def test_mission_that_ends_before_a_box_that_is_not_on_the_map_is_blocked_by_it(judged, build):
    box = build.box_at(5.6, 2.0)  # the robot ends at 4.95 m, 0.4 m from its face
    assert judged(stopping(build.a_recording(HALF)), obstacles=[box]) == "blocked by an obstacle"


def test_mission_that_ends_far_from_every_box_is_not_blocked_by_one(judged, build):
    assert judged(stopping(build.a_recording(HALF)), obstacles=[build.box_at(1.0, 3.5)]) == "unknown"


def test_box_in_sight_blocks_where_there_is_no_path_and_a_map_alone_has_no_path(judged, build):
    recording = stopping(build.a_recording(HALF), error_code=208)
    assert judged(recording, obstacles=[build.box_at(7.0, 2.0)]) == "blocked by an obstacle"
    assert judged(recording) == "no path"


@pytest.mark.parametrize(
    ("outcome", "cause"), [("timed_out", "timed out recovering"), ("aborted", "gave up recovering")]
)
def test_mission_that_ends_among_recoveries_ended_recovering(judged, build, outcome, cause):
    events = tuple(at_end("recovery", what, t_s) for what, t_s in (("spin", 3.0), ("wait", 6.0)))
    assert judged(stopping(build.a_recording(HALF, events=events), outcome)) == cause


def test_recovery_long_before_the_end_is_not_why_the_time_ran_out(judged, build):
    long = [START] * 10 + [(1.0 + 0.01 * k, 2.0) for k in range(600)]
    recording = build.a_recording(long, events=(at_end("recovery", "spin", 2.0, 1.1),))
    assert judged(stopping(recording, "timed_out")) == "unknown"


def test_robot_that_takes_a_way_of_its_own_left_the_path(judged, build):
    detour = [(1.0, 2.0), (1.0, 3.9), (5.0, 3.9), (9.0, 3.9), (9.0, 0.2), (1.0, 0.2), (9.0, 0.3), (9.0, 2.0)]
    along = [tuple(point) for a, b in itertools.pairwise(detour) for point in np.linspace(a, b, 40)]
    assert judged(build.a_recording(along), "performance") == "left the path"


def test_goal_that_was_given_up_is_judged_by_where_that_was(judged, build):
    missed = build.a_recording(
        ALONG, events=(at_end("recovery", "spin", 3.0, 2.5), at_end("goal_missed", "0", 4.0, 3.0)), missed_goals=1
    )
    assert judged(missed, obstacles=[build.box_at(3.6, 2.0)]) == "blocked by an obstacle"
    assert judged(missed) == "gave up recovering"


def test_what_nothing_explains_is_unknown_and_counted(judged, build):
    assert judged(stopping(build.a_recording(HALF))) == "unknown"


def test_of_several_causes_the_first_of_the_stated_order_is_the_runs(judged, build):
    events = (at_end("contact", "wall"), at_end("recovery", "spin"))
    lost = build.a_recording(HALF, error_xy_m=(0.0, 0.8), events=events)
    here = build.a_recording(HALF, events=events)
    away = build.a_recording(HALF, events=events[1:])
    box = [build.box_at(5.6, 2.0)]
    found = [judged(stopping(each), "safety", "performance", obstacles=box) for each in (lost, here, away)]
    assert found == ["lost", "contact", "blocked by an obstacle"]
    assert found == [cause for cause in CAUSES if cause in found]


@pytest.fixture(scope="module")
def driven(tmp_path_factory, build):
    """The causes of a run that the simulator drives in a room of 10 m × 4 m, which may have a wall with a door of 0.4 m in it."""
    free, divided = build.walled_room(10.0, 4.0), build.walled_room(10.0, 4.0)
    divided[:, 98:102] = 100
    divided[36:44, 98:102] = 0
    maps = {
        name: build.write_map(tmp_path_factory.mktemp(name), cells)
        for name, cells in (("free", free), ("divided", divided))
    }

    def causes(system=(), oracles=(), obstacles=(), *, room="free", start=(1.0, 2.0), timeout_s=60.0):
        poses = {
            f"{end}_pose": {"position": {"x": x, "y": y}, "orientation": {"yaw": 0.0}}
            for end, (x, y) in (("start", start), ("goal", (8.0, 2.0)))
        }
        environment = {"map_file": map_content(maps[room]), "static_objects": list(obstacles)}
        system = {"controller": "rpp", **dict(system)}
        scenario = Scenario("builtin:navigate_to_pose", timeout_s, environment, poses, system)
        block = write_recordings([simulated(scenario, 0)])
        return dict(judge_block(scenario, block, observe_block(scenario, block), oracles_of(oracles)).causes)

    return causes


BLIND, NOISY = {"laserscan_random_drop_percentage": 1.0}, {"laserscan_gaussian_noise_std_deviation": 2.0}
SAFETY = ("safety", {})


def test_robot_on_a_free_floor_passes_and_has_no_cause(driven):
    assert driven(oracles=[SAFETY, ("performance", {}), ("robustness", {})]) == {}


def test_simulators_robots_fail_of_the_cause_that_was_planted(driven, build):
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


def test_table_evidence_and_report_have_the_causes_with_a_picture_and_the_command_that_replays_one(
    synthetic_campaign, room, build
):
    task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 9.0, "y": 2.0}}
    lost = [stopping(build.a_recording(HALF, run_index=k, error_xy_m=(0.0, 0.8))) for k in (1, 2)]
    fine = build.a_recording(ALONG)
    synthetic_campaign.add("a-1", "a", room, task, recordings=[fine, lost[0]])
    synthetic_campaign.add("a-2", "a", room, task, recordings=[fine, *lost])
    synthetic_campaign.add("a-3", "a", room, task, recordings=[stopping(build.a_recording(HALF))])
    directory = synthetic_campaign.write()
    found = causes_of(read_tables(directory))
    assert [(each.cause, each.runs, each.configurations) for each in found] == [("lost", 3, 2), ("unknown", 1, 1)]
    write_report(directory)
    said = json.loads((directory / "evidence.json").read_text())["causes"]
    assert said["lost"]["example"] == {"configuration": "a-2", "run_index": 1}
    page = (directory / "report.html").read_text(encoding="utf-8")
    assert "vastflow replay . a-2 1" in page
    assert (directory / "figures" / "cause-lost.png").is_file()


def test_directory_of_an_earlier_version_has_no_causes_and_a_report(synthetic_campaign, room, build):
    task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 9.0, "y": 2.0}}
    synthetic_campaign.add("a-1", "a", room, task, recordings=[stopping(build.a_recording(HALF))])
    tables = read_tables(synthetic_campaign.write())
    earlier = tables.__class__(**{**tables.__dict__, "runs": tables.runs.drop_columns(["cause"])})
    assert causes_of(earlier) == ()
