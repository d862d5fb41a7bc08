"""`vastflow params`, and Nav2 parameter files on the way through `validate` and into the results."""

import json

import pytest
from command_line import called, refused

from vastflow.flows.request.campaign_file import MOST_OF_A_FILE, read_campaign, terminal_lines
from vastflow.flows.results.inputs import inputs_of
from vastflow.sim.model.faults import Fault, Place

NAV2 = """\
controller_server:
  ros__parameters:
    publish_zero_velocity: false
    controller_plugins: [FollowPath]
    FollowPath:
      plugin: "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
      desired_linear_vel: 1.0
velocity_smoother:
  ros__parameters:
    scale_velocities: false
    odom_topic: odom
    mystery: .inf
"""


@pytest.fixture
def nav2(tmp_path):
    file = tmp_path / "nav2.yaml"
    file.write_text(NAV2)
    return file


def test_params_lists_parameters_and_counts(nav2):
    result = called("params", nav2)
    lines = [" ".join(line.split()) for line in result.stdout.splitlines()]
    assert (result.exit_code, lines[:9]) == (
        0,
        [
            "line parameter value simulator",
            "3 controller_server.publish_zero_velocity false differs: true is built in",
            "4 controller_server.controller_plugins ['FollowPath'] modeled",
            "6 controller_server.FollowPath.plugin 'nav2_regulated_pure_pursuit_controller… modeled",
            "7 controller_server.FollowPath.desired_linear_vel 1.0 modeled",
            "10 velocity_smoother.scale_velocities false built in",
            "11 velocity_smoother.odom_topic 'odom' no effect",
            "12 velocity_smoother.mystery inf not modeled",
            "",
        ],
    )
    counts = ["3 modeled", "1 built in", "1 no effect", "1 differs", "1 not modeled"]
    assert [line.split(":")[0] for line in lines[9:14]] == counts
    assert lines[14].startswith("warning: local_costmap.local_costmap.rolling_window: rolling_window is false where")
    assert lines[15].endswith("more are modeled, with the defaults of Nav2's code")
    source = "nav2_controller/src/controller_server.cpp:65"
    assert f"controller_server.failure_tolerance 0.0 Jazzy: 0.3 {source}" in lines[16:]
    built_in = (
        "local_costmap.local_costmap.rolling_window false built in: true nav2_costmap_2d/src/costmap_2d_ros.cpp:129"
    )
    assert built_in in lines[16:]
    assert "not in the file, as in Nav2's code: amcl, local_costmap, global_costmap, planner_server, " in result.stdout
    assert "not in the file and not simulated: collision_monitor" in lines


def test_params_prints_used_value_beside_special_one(nav2):
    nav2.write_text(NAV2.replace("publish_zero_velocity: false", "failure_tolerance: -1.0"))
    lines = [" ".join(line.split()) for line in called("params", nav2).stdout.splitlines()]
    assert "3 controller_server.failure_tolerance -1.0 modeled: 1000000.0" in lines


def test_params_shows_effective_rate_of_loops(nav2):
    frequency = "local_costmap: {local_costmap: {ros__parameters: {update_frequency: 3.0, publish_frequency: 2.0}}}\n"
    loop = "bt_navigator: {ros__parameters: {bt_loop_duration: 10}}\n"
    nav2.write_text(NAV2.replace("publish_zero_velocity: false", "controller_frequency: 30.0") + frequency + loop)
    lines = [" ".join(line.split()) for line in called("params", nav2).stdout.splitlines()]
    for line in (
        "3 controller_server.controller_frequency 30.0 differs: runs at 20 Hz, in whole ticks of 50 ms",
        "13 local_costmap.local_costmap.update_frequency 3.0 differs: runs at 2.857 Hz, in whole ticks of 50 ms",
        "13 local_costmap.local_costmap.publish_frequency 2.0 modeled",
        "14 bt_navigator.bt_loop_duration 10 no effect: trees are ticked every 50 ms",
        "2 differs: another value is built in",
    ):
        assert line in lines
    found = json.loads(called("params", nav2, "--json").stdout)["parameters"][0]
    assert (found["status"], found["used"]) == ("differs", 20.0)


def test_params_prints_body_and_limits_and_assumptions(nav2):
    polygon = "[[0.35, 0.25], [0.35, -0.25], [-0.35, -0.25], [-0.35, 0.25]]"
    costmap = f"local_costmap: {{local_costmap: {{ros__parameters: {{footprint: '{polygon}'}}}}}}\n"
    nav2.write_text(costmap + NAV2.replace("scale_velocities: false", "max_velocity: [1.5, 0.0, 2.0]"))
    *_, read, assumed, ideal = called("params", nav2).stdout.splitlines()
    assert read == (
        "the robot, from the Nav2 parameters: body polygon of 4 vertices, speed up to 1.5 m/s, yaw rate up to 2.5 rad/s"
    )
    assert assumed.startswith(
        "assumed, as a TurtleBot 4 has it: drive differential, mass 3.3 kg, acceleration up to 2 m/s², "
    )
    assert assumed.endswith(
        ", with 360 beams, from 0 to 6.28 rad, ranges above 0.164 m, ranges below 20 m, scans at 10 Hz"
    )
    assert ideal == "assumed, as no real robot has it: scans, odometry, and commands without latency"
    assert json.loads(called("params", nav2, "--json").stdout)["robot"]["vertices"][0] == [0.35, 0.25]


def test_params_prints_json(nav2):
    found = json.loads(called("params", nav2, "--json").stdout, parse_constant=pytest.fail)
    assert found["counts"] == {"modeled": 3, "built in": 1, "no effect": 1, "differs": 1, "not modeled": 1}
    assert found["parameters"][3] == {
        "path": "controller_server.ros__parameters.FollowPath.desired_linear_vel",
        "line": 7,
        "column": 27,
        "value": 1.0,
        "status": "modeled",
        "used": 1.0,
        "why": "",
    }
    assert found["left_out"]["controller_server.ros__parameters.FollowPath.lookahead_dist"] == 0.6
    assert found["nodes_left_away"] == ["collision_monitor"]
    assert (found["nodes_of_jazzy"], "amcl" in found["nodes_of_code"]) == ([], True)
    (row,) = (row for row in found["omitted"] if row["path"] == "controller_server.ros__parameters.failure_tolerance")
    source = "nav2_controller/src/controller_server.cpp:65"
    assert (row["value"], row["jazzy"], row["source"]) == (0.0, 0.3, source)


def test_campaign_keeps_parameter_file_and_validate_reports_it(small_room, nav2, tmp_path, monkeypatch):
    file = nav2.rename(small_room.with_name("nav2.yaml"))
    small_room.write_text(f"{small_room.read_text()}  nav2_params: nav2.yaml\n")
    found = inputs_of(*read_campaign(small_room))
    assert found.files["nav2.yaml"] == NAV2.encode()
    assert (set(found.files), len(found.worlds)) == ({"nav2.yaml", "room.yaml", "room.pgm"}, 1)
    result = called("validate", small_room)
    assert result.exit_code == 0
    assert f"{file}:12:14: velocity_smoother.mystery: 'mystery' is not modeled\n" in result.stdout
    assert result.stdout.endswith("OK: 1 family, 1 producer, 1 oracle\n")
    monkeypatch.chdir(tmp_path)
    file.write_text(NAV2.replace("_vel: 1.0", "_vel: fast"))
    before = sorted(tmp_path.rglob("*"))
    for command in ("validate", "run"):
        said = refused(command, small_room)
        assert "nav2.yaml:7:27: controller_server.ros__parameters.FollowPath.desired_linear_vel: " in said
        assert "got 'fast'" in said
    assert sorted(tmp_path.rglob("*")) == before


def note(k, kind="not modeled", file="nav2.yaml"):
    return Fault(Place(file, k, 1, f"p{k}"), "why", kind=kind)


def test_terminal_lines_count_unmodeled_parameters_and_warnings_of_floor_plan_beyond_a_few():
    assert len(list(terminal_lines([note(k) for k in range(MOST_OF_A_FILE)]))) == MOST_OF_A_FILE
    notes = [note(k) for k in range(200)] + [note(300, "warning"), note(301, "not executed")]
    lines = list(terminal_lines(notes))
    assert lines[:2] == [str(note(300, "warning")), str(note(301, "not executed"))]
    assert lines[2:-1] == [str(note(k)) for k in range(3)]
    assert lines[-1] == "nav2.yaml: and 197 more that are not modeled (`vastflow params nav2.yaml` shows them all)"
    files = ("a.vast", "rooms.fpm")
    lines = list(terminal_lines([note(k, "warning", file) for k in range(1, 10) for file in files]))
    of_campaign = [line for line in lines if line.startswith("a.vast")]
    assert of_campaign == [str(note(k, "warning", "a.vast")) for k in range(1, 10)]
    assert len(lines) == 9 + 4
    assert lines[-1] == "rooms.fpm: and 6 more warnings (`vastflow floorplan geometry rooms.fpm` shows them all)"
