"""Lidar noise as plug-ins: one file beside the campaign, checked by the conformance suite, run at the scanner's rate."""

import re
from pathlib import Path

import numpy as np
import pytest
from table import each_row

from vastflow.flows.results.inputs import inputs_of
from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.reading.checked import checked_digest
from vastflow.sim.run import run
from vastflow.sim.world.noise_conformance import check_lidar_noise, check_time
from vastflow.sim.world.noise_registry import GaussianDropoutParameters, find_lidar_noise

PAGE = Path(__file__).parents[2] / "docs" / "write-lidar-noise.md"


@pytest.fixture
def folder(tmp_path):
    """The file of the page on lidar noise."""
    (text,) = re.findall(r"^```\w+ range_noise.py\n((?:.*\n)*?)^```$", PAGE.read_text(), re.MULTILINE)
    (tmp_path / "range_noise.py").write_text(text)
    return tmp_path


@pytest.fixture
def configurations(folder, two_rooms):
    """The configurations of a campaign whose lidar has this noise."""
    place = f"{{map_file: {two_rooms.path}}}, {{start_pose: {{x: 1, y: 1}}}}, {{goal_pose: {{x: 2, y: 1}}}}"

    def made(noise, variations="[]"):
        file = folder / "noise.vast"
        robot = f"{{lidar: {{noise: {noise}}}}}"
        file.write_text(
            f"configuration:\n- name: home\n  robot: {robot}\n  parameters: [{place}]\n  variations: {variations}\n"
            "execution: {timeout: 3}\n"
        )
        campaign = load_campaign(file)
        return campaign, [each.scenario for each in instantiate(campaign).configurations]

    return made


def recorded(scenario):
    return run(scenario, 0, 0).columns


def test_page_model_and_installed_model_keep_contract(folder):
    check_lidar_noise(find_lidar_noise("range_noise.py:RangeNoise", folder)())
    check_lidar_noise(find_lidar_noise("gaussian_dropout")(laserscan_gaussian_noise_std_deviation=0.1))


def test_campaign_runs_noise_model_of_one_file(configurations):
    _, (silent, noisy) = configurations(
        "{model: range_noise.py:RangeNoise}",
        "[ParameterVariationList: {name: robot.lidar.noise.std_per_m, values: [0.0, 0.2]}]",
    )
    assert parameters_of(noisy.system).lidar_noise.std_per_m == 0.2
    exact, other = recorded(silent), recorded(noisy)
    _, (plain,) = configurations("{}")
    assert all(np.array_equal(exact[name], recorded(plain)[name]) for name in exact)
    assert not np.array_equal(exact["estimated_x_mm"], other["estimated_x_mm"])
    assert all(np.array_equal(other[name], recorded(noisy)[name]) for name in other)


def test_producers_vary_noise_models(configurations):
    models = "{name: robot.lidar.noise.model, values: [gaussian_dropout, range_noise.py:RangeNoise]}"
    campaign, scenarios = configurations("{}", f"[ParameterVariationList: {models}]")
    kinds = [type(parameters_of(scenario.system).lidar_noise).__name__ for scenario in scenarios]
    assert kinds == ["GaussianDropoutParameters", "RangeNoise"]
    assert "range_noise.py" in inputs_of(campaign, []).files


def test_edited_noise_model_changes_execute_key(configurations, folder):
    noise = "{model: range_noise.py:RangeNoise, std_per_m: 0.2}"
    campaign, (before,) = configurations(noise)
    digest, file = checked_digest(before), folder / "range_noise.py"
    text = file.read_text()
    file.write_text(text.replace("+=", "-="))
    _, (after,) = configurations(noise)
    assert checked_digest(after) != digest
    assert inputs_of(campaign, []).files["range_noise.py"].decode() == text
    assert not np.array_equal(recorded(before)["estimated_x_mm"], recorded(after)["estimated_x_mm"])


@each_row(
    ("noise", "message"),
    [
        ("{model: gausian_dropout}", "Did you mean 'gaussian_dropout'?"),
        (
            "{model: other_noise.py:RangeNoise}",
            "Expected one of gaussian_dropout, or file.py:Class for one of your own",
        ),
        ("{model: range_noise.py:RangeNose}", "Did you mean 'RangeNoise'?"),
        ("{model: range_noise.py:RangeNoise, std_per: 0.1}", "Did you mean 'std_per_m'?"),
        ("{model: range_noise.py:RangeNoise, std_per_m: 3}", "std_per_m: expected a number in [0, 1], got 3"),
    ],
)
def test_validation_refuses_wrong_noise_at_its_line(configurations, noise, message):
    with pytest.raises(FileError, match=re.escape(message)) as caught:
        configurations(noise)
    assert all(fault.place.line == 3 for fault in caught.value.faults)


def test_noise_that_takes_too_long_fails_its_check(folder):
    with pytest.raises(AssertionError, match=r"range_noise.py:\d+: RangeNoise must take at most 0 µs a scan"):
        check_time(find_lidar_noise("range_noise.py:RangeNoise", folder)(), 0.0)


def test_default_noise_has_names_of_launch_arguments():
    expected = GaussianDropoutParameters(laserscan_random_drop_percentage=0.5)
    assert parameters_of({"random_drop_percentage": 0.5}).lidar_noise == expected
