"""Calibration from bags whose noise is planted by a generator of its own."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from command_line import called, refused
from raster_bags import RasterRecorder, wandering
from real_bags import Recorder, driven
from room import drawn_room

from vastflow.flows.bags.bag import BagError
from vastflow.flows.bags.calibration import _noise, calibrate, deviation_interval, section_of
from vastflow.flows.request.campaign_file import read_campaign

pytestmark = pytest.mark.timeout(900)
PLANTED = {
    "lidar noise": 0.03,
    "lidar dropout": 0.07,
    "odometry translation per meter": 0.04,
    "odometry rotation per radian": 0.04,
    "dead time of commands": 0.08,
    "actuator lag": 0.12,
}
NOISY = Recorder(truth="base_link_gt", scan_noise_m=0.03, dropout=0.07, scan_hz=5.0)


def drive(seed):
    return driven(seed, dead_s=0.08, lag_s=0.12, slip=0.04)


def fitted(path):
    return {each.name: each for each in calibrate([path]).fitted}


@pytest.fixture(scope="module")
def noisy(tmp_path_factory):
    return NOISY.write(tmp_path_factory.mktemp("bags") / "noisy", drive(1))


def test_straight_wall_leaves_no_difference_however_coarse_the_beams():
    bearings_rad = np.arange(-1.0, 1.05, 0.1)
    assert np.abs(_noise(2.0 / np.cos(bearings_rad), 0.1)).max() < 1e-12


def test_calibration_recovers_planted_values(noisy):
    found = fitted(noisy)
    for name, planted in PLANTED.items():
        assert found[name].low <= planted <= found[name].high, found[name]
        widest = 0.15 if "lidar" in name else 1.5 if "rotation" in name else 0.8  # few turns tell little
        assert found[name].high - found[name].low < widest * planted, found[name]


def test_calibration_distinguishes_levels_of_noise(tmp_path):
    quiet = replace(NOISY, scan_noise_m=0.01, dropout=0.2)
    found = fitted(quiet.write(tmp_path / "quiet", driven(2, dead_s=0.2, lag_s=0.05, slip=0.01)))
    for name, planted in zip(PLANTED, (0.01, 0.2, 0.01, 0.01, 0.2, 0.05), strict=True):
        assert found[name].low <= planted <= found[name].high, found[name]
        assert not found[name].low <= PLANTED[name] <= found[name].high, found[name]


def test_calibration_is_robust_against_people(tmp_path):
    class Crowded(Recorder):
        def ranges_from(self, x, y, bearings):
            ranges = super().ranges_from(x, y, bearings)
            for center, far_m in ((40, 0.9), (150, 1.2), (290, 1.8)):  # round, of 0.2 m
                off_m = far_m * np.sin(bearings - bearings[center])
                before = (np.abs(off_m) < 0.2) & (np.cos(bearings - bearings[center]) > 0)
                nearer = far_m * np.cos(bearings - bearings[center]) - np.sqrt(np.maximum(0.04 - off_m**2, 0.0))
                ranges = np.where(before, np.minimum(ranges, nearer), ranges)
            return ranges

    found = fitted(Crowded(**vars(NOISY)).write(tmp_path / "crowded", drive(3)))
    for name in ("lidar noise", "lidar dropout"):
        assert found[name].low <= PLANTED[name] <= found[name].high, found[name]


def test_calibration_without_a_true_pose_leaves_odometry_out(tmp_path):
    found = calibrate([replace(NOISY, truth="", estimate_off_m=0.0).write(tmp_path / "plain", drive(4))])
    names = {each.name for each in found.fitted}
    assert names == {"lidar noise", "lidar dropout", "dead time of commands", "actuator lag"}
    assert found.notes == (
        "plain: no true pose: the estimate follows odometry between its updates, so that odometry's noise can't be told from it",
        "expected at least 8 straight pieces of 0.25 m by odometry and a true pose, got 0",
        "expected at least 8 turns of 0.25 rad on the spot by odometry and a true pose, got 0",
    )


def test_calibration_without_noise_finds_next_to_none(tmp_path):
    found = fitted(
        Recorder(truth="base_link_gt", scan_hz=5.0).write(tmp_path / "ideal", driven(5, dead_s=0.08, lag_s=0.12))
    )
    for name, most in (("lidar noise", 5e-4), ("lidar dropout", 1e-4), ("odometry translation per meter", 1e-6)):
        assert 0.0 <= found[name].low <= found[name].value <= found[name].high < most, found[name]
    assert found["lidar dropout"].low == 0.0 < found["lidar dropout"].high  # none of so many beams, which is not never
    assert found["dead time of commands"].low <= 0.08 <= found["dead time of commands"].high


def test_calibration_of_a_still_robot_fits_its_lidar_alone(tmp_path):
    still = driven(6, lengths_m=(2.0,))
    for moving in (still.command, still.motion):
        moving[:] = 0.0
    still.true[:], still.odometry[:] = still.true[0], 0.0
    found = calibrate([NOISY.write(tmp_path / "still", still)])
    assert {each.name for each in found.fitted} == {"lidar noise", "lidar dropout"}
    assert "expected at least 4 steps of a command that odometry follows, got 0" in found.notes
    noise = found.fitted[0]
    assert noise.low <= 0.03 <= noise.high


def test_calibration_of_a_short_bag_is_refused_with_what_is_missing(tmp_path):
    path = replace(NOISY, scan_hz=1.0).write(tmp_path / "short", driven(7, lengths_m=(0.5,)))
    with pytest.raises(
        BagError, match=r"nothing to fit \(expected at least 20 scans with straight walls, got \d+, expected"
    ):
        calibrate([path])


def test_calibration_of_nothing_is_refused(tmp_path):
    bare = replace(NOISY, scans=False, truth="")

    class Mute(Recorder):
        def messages(self, drive):
            return (row for row in super().messages(drive) if row[1] != "/cmd_vel")

    path = Mute(**vars(bare)).write(tmp_path / "mute", driven(lengths_m=(1.0,)))
    with pytest.raises(
        BagError, match=r"nothing to fit \(mute: no true pose: .*expected at least 20 scans .*, got 0, exp"
    ):
        calibrate([path])


def test_section_is_one_that_a_campaign_file_takes(tmp_path, noisy):
    drawn_room(tmp_path)
    section = yaml.safe_load(section_of(calibrate([noisy])))
    family = {
        "name": "room",
        "parameters": [
            {"map_file": "room.yaml"},
            {"start_pose": {"x": 1.0, "y": 1.0}},
            {"goal_pose": {"x": 3.0, "y": 1.0}},
        ],
        **section,
    }
    (tmp_path / "room.vast").write_text(yaml.safe_dump({"version": 1, "configuration": [family]}))
    campaign, _ = read_campaign(tmp_path / "room.vast", strict=True)
    values = campaign.families[0].values
    assert values["robot.lidar.noise.laserscan_gaussian_noise_std_deviation"] == pytest.approx(0.03, abs=0.002)
    assert values["robot.odometry.translation_std_per_meter"] == pytest.approx(0.04, abs=0.015)


def test_calibrate_command_prints_the_section(noisy, tmp_path):
    told = called("calibrate", noisy)
    assert told.exit_code == 0 and told.stdout.startswith("robot:\n  lidar:\n    noise:\n"), told.output
    assert "# dead time of commands: 0.0" in told.stdout
    assert refused("calibrate", tmp_path / "none").endswith("none: expected a bag, got no such file or folder")


def test_deviation_interval_holds_the_deviation_at_its_level():
    rng = np.random.default_rng(0)
    found = [deviation_interval((0.04 * rng.normal(size=20)) ** 2) for _ in range(2000)]
    assert np.mean([low <= 0.04 <= high for _, low, high in found]) >= 0.975


def missed_of(paths):
    """Quantity to the number of bags whose interval does not hold the planted value."""
    missed = dict.fromkeys(PLANTED, 0)
    for path in paths:
        found = fitted(path)
        for name, planted in PLANTED.items():
            missed[name] += not (name in found and found[name].low <= planted <= found[name].high)
    return missed


@pytest.mark.slow
def test_calibration_recovers_planted_values_in_19_of_20_bags(tmp_path):
    paths = (replace(NOISY, seed=seed).write(tmp_path / f"bag{seed}", drive(100 + seed)) for seed in range(20))
    assert max((missed := missed_of(paths)).values()) <= 1, missed


@pytest.mark.slow
def test_calibration_recovers_planted_values_of_another_generator_in_19_of_20_bags(tmp_path):
    def written(seed):
        recorder = RasterRecorder(truth="base_link_gt", scan_noise_m=0.03, dropout=0.07, scan_hz=5.0, seed=seed)
        return recorder.write(tmp_path / f"bag{seed}", wandering(seed, dead_s=0.08, lag_s=0.12, slip=0.04))

    assert max((missed := missed_of(map(written, range(2000, 2020)))).values()) <= 1, missed
