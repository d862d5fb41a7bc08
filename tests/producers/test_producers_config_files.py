"""Configuration files of a campaign: declared, checked with their parameters, and varied."""

import sys

import pytest

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.faults import FileError
from vastflow.sim.reading.checked import checked_digest, checked_of
from vastflow.sim.run import execute

VAST = """\
version: 1
configuration:
  - name: speed
    parameters:
      - sut.nav2.follower.ros__parameters.gain: 2
    variations:
      - ParameterVariationList: {name: sut.nav2.follower.ros__parameters.speed, values: [0.2, 0.3]}
      - ParameterVariationDistributionUniform: {name: sut.tree.//RateController/@hz, num_variations: 2, min: 1, max: 5}
    constraints:
      - slow: "`sut.nav2.follower.ros__parameters.speed` * sut.nav2.follower.ros__parameters.gain < 0.9"
execution:
  scenario_file: drive.osc
  config_files: {nav2: params/nav2.yaml, tree: tree.xml}
"""
SCENARIO = """import osc.helpers

scenario drive:
    timeout(60s)
    do serial:
        run_process("true")
"""
NAV2 = "follower:\n  ros__parameters: {speed: 0.3, gain: 1.0}\n"


@pytest.fixture
def campaign(tmp_path):
    """Writes the campaign with replacements, and reads it."""
    (tmp_path / "params").mkdir()
    (tmp_path / "params/nav2.yaml").write_text(NAV2)
    (tmp_path / "tree.xml").write_text('<root><RateController hz="1.0"/></root>')
    (tmp_path / "drive.osc").write_text(SCENARIO)

    def load(*replacements):
        text = VAST
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "a.vast").write_text(text)
        return load_campaign(tmp_path / "a.vast")

    return load


def test_producers_and_constraints_vary_parameters_of_files(campaign):
    made = instantiate(campaign()).configurations
    assert len(made) == 4
    for each in made:
        setup = checked_of(each.scenario).programs
        assert setup.parameters["params/nav2.yaml"] == {
            "follower.ros__parameters.gain": 2,
            "follower.ros__parameters.speed": each.factors["sut.nav2.follower.ros__parameters.speed"],
        }
        assert 1 <= setup.parameters["tree.xml"]["//RateController/@hz"] <= 5
    assert len({checked_digest(each.scenario) for each in made}) == 4
    faster = instantiate(campaign(("[0.2, 0.3]", "[0.2, 0.5]"))).configurations
    assert len(faster) == 2, "the constraint leaves out 2 * 0.5"


def test_output_of_a_program_varies_with_the_parameter_of_its_file(campaign, tmp_path):
    (tmp_path / "read.py").write_text(
        "speed = open('params/nav2.yaml').read().split('speed: ')[1].split(',')[0]\n"
        "open('out.csv', 'w').write(f'speed\\n{speed}\\n')\n"
    )
    (tmp_path / "drive.osc").write_text(SCENARIO.replace("true", f"{sys.executable} -S -E read.py"))
    made = instantiate(campaign(("  config_files", "  run_files: [read.py]\n  config_files"))).configurations
    found = [execute(each.scenario, 0).recording.outputs.tables["out"]["speed"].tolist() for each in made]
    assert found == [[0.2], [0.2], [0.3], [0.3]]
    assert (tmp_path / "params/nav2.yaml").read_text() == NAV2


def test_edit_reaches_the_configurations_that_have_it(campaign, tmp_path):
    def digests(*replacements):
        return [checked_digest(each.scenario) for each in instantiate(campaign(*replacements)).configurations]

    before = digests()
    assert digests(("sut.nav2", "sut.stack"), ("nav2: p", "stack: p")) == before
    assert [a == b for a, b in zip(digests(("[0.2,", "[0.25,")), before, strict=True)] == [False, False, True, True]
    (tmp_path / "params/nav2.yaml").write_text(NAV2 + "other: 1\n")
    assert not {*digests()} & {*before}


def test_scenario_that_can_not_be_read_is_the_only_fault(campaign, tmp_path):
    (tmp_path / "drive.osc").write_text("scenario")
    with pytest.raises(FileError, match=r"drive\.osc:1:9") as error:
        campaign()
    assert len(error.value.faults) == 1


@pytest.mark.parametrize(
    ("replacements", "said"),
    [
        ([("sut.nav2.follower.ros__parameters.gain", "sut.nav.follower.ros__parameters.gain")], r"5:48: .*There is no config file 'nav'\. Did you mean 'nav2'\?"),
        ([(", tree: tree.xml", ", tree: trees.xml")], r"13:48: execution\.config_files\.tree: trees\.xml:1:1: No such file"),
        ([("tree: tree.xml", "tree: drive.osc")], r"expected a file that ends with \.yaml"),
        ([("tree: tree.xml", "tree: ../tree.xml")], r"expected a path below the campaign file's folder"),
        ([("tree: tree.xml", "tr.ee: tree.xml")], r"config_files.tr\.ee"),
        ([("follower.ros__parameters.gain: 2", "follower.gian: 2")], r"There is no 'follower\.gian'\. Did you mean 'follower\.gain'"),
        ([("gain: 2", "gain: high")], r"expected a number, as in the file, got 'high'"),
        ([("[0.2, 0.3]", "[0.2, fast]")], r"7:\d+: .*values\[1\]: expected a number, as in the file, got 'fast'"),
        ([("scenario_file: drive.osc\n", "runs: 1\n")], r"No process reads 'sut\.nav2\.follower\.ros__parameters\.gain'"),
    ],
)  # fmt: skip
def test_wrong_file_or_parameter_is_one_sentence_with_its_place(campaign, replacements, said):
    with pytest.raises(FileError, match=said):
        campaign(*replacements)
