"""Nodes of ROS 2 in a campaign file."""

import subprocess
import sys

import pytest
from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.robots import robots_json
from vastflow.sim.model.faults import FileError

CAMPAIGN = """\
configuration:
  - name: free
    parameters:
      - map_file: map.yaml
      - start_pose: {{x: 1.0, y: 1.0}}
      - goal_pose: {{x: 2.0, y: 1.0}}
execution:
{execution}
"""


@pytest.fixture
def load(tmp_path):
    """Reads a campaign with a section `execution`."""
    (tmp_path / "map.pgm").write_bytes(b"P5 80 80 255\n" + b"\xfe" * 6400)
    (tmp_path / "map.yaml").write_text(
        "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (tmp_path / "follower.py").write_text("print('here')")

    def read(*lines):
        (tmp_path / "c.vast").write_text(CAMPAIGN.format(execution="\n".join(f"  {line}" for line in lines)))
        return load_campaign(tmp_path / "c.vast")

    return read


def test_nodes_are_processes_of_a_run_with_its_files(load):
    campaign = load(
        "system: ros2",
        "run_files: [follower.py]",
        "nodes:",
        "  - follower: {command: python3 'follower.py' --fast, env: {LEVEL: 2, LOUD: true}, ready: {port: 4000, within: 3}}",
        "  - rest: {command: [ros2, launch, a b]}",
        "ros2: {time: paced, real_time_factor: 2, topics: {scan: /front}, frames: {base: base_footprint}}",
    )
    assert campaign.programs is not None and [name for name, _ in campaign.programs.files] == ["follower.py"]
    nodes = campaign.nodes
    follower, rest = nodes.processes
    assert (follower.name, follower.command) == ("follower", ("python3", "follower.py", "--fast"))
    assert (follower.environment, follower.ready, follower.ready_at) == ({"LEVEL": "2", "LOUD": "true"}, "port", "4000")
    assert (follower.ready_within_s, rest.command, rest.ready) == (3.0, ("ros2", "launch", "a b"), "")
    assert (nodes.time, nodes.real_time_factor, nodes.topics["scan"], nodes.topics["odom"]) == (
        "paced",
        2.0,
        "/front",
        "/odom",
    )
    assert (nodes.frames["base"], nodes.frames["laser"]) == ("base_footprint", "base_scan")


def test_robot_of_a_campaign_with_nodes_is_said_to_be_driven_by_them(load):
    campaign = load("system: ros2", "nodes: [{follower: {command: a}}, {stopper: {command: b}}]")
    (said,) = robots_json(campaign.families, campaign.nodes)
    driven = "driven by nodes of ROS 2 (follower, stopper; in lock step); of Nav2's parameters only the robot's count; "
    assert said["summary"].startswith(driven)
    (own,) = robots_json(load("system: nav2").families, load("system: nav2").nodes)
    assert "ROS 2" not in own["summary"]


@each_row(
    ("lines", "fault"),
    [
        (["system: gazebo"], "execution.system: Unknown value 'gazebo'. Expected one of nav2, ros2."),
        (["nodes: [{a: {command: x}, b: {command: y}}]"], "2 nodes in one entry"),
        (['nodes: [{a: {command: "it\'s"}}]'], "expected a command as a shell reads it"),
        (["nodes: [{a: {command: []}}]"], "execution.nodes"),
        (["nodes: [{a: {}}]"], "command"),
        (["nodes: [{a: {command: x, ready: {port: 0}}}]"], "port"),
        (["ros2: {topics: {laser: /scan}}"], "expected one of amcl_pose, clock, cmd_vel"),
        (["ros2: {real_time_factor: 0}"], "real_time_factor"),
        (["system: ros2"], "execution.system: No node drives the robot. Give execution.nodes, or a scenario that"),
    ],
)
def test_wrong_nodes_are_refused_with_their_place(load, lines, fault):
    with pytest.raises(FileError, match=fault):
        load(*lines)


def test_nodes_without_system_of_ros2_are_said_to_have_no_effect(load):
    notes = load("nodes: [{a: {command: x}}]", "ros2: {time: paced}").notes
    assert [(note.kind, note.place.where) for note in notes] == [
        ("warning", "execution.nodes"),
        ("warning", "execution.ros2"),
    ]
    assert not [
        note for note in load("system: ros2", "nodes: [{a: {command: x}}]").notes if "nodes" in note.place.where
    ]


def test_scenario_that_starts_programs_needs_no_nodes_of_its_own(load, tmp_path):
    (tmp_path / "own.osc").write_text(
        "import osc.os\nimport osc.nav2\nimport osc.helpers\nscenario own:\n    start_pose: pose_3d\n    goal_pose: pose_3d\n"
        "    robot: differential_drive_robot\n    do parallel:\n        run_process('follower')\n"
        "        robot.nav_to_pose(goal_pose)\n"
    )
    campaign = load("system: ros2", "scenario_file: own.osc")
    assert campaign.nodes is not None and "that the scenario starts" in campaign.nodes.words


def test_runs_of_built_in_stack_import_nothing_of_nodes():
    text = (
        "import sys, vastflow.sim.run; print([name for name in sys.modules if name.startswith('vastflow.sim.nodes')])"
    )
    found = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
