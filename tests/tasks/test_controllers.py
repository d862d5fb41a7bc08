"""Controllers whose kernels a campaign needs compiled."""

from pathlib import Path

import pytest

from vastflow.producers.campaign import load_campaign
from vastflow.tasks.engine.engine import controllers_in


@pytest.mark.parametrize(
    ("systems", "controllers"),
    [
        (
            [{"controller": "rpp", "desired_linear_vel": 0.2}, {"noise": 0.1}, {"controller": "mppi"}],
            [{"controller": "rpp"}, {}],
        ),
        ([], []),
        ([{"controller": "nonsense"}, {"controller": "dwb"}], [{"controller": "dwb"}]),
    ],
)
def test_controllers_are_listed_once_by_their_choice_without_unknown_ones(systems, controllers):
    assert controllers_in(systems) == controllers


QUICKSTART = Path(__file__).parents[2] / "campaigns" / "quickstart" / "quickstart.vast"


def test_robot_drives_in_a_family_with_a_map(tmp_path):
    (tmp_path / "nothing.osc").write_text(
        'import osc.helpers\n\nscenario nothing:\n    level: int\n    do serial:\n        log("done")\n'
    )
    nothing = tmp_path / "nothing.vast"
    nothing.write_text(
        "version: 1\nmetadata: {name: nothing}\nconfiguration:\n- name: all\n  parameters: [{level: 1}]\n"
        "execution: {scenario_file: nothing.osc, runs: 2, timeout: 10}\n"
    )
    drives = [{family.drives for family in load_campaign(file).families} for file in (QUICKSTART, nothing)]
    assert drives == [{True}, {False}]
