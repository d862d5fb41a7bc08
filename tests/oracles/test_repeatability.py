"""Pose accuracy and repeatability over the runs of a configuration, and their section of the report."""

import math
import re
import statistics

import numpy as np
import pytest

from vastflow.oracles.page.report import write_report
from vastflow.oracles.statistics.repeatability import LEAST_ENDS, repeatability_of

ENDS = [(0.1, 0.0), (0.1, 0.2), (0.3, 0.0), (0.3, 0.2)] * 3


def test_repeatability_is_that_of_iso_9283_by_hand():
    """All ends are as far from (0.2, 0.1), so nothing is added."""
    x_m, y_m = map(np.array, zip(*ENDS, strict=True))
    found = repeatability_of(x_m, y_m, np.full(12, -0.1))
    assert (found.ends, found.accuracy_m) == (12, pytest.approx(math.hypot(0.2, 0.1)))
    assert found.repeatability_m == pytest.approx(math.hypot(0.1, 0.1))
    assert (found.yaw_accuracy_rad, found.yaw_repeatability_rad) == pytest.approx((0.1, 0.0))


def test_repeatability_adds_three_deviations_of_ends_that_were_reached():
    """On a line the distances from the mean 4.5 are 4.5, 3.5, … 4.5; yaw is a tenth of x."""
    x_m = np.append(np.arange(10.0), np.nan)
    found = repeatability_of(x_m, np.zeros(11), 0.1 * x_m)
    apart_m = [abs(k - 4.5) for k in range(10)]
    assert found.ends == 10
    assert found.repeatability_m == pytest.approx(statistics.mean(apart_m) + 3 * statistics.stdev(apart_m))
    assert found.yaw_repeatability_rad == pytest.approx(3 * statistics.stdev(k / 10 for k in range(10)))
    assert repeatability_of(x_m[1:], np.zeros(10), x_m[1:]) is None and LEAST_ENDS == 10


def test_report_has_final_poses_of_configurations_with_enough_runs(build, tmp_path):
    """The robot ends beside its goal at (5, 2), in turn 0.1 m before it and 0.1 m beyond."""
    room = build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))
    task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
    campaign = build.campaign(tmp_path / "results")
    for name, runs in (("often-1", 12), ("seldom-1", 4)):
        ends_m = [5.0 + (0.1 if k % 2 else -0.1) for k in range(runs)]
        lines = [np.column_stack((np.linspace(1.0, end_m, 40), np.full(40, 2.03))) for end_m in ends_m]
        recordings = [build.a_recording(line, run_index=k) for k, line in enumerate(lines)]
        campaign.add(
            name, name[:-2], room, task, recordings=recordings, oracles=[("navigation", {})], factors={"noise": runs}
        )
    directory = campaign.write()
    write_report(directory)
    text = (directory / "report.html").read_text(encoding="utf-8")
    section = re.search(r'id="poses".*?</details>', text, re.DOTALL)[0]
    # Positions are in whole millimeters: 30 mm to the left, 100 mm from the mean in each run.
    assert "accuracy up to 30 mm, repeatability up to 100 mm" in section
    assert "often-1" in section and "seldom-1" not in section
