"""Controllers that a campaign needs compiled: each once, and none that nothing drives by."""

from pathlib import Path

from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.tasks.engine.engine import controllers_in


def test_each_controller_is_asked_for_once_by_what_chooses_it():
    systems = [
        {"controller": "rpp", "desired_linear_vel": 0.2},
        {"noise": 0.1},
        {"controller": "mppi"},
        {"controller": "rpp"},
    ]
    assert controllers_in(systems) == [{"controller": "rpp"}, {}]


def test_where_nothing_drives_there_are_none():
    assert controllers_in([]) == []


def test_controller_that_there_is_not_is_left_to_its_runs():
    assert controllers_in([{"controller": "nonsense"}, {"controller": "dwb"}]) == [{"controller": "dwb"}]


QUICKSTART = Path(__file__).parents[2] / "campaigns" / "quickstart" / "quickstart.vast"
NOTHING = 'import osc.helpers\n\nscenario nothing:\n    level: int\n    do serial:\n        log("done")\n'


@each_row("campaign, drives", [("room", True), ("nothing", False)])
def test_family_says_whether_a_robot_drives_in_it(tmp_path, campaign, drives):
    (tmp_path / "nothing.osc").write_text(NOTHING)
    nothing = tmp_path / "nothing.vast"
    nothing.write_text(
        "version: 1\nmetadata: {name: nothing}\nconfiguration:\n- name: all\n  parameters: [{level: 1}]\n"
        "execution: {scenario_file: nothing.osc, runs: 2, timeout: 10}\n"
    )
    families = load_campaign(QUICKSTART if campaign == "room" else nothing).families
    assert {family.drives for family in families} == {drives}
