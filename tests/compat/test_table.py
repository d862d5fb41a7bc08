"""The table of a folder with files of every kind: what ran, what drove, what was refused and why."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

TABLE = Path(__file__).parent / "table.py"

pytestmark = pytest.mark.timeout(1200)  # where nobody compiled the kernels before, this does, perhaps on a busy machine

PROGRAM = "import osc.helpers\nscenario count:\n    number: string\n    do run_process('test ' + number + ' = 1')\n"
ROBOT = """\
import osc.nav2
import osc.ros

scenario go:
    start_pose: pose_3d
    goal_pose: pose_3d
    robot: differential_drive_robot
    do serial:
        robot.init_nav2(start_pose)
        robot.nav_to_pose(goal_pose)
"""
CAMPAIGN = """\
version: 1
configuration:
- name: counts
  variations:
  - ParameterVariationList: {name: number, values: [1, 2, 3]}
- name: elsewhere
  parameters: [{number: 1}, {map_file: gone.yaml}]
execution: {scenario_file: count.osc}
results_processing: {postprocessing: [gone.py:Step, rosbags_to_csv]}
"""
PLAN = """\
Floor plan: cell
Defaults: walls: thickness: 0.1 m height: 2.5 m
var width = 4.0 m
Space hall: shape: Rectangle width=width, length=3.0 m location: wrt: world of: this
"""
NAV2 = "controller_server:\n  ros__parameters:\n    controller_frequency: 20.0\n"


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    (folder / "below").mkdir()
    for name, text in {
        "count.osc": PROGRAM,
        "below/go.osc": ROBOT,
        "below/lost.osc": "import osc.ros\nscenario lost:\n    do wait_for_topics(['/own'])\n",
        "count.vast": CAMPAIGN,
        "slip.vast": CAMPAIGN.replace("version: 1", "version: 9"),
        "cell.fpm": PLAN,
        "cell.variation": 'import "cell.fpm"\nwidth : uniform([3.0, 5.0])\n',
        "nav2.yaml": NAV2,
        "other.yaml": "controller: 1\n",
        "read.me": "no file of ours",
    }.items():
        (folder / name).write_text(text)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    command = [sys.executable, str(TABLE), str(folder), "--json", "--workers", "1"]
    called = subprocess.run(command, check=False, capture_output=True, text=True)
    assert called.returncode == 0, called.stderr
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    return {row["file"]: row for row in json.loads(called.stdout)}


@pytest.mark.slow
def test_compatibility_table_covers_every_kind_of_file(rows):
    assert {file: (row["kind"], row["outcome"]) for file, row in rows.items()} == {
        "below/go.osc": ("scenario", "ran"),
        "below/lost.osc": ("scenario", "refused"),
        "cell.fpm": ("floor plan", "ran"),
        "cell.variation": ("variation", "ran"),
        "count.osc": ("scenario", "ran"),
        "count.vast": ("campaign", "ran"),
        "nav2.yaml": ("Nav2 parameters", "valid"),
        "slip.vast": ("campaign", "refused"),
    }
    row = rows["count.vast"]
    assert (row["configurations"], row["runs"], row["passed"], row["failed"]) == (3, 3, 1, 2)
    assert row["broken"] == 2, "a family without its map, and a step without its file"
    row = rows["below/go.osc"]
    assert (row["sent"], row["drove"], row["passed"], 2.0 < row["distance_m"] < 6.0) == (1, 1, 1, True)
    reasons = {file: row["reason"] for file, row in rows.items()}
    assert reasons["slip.vast"].startswith("1: version: ") and "wait_for_topics" in reasons["below/lost.osc"]
    assert reasons["cell.fpm"].startswith("map of ")
    assert reasons["cell.variation"] == "2 plans drawn"
    assert reasons["nav2.yaml"] == "1 parameters, 0 of them not modeled"


@pytest.mark.slow
def test_table_for_a_page_has_a_line_for_each_file(tmp_path):
    (tmp_path / "nav2.yaml").write_text(NAV2)
    command = [sys.executable, str(TABLE), str(tmp_path)]
    called = subprocess.run(command, check=False, capture_output=True, text=True)
    header, rule, line = called.stdout.splitlines()
    assert header.startswith("| file | kind | result |") and set(rule) == {"|", "-"}
    assert line.startswith("| nav2.yaml | Nav2 parameters | valid |")


def test_page_has_the_table_that_the_suite_holds():
    page = (TABLE.parents[2] / "docs" / "compatibility.md").read_text()
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines() if ".vast |" in line]
    said = {file: (outcome, configurations, drove) for file, _, outcome, configurations, _, drove, *_ in lines}
    expected = json.loads((TABLE.parent / "expected.json").read_text())
    assert said == {
        file: (row["outcome"], str(row["configurations"] or ""), f"{row['drove']}/{row['sent']}" if row["sent"] else "")
        for file, row in expected.items()
        if file.endswith(".vast")
    }
