"""Robots that a campaign describes: their scanner sees and drives as it says."""

import numpy as np
import pytest

from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.run import run

FRONT = {
    "robot.lidar.x": 0.1,
    "robot.lidar.yaw": 0.0,
    "robot.lidar.beams": 181,
    "robot.lidar.angle_min": -1.5707963,
    "robot.lidar.angle_max": 1.5707963,
    "robot.lidar.range_min": 0.1,
    "robot.lidar.range_max": 8.0,
    "robot.lidar.rate": 5.0,
}


@pytest.fixture(scope="module")
def seen(scenario):
    """Scans by tick, and the recording, of a slow robot with a scanner of 181 beams ahead at 5 Hz."""
    scans = {}

    def look(stack, tick):
        m = stack.m[0]
        scans[tick] = m["ranges"][: m["beams"]].copy()

    slow = {"robot.max_speed": 0.3, "robot.max_acceleration": 0.5, "robot.mass": 20.0}
    recording = run(scenario(controller="rpp", **FRONT, **slow), 0, watch=look, watch_ticks=range(1, 41))
    return scans, recording


def test_scans_have_the_beams_ranges_and_rate_of_the_robots_own_scanner(seen):
    first = seen[0][1]
    assert first.shape == (181,)
    assert first[90] == pytest.approx(4.1 - 1.1, abs=0.03)  # the wall before it, from the mount
    assert (first[0], first[180]) == pytest.approx((0.8, 4.2), abs=0.03)  # beside it, right and left
    changes = [tick for tick in range(5, 41) if not np.array_equal(seen[0][tick], seen[0][tick - 1])]
    assert set(np.diff(changes)) == {4}


def test_actuators_enforce_limits_on_any_command(seen):
    assert seen[1].run.outcome == "succeeded"
    columns = seen[1].columns
    assert columns["command_speed_mmps"].max() == 500
    assert columns["speed_mmps"].max() == pytest.approx(300, abs=2)
    assert np.diff(columns["speed_mmps"].astype(int)).max() <= 52  # 0.5 m/s² in 0.1 s


def test_controller_commands_at_the_files_rate(scenario, tmp_path):
    """At 10 Hz a command stands for two ticks."""
    (tmp_path / "nav2.yaml").write_text(
        "controller_server: {ros__parameters: {controller_frequency: 10.0, controller_plugins: [FollowPath], FollowPath: "
        "{plugin: nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController}}}"
    )
    ordered = set()
    slow = scenario(nav2_params=nav2_file(tmp_path / "nav2.yaml"))
    run(slow, 0, watch=lambda stack, _: ordered.add(int(stack.m[0]["command_tick"])), watch_ticks=range(20, 60))
    assert set(np.diff(sorted(ordered))) == {2}
