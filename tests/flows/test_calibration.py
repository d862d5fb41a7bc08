"""Calibration from bags whose noise is planted by a generator of its own."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from command_line import called, refused
from real_bags import Recorder, drawn_map, driven
from room import drawn_room

from vastflow.flows.bags.bag import BagError
from vastflow.flows.bags.calibration import _noise, calibrate, deviation_interval, section_of
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.sim.world.world import map_content, read_grid

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


def fitted(path, ground=None, **options):
    return {each.name: each for each in calibrate([path], ground, **options).fitted}


@pytest.fixture(scope="module")
def ground(tmp_path_factory):
    return read_grid(map_content(drawn_map(tmp_path_factory.mktemp("map"))))


@pytest.fixture(scope="module")
def noisy(tmp_path_factory):
    return NOISY.write(tmp_path_factory.mktemp("bags") / "noisy", drive(1))


def test_straight_wall_leaves_no_difference_however_coarse_the_beams():
    bearings_rad = np.arange(-1.0, 1.05, 0.1)
    assert np.abs(_noise(2.0 / np.cos(bearings_rad), 0.1, None)).max() < 1e-12


@pytest.mark.parametrize("with_map", [True, False])
def test_calibration_recovers_planted_values(noisy, ground, with_map):
    found = fitted(noisy, ground if with_map else None)
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


def test_calibration_is_robust_against_unmapped_objects(tmp_path, ground):
    class Crowded(Recorder):
        def messages(self, drive):
            for log_s, topic, message in super().messages(drive):
                if topic == "/scan":
                    message.ranges[100:130] = 0.7 + 0.2 * np.random.default_rng(0).random(30)
                yield log_s, topic, message

    crowded = Crowded(**vars(NOISY)).write(tmp_path / "crowded", drive(3))
    found = fitted(crowded, ground)["lidar noise"]
    assert found.low <= 0.03 <= found.high


def test_calibration_without_a_true_pose_leaves_odometry_out(tmp_path, ground):
    path = replace(NOISY, truth="", estimate_off_m=0.0).write(tmp_path / "plain", drive(4))
    found = calibrate([path], ground)
    names = {each.name for each in found.fitted}
    assert names == {"lidar noise", "lidar dropout", "dead time of commands", "actuator lag"}
    assert [note for note in found.notes if "odometry" in note] == [
        "plain: no true pose: the estimate follows odometry between its updates, so that odometry's noise can't be told from it"
    ]


def test_calibration_takes_the_lidars_place_where_the_bag_lacks_it(tmp_path, ground):
    path = replace(NOISY, static=False).write(tmp_path / "bare", drive(5))
    without = calibrate([path], ground)
    assert any("nor --lidar X,Y,YAW" in note for note in without.notes)
    found = fitted(path, ground, mount=(0.1, 0.0, 0.4))["lidar noise"]
    assert found.low <= 0.03 <= found.high


def test_calibration_of_nothing_is_refused(tmp_path):
    bare = replace(NOISY, scans=False, truth="")

    class Mute(Recorder):
        def messages(self, drive):
            return (row for row in super().messages(drive) if row[1] != "/cmd_vel")

    path = Mute(**vars(bare)).write(tmp_path / "mute", driven(lengths_m=(1.0,)))
    with pytest.raises(
        BagError, match="expected scans, a true pose, or commands with odometry, got none \\(mute: no scans, mute: "
    ):
        calibrate([path], None)


def test_section_is_one_that_a_campaign_file_takes(tmp_path, noisy):
    drawn_room(tmp_path)
    section = yaml.safe_load(section_of(calibrate([noisy], None)))
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
    assert refused("calibrate", noisy, "--map", tmp_path / "none.yaml").startswith("--map: ")
    assert refused("calibrate", noisy, "--lidar", "1") == "--lidar: expected X,Y,YAW in m and rad, got '1'"


def test_deviation_interval_holds_the_deviation_at_its_level():
    rng = np.random.default_rng(0)
    found = [deviation_interval((0.04 * rng.normal(size=20)) ** 2) for _ in range(2000)]
    assert np.mean([low <= 0.04 <= high for _, low, high in found]) >= 0.975


@pytest.mark.slow
def test_calibration_recovers_planted_values_in_19_of_20_bags(tmp_path, ground):
    missed = dict.fromkeys(PLANTED, 0)
    for seed in range(20):
        path = replace(NOISY, seed=seed).write(tmp_path / f"bag{seed}", drive(100 + seed))
        found = fitted(path, ground if seed % 2 else None)
        for name, planted in PLANTED.items():
            missed[name] += not found[name].low <= planted <= found[name].high
    assert max(missed.values()) <= 1, missed
