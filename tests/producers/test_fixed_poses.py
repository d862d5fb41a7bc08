"""Fixed poses that suit no configuration: a mistake of the file, with its place, unless the family says otherwise."""

import math
import re
from pathlib import Path

import pytest
from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.sim.model.faults import FileError, Got

ROOMS = ["#" * 16, *["#......##......#"] * 2, "#......||......#", *["#......##......#"] * 2, "#" * 16]
"""Two rooms from (-0.5, -1.5) to (2.5, 1) and from (3.5, -1.5) to (6.5, 1); `|` is a door of 0.5 m at y = -0.25 m."""
START, THERE = "start_pose: {x: 0.5, y: -0.25}", "goal_pose: {x: 5.0, y: -0.25}"
WALL, OUTSIDE = "expected a pose off the map's walls", "expected a pose on the map"
REACH = "expected a pose to which the map has a path"


@pytest.fixture
def family(drawn_map, tmp_path):
    """A campaign file with one family of these fixed parameters; the map's lower left corner is (-1, -2)."""

    def write(*parameters, more="", door=".", floor=".", yaw_rad=0.0):
        rows = [row.replace("|", door).replace(".", floor) for row in ROOMS]
        file = Path(drawn_map(*rows, cells=10).path)
        file.write_text(file.read_text().replace("-2.0, 0.0]", f"-2.0, {yaw_rad}]"))
        lines = "".join(f"  - {line}\n" for line in (f"map_file: {file}", *parameters))
        (tmp_path / "f.vast").write_text(f"version: 1\nconfiguration:\n- name: a\n  parameters:\n{lines}{more}")
        return tmp_path / "f.vast"

    return write


def faults_of(file):
    try:
        load_campaign(file)
    except FileError as error:
        return [re.sub(r"^.*f\.vast:|configuration\[0\]\.", "", str(fault)) for fault in error.faults]
    return []


def test_map_whose_unknown_cells_are_free_is_noted_once(family):
    file = family(START, THERE, floor="?")
    assert load_campaign(file).notes == ()
    drawn = Path(re.search(r"map_file: (.+)", file.read_text())[1])
    drawn.write_text(drawn.read_text().replace("free_thresh: 0.196", "free_thresh: 0.25"))
    (note,) = load_campaign(file).notes
    assert (note.place.line, note.kind) == (5, "warning")
    assert str(note).endswith(
        ".map_file: Cells of the gray of unknown ones, 205, are free, as for map_server: 6,200. "
        "With free_thresh: 0.196 they are unknown, and no path leads there."
    )


@each_row(
    ("parameters", "expected"),
    [
        ([START, THERE], []),
        (
            [START, "goal_pose: {x: 40.0, y: 0.0}"],
            [f"7:16: parameters[2].goal_pose: {OUTSIDE}, got (40, 0), which lies outside the map"],
        ),
        (
            ["start_pose: {x: -0.75, y: 0.0}", THERE],
            [f"6:17: parameters[1].start_pose: {WALL}, got (-0.75, 0), which lies in a wall"],
        ),
        (
            [START, "goal_poses: [{x: 5.0, y: 0.0}, {x: 3.0, y: 0.5}]"],
            [f"7:36: parameters[2].goal_poses[1]: {WALL}, got (3, 0.5), which lies in a wall"],
        ),
        (
            [START, THERE, "goal_pose1: {x: 3.0, y: 0.5}"],
            [],  # a parameter of a scenario, unless its tag says that it is of the task
        ),
    ],
)
def test_fixed_pose_off_the_map_or_in_a_wall_is_fault(family, parameters, expected):
    assert faults_of(family(*parameters)) == expected


@each_row(
    ("options", "is_reached"),
    [
        ({}, True),
        ({"door": "#"}, False),
        ({"door": "?"}, True),  # Nav2 plans over unknown ground
        ({"floor": "?"}, True),
        ({"more": "  robot: {radius: 0.26}\n"}, False),
        ({"more": "  robot: {radius: 0.1}\n"}, True),
        # Only the costmaps close the door: whether the robot says so is what such a campaign tests.
        ({"more": "  - robot_radius: 0.3\n  robot: {radius: 0.2}\n"}, True),
    ],
)
def test_fixed_goal_is_a_fault_where_the_robot_fits_through_no_passage(family, options, is_reached):
    found = faults_of(family(START, THERE, **options))
    assert found == [] if is_reached else len(found) == 1
    assert is_reached or found[0].startswith(
        f"7:16: parameters[2].goal_pose: {REACH}, got (5, -0.25), which a robot of 0."
    )
    assert is_reached or found[0].endswith("m radius can't reach from start_pose")


def test_fixed_pose_beside_a_wall_is_left_to_the_start_check(family):
    assert faults_of(family(START, "goal_pose: {x: 6.45, y: -1.45}")) == []


def test_poses_on_a_turned_map_are_looked_up_in_its_frame(family):
    def turned(x, y):
        c, s = math.cos(0.5), math.sin(0.5)
        return f"{{x: {c * (x + 1) - s * (y + 2) - 1}, y: {s * (x + 1) + c * (y + 2) - 2}}}"

    start = f"start_pose: {turned(0.5, -0.25)}"
    assert faults_of(family(start, f"goal_pose: {turned(5.0, -0.25)}", yaw_rad=0.5)) == []
    assert len(faults_of(family(start, f"goal_pose: {turned(3.0, 0.5)}", yaw_rad=0.5))) == 1


def test_mission_that_is_meant_to_fail_says_so_and_gets_warnings(family):
    file = family(START, "goal_pose: {x: 3.0, y: 0.5}", more="  start_check: none\n")
    (note,) = [note for note in load_campaign(file).notes if note.kind == "warning"]
    assert (note.place.line, note.problem) == (7, Got("(3, 0.5), which lies in a wall"))


@each_row(
    ("producer", "is_fault"),
    [
        ("ParameterVariationList: {name: goal_pose, values: [{x: 5.0, y: 0.0}]}", False),
        ("ParameterVariationList: {name: robot_radius, values: [0.22, 0.1]}", True),
        ("PathVariationRandom: {path_length: 2.0, start_pose: '@start_pose', goal_poses: '@goal_pose'}", True),
    ],
)
def test_fixed_pose_that_a_producer_replaces_is_no_fault(family, producer, is_fault):
    file = family(START, "goal_pose: {x: 3.0, y: 0.5}", more=f"  variations:\n  - {producer}\n")
    assert (len(faults_of(file)) == 1) == is_fault


def test_reach_is_not_judged_where_the_robots_size_varies(family):
    producer = "ParameterVariationList: {name: robot_radius, values: [0.3, 0.1]}"
    assert faults_of(family(START, THERE, "robot_radius: 0.3", more=f"  variations:\n  - {producer}\n")) == []
    assert len(faults_of(family(START, THERE, "robot_radius: 0.3"))) == 1
