"""Packed replies, and the frames of stored runs against the recordings they are made of."""

import re
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from synthetic import SyntheticCampaign, a_recording, box_at, walled_room, write_map
from unpacked import unpacked

from vastflow.deployments.explorer.packed import packed
from vastflow.oracles.observation.trace import NOWHERE_MM
from vastflow.oracles.query.frames import (
    FREE,
    NO_POINTS,
    SIGNALS,
    UNKNOWN,
    WALL,
    StoredRun,
    frames_of,
    plots_of,
    scenario_spans,
    stored_run,
)
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.sim.model.blocks import read_block
from vastflow.sim.model.recording import Event, Recording, Run
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.world.world import map_content

WALK = [(1.0 + 0.05 * i, 2.0) for i in range(41)]
TASK = {"start_pose": {"x": 1.0, "y": 2.0, "yaw": 0.5}, "goal_pose": {"x": 3.8, "y": 2.0}}
EVENTS = (
    Event(0.5, "plan_failed", 1.2, 2.0, "208"),
    Event(0.5, "recovery", 1.2, 2.0, "spin"),
    Event(1.2, "obstacle_moved", 3.1, 2.5, "box_3_2.5", 0.1),
    Event(1.25, "contact", 1.6, 2.0, "box_3_2.5", 0.2),
    Event(3.0, "goal_reached", 3.0, 2.0, "0"),
)


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """A campaign of one configuration: run 0 with events, run 1 lost."""
    cells = walled_room(6.0, 4.0)
    cells[:, 100:] = -1
    room = write_map(tmp_path / "room", cells, (-0.5, 0.25))
    runs = [
        a_recording(WALK, error_xy_m=(0.03, -0.04), events=EVENTS),
        a_recording(WALK[:9], run_index=1, outcome="aborted", reason="stuck <b>"),
    ]
    campaign = SyntheticCampaign(tmp_path / "results")
    campaign.add("office-1", "office", room, TASK, recordings=runs, obstacles=[box_at(3.0, 2.5)])
    campaign.add("office-2", "office", room, TASK, obstacles=[box_at(3.0, 2.5)], duplicate_of="office-1")
    return campaign.write()


def test_packed_arrays_come_back_from_aligned_places():
    arrays = {
        "a": np.arange(5, dtype=np.uint8),
        "bytes": np.arange(12, dtype=np.int16).reshape(3, 4),
        "empty": np.empty((0, 2), dtype=np.float32),
        "é": np.array([1.5, np.nan, np.inf], dtype=np.float32),
    }
    content = packed({"name": "<ä>\n", "missing": np.nan}, arrays)
    assert (content.index(b"\n") + 1) % 8 == 0
    header, found = unpacked(content)
    assert (header["name"], header["missing"]) == ("<ä>\n", None)
    assert all(place["offset"] % 8 == 0 for place in header["arrays"].values())
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype


def test_packed_rejects_type_that_browsers_lack():
    with pytest.raises(ValueError, match=r"t: expected an array of uint8, .*, got int64"):
        packed({}, {"t": np.arange(3)})


def test_frames_hold_recorded_and_derived_columns(directory: Path):
    header, arrays = unpacked(packed(*frames_of(stored_run(directory, "office-1", 1), "office-1")))
    (_, recorded), (_, derived) = (
        read_block(directory / folder / "office-1.parquet")[1] for folder in ("recordings", "traces")
    )
    for name in ("t_ms", "x_mm", "estimated_y_mm", "yaw_mrad", "speed_mmps"):
        np.testing.assert_array_equal(arrays[name], recorded[name])
    for name in ("localization_error_mm", "wall_clearance_mm", "static_clearance_mm", "deviation_mm"):
        np.testing.assert_array_equal(arrays[name], derived[name])
    drawn = {line["column"] for plot in plots_of([stored_run(directory, "office-1", 1)]) for line in plot["lines"]}
    assert "sent_speed_mmps" not in drawn  # which this recording lacks
    assert drawn <= arrays.keys()
    assert (header["judgment"], header["reason"], header["nowhere"]) == ("fail", "stuck <b>", NOWHERE_MM)
    assert header["verdicts"][0]["reason"].endswith("stuck <b>")


def test_frames_hold_map_start_goals_and_reference(directory: Path):
    header, arrays = unpacked(packed(*frames_of(stored_run(directory, "office-1", 0), "office-1")))
    (grid,) = header["grids"]
    cells = arrays[grid["cells"]]
    assert (grid["kind"], grid["x_m"], grid["y_m"], grid["resolution_m"]) == ("map", -0.5, 0.25, 0.05)
    assert cells.shape == (80, 100)  # the known part
    assert (cells[0, 0], cells[1, 1]) == (WALL, FREE)
    assert UNKNOWN not in cells
    assert header["goals"] == [[3.8, 2.0]]
    assert header["robot"] == {"radius_m": 0.17, "vertices": []}
    assert np.hypot(*(arrays["reference"][-1] - (3.8, 2.0))) < 0.05


def test_frames_hold_events_and_moves_of_obstacles(directory: Path):
    header, _ = unpacked(packed(*frames_of(stored_run(directory, "office-1", 0), "office-1")))
    assert [(event["t_s"], event["kind"], event["text"]) for event in header["events"]] == [
        (0.5, "plan_failed", "no path to the goal (NO_VALID_PATH)"),
        (0.5, "recovery", "recovery: spin"),
        (1.25, "contact", "touches box_3_2.5 at 0.20 m/s"),
        (3.0, "goal_reached", "goal 1 reached"),
    ]
    (box,) = header["obstacles"]
    assert box["places"] == [[-0.001, 3.0, 2.5, 0.0], [1.2, 3.1, 2.5, 0.1]]
    assert header["activities"] == [[0.0, 4.0, "driving"]]


def test_frames_of_duplicate_are_those_of_its_original(directory: Path):
    header, arrays = unpacked(packed(*frames_of(stored_run(directory, "office-2", 0), "office-2")))
    assert (header["configuration"], header["executed"]) == ("office-2", "office-1")
    assert len(arrays["t_ms"]) == 41


def test_stored_run_names_missing_parts(directory: Path):
    with pytest.raises(UnusableDirectory, match=r"Unknown configuration 'office-3'\. Did you mean 'office-[12]'"):
        stored_run(directory, "office-3", 0)
    with pytest.raises(UnusableDirectory, match="office-1: expected the number of a run, 0 to 1, got 2"):
        stored_run(directory, "office-1", 2)
    (directory / "recordings" / "office-1.parquet").write_bytes(b"PAR1")
    with pytest.raises(UnusableDirectory, match="damaged campaign directory"):
        stored_run(directory, "office-1", 0)


def test_frames_report_missing_recording(directory: Path):
    (directory / "recordings" / "office-1.parquet").unlink()
    header, arrays = unpacked(packed(*frames_of(stored_run(directory, "office-1", 1), "office-1")))
    assert header["sentence"] == "This run was not recorded. The verdicts say why."
    assert (header["judgment"], arrays) == ("fail", {})


def test_frames_without_robot_have_events_and_actions():
    behaviors = {
        "t_s": np.array([0.0, 0.0, 0.1, 2.5]),
        "behavior": np.array([0, 1, 1, 1]),
        "parent": np.array([-1, 0, 0, 0]),
        "name": np.array(["growth", "run_process", "run_process", "run_process"], dtype=object),
        "status": np.array(["INVALID", "INVALID", "RUNNING", "FAILURE"], dtype=object),
        "message": np.array(["", "", "", "exit code 3"], dtype=object),
    }
    told = Run(0, "1:2:0", "failed", 0, "exit code 3", 2.6, 0.0, 0, 0)
    scenario = Scenario("builtin:navigate_to_pose", 60.0, {}, {}, {})
    run = StoredRun("growth-1", 0, scenario, Recording(told, {}, behaviors), NO_POINTS, {}, [])
    header, arrays = unpacked(packed(*frames_of(run, "growth-1")))
    assert header["sentence"].startswith("This scenario has no robot")
    assert "outputs/growth-1.zip" in header["sentence"]
    span = {
        "name": "run_process",
        "start_s": 0.1,
        "end_s": 2.5,
        "status": "FAILURE",
        "message": "exit code 3",
        "lane": 0,
    }
    assert header["behaviors"] == [span]
    assert arrays == {}


def test_scenario_spans_run_to_the_end_without_last_status():
    rows = [(0.1, 1, "wait", "RUNNING"), (0.3, 1, "wait", "SUCCESS"), (0.3, 2, "drive", "RUNNING")]
    columns = zip(*rows, strict=True)
    behaviors = {
        name: np.array(column) for name, column in zip(("t_s", "behavior", "name", "status"), columns, strict=True)
    }
    behaviors |= {"parent": np.zeros(3, dtype=int), "message": np.array([""] * 3)}
    spans = [(each["name"], each["start_s"], each["end_s"], each["status"]) for each in scenario_spans(behaviors, 9.0)]
    assert spans == [("wait", 0.1, 0.3, "SUCCESS"), ("drive", 0.3, 9.0, "RUNNING")]
    assert [*scenario_spans({}, 9.0)] == []


def test_frames_leave_deviation_out_without_reference(directory: Path):
    run = stored_run(directory, "office-1", 0)
    assert len(run.reference_xy_m)
    without = replace(run, reference_xy_m=NO_POINTS)
    _, arrays = unpacked(packed(*frames_of(without, "office-1")))
    assert "deviation_mm" not in arrays
    assert "Off the reference path" not in [plot["title"] for plot in plots_of([without])]


def test_distance_to_goal_is_measured_to_next_open_goal(directory: Path):
    run = stored_run(directory, "office-1", 0)
    x_mm = run.columns["x_mm"]
    np.testing.assert_array_equal(run.columns["goal_distance_mm"], 3800 - x_mm)
    task = {"start_pose": TASK["start_pose"], "goal_poses": [{"x": 2.5, "y": 2.0}, {"x": 1.0, "y": 2.0}]}
    patrol = replace(run.scenario, abstract="builtin:follow_waypoints", task=task)
    distance_mm = replace(run, scenario=patrol).columns["goal_distance_mm"]
    reached = run.columns["t_ms"] > 3000  # the first goal
    np.testing.assert_array_equal(distance_mm, np.where(reached, x_mm - 1000, abs(2500 - x_mm)))


def test_plots_overlay_runs_and_leave_gaps(directory: Path):
    run = stored_run(directory, "office-1", 1)
    gap = replace(run, derived={**run.derived, "localization_error_mm": np.array([NOWHERE_MM, 1000, 2500, *[0] * 6])})
    (plot,) = (each for each in plots_of([run, gap]) if each["title"] == "Localization error")
    assert [(line["side"], line["column"]) for line in plot["lines"]] == [
        (0, "localization_error_mm"),
        (1, "localization_error_mm"),
    ]
    assert (plot["low"], plot["high"]) == (0.0, 2.5)
    assert plot["lines"][1]["d"].startswith("M0.1 -1L0.2 -2.5L0.3 0L")


def test_frames_hold_world_and_masks_beside_the_map(directory: Path, tmp_path: Path):
    run = stored_run(directory, "office-1", 0)
    zone = np.zeros((20, 40), dtype=np.int8)
    zone[5:9, 10:30] = 100
    costmap = "global_costmap.global_costmap.ros__parameters"
    system = {f"{costmap}.filters": ["k"], f"{costmap}.k.plugin": "nav2_costmap_2d::KeepoutFilter"}
    system |= {"keepout_mask": map_content(write_map(tmp_path / "zone", zone, (1.0, 0.5)))}
    environment = {**run.scenario.environment, "world": {"seed": 1, "wall_offset": 0.05}}
    scenario = replace(run.scenario, environment=environment, system=system)
    header, arrays = unpacked(packed(*frames_of(replace(run, scenario=scenario), "office-1")))
    _, world, keepout = header["grids"]
    assert [grid["kind"] for grid in header["grids"]] == ["map", "world", "keepout"]
    assert np.count_nonzero(arrays[world["cells"]] == WALL) > 100
    assert (keepout["x_m"], keepout["y_m"]) == (1.0, 0.5)
    np.testing.assert_array_equal(arrays[keepout["cells"]], zone)


def test_plot_has_other_dashes_for_each_line():
    template = resources.files("vastflow.deployments.explorer").joinpath("templates/tracks.html.j2").read_text()
    (patterns,) = re.findall(r'stroke-dasharray="\{\{ \((.*?)\)\[each.n\]', template)
    assert max(len(lines) for _, _, lines in SIGNALS) <= len(set(patterns.split(", ")))
