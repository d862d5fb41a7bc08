"""A campaign's Nav2 parameter file: what it means for the families, its faults and notes with their places."""

import re

import pytest
from families import write_map

from vastflow.producers.campaign import load_campaign
from vastflow.producers.campaign_file.scenario_values import complaint_of, unread_keys
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.parameter_files.chosen import parameters_of

CAMPAIGN = """\
configuration:
- name: a
  parameters:
  - map_file: room.yaml
  - start_pose: {x: 0.5, y: 0.5}
  - goal_pose: {x: 1.5, y: 0.5}
PARAMETERS
  variations:
VARIATIONS
execution:
  nav2_params: mine/nav2.yaml
"""
NAV2 = """\
controller_server:
  ros__parameters:
    controller_frequency: 20.0
    controller_plugins: [FollowPath]
    FollowPath:
      plugin: "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
      desired_linear_vel: 0.4
local_costmap:
  local_costmap:
    ros__parameters:
      robot_radius: 0.3
"""


@pytest.fixture
def load(tmp_path):
    write_map(tmp_path)
    (tmp_path / "mine").mkdir()

    def load_text(nav2, parameters="", variations="    []", name="mine/nav2.yaml"):
        text = CAMPAIGN.replace("PARAMETERS\n", parameters).replace("VARIATIONS", variations)
        (tmp_path / "c.vast").write_text(text.replace("mine/nav2.yaml", name))
        (tmp_path / "mine" / "nav2.yaml").write_text(nav2)
        return load_campaign(tmp_path / "c.vast")

    return load_text


def said(load, *arguments):
    """The notes on a campaign and its parameter file, or the faults."""
    try:
        found = load(*arguments).notes
    except FileError as error:
        found = error.faults
    return [re.sub(r"/\S*/", "", str(each)) for each in found]


def test_comment_in_the_file_changes_no_scenario_and_a_value_does(load):
    digests = [
        instantiate(load(text)).configurations[0].scenario.digest
        for text in (NAV2, f"# Mine.\n{NAV2}", NAV2.replace("0.3", "0.31"))
    ]
    assert digests[0] == digests[1] != digests[2]


def test_fixed_and_varied_parameters_rewrite_the_file(load):
    campaign = load(
        NAV2,
        "  - local_costmap.robot_radius: 0.25\n",
        "  - ParameterVariationList: {name: desired_linear_vel, values: ['0.2', 0.3]}",
    )
    found = [parameters_of(c.scenario.system) for c in instantiate(campaign).configurations]
    assert {p.local_costmap.robot_radius for p in found} == {0.25}
    assert [p.controller.desired_linear_vel for p in found] == [0.2, 0.3]  # type: ignore[union-attr]


def test_notes_and_faults_of_a_parameter_file_have_place_and_message(golden, load):
    golden("campaign_files", "nav2_params", lambda text: said(load, text))


def test_notes_and_faults_of_parameters_beside_a_file_have_place_and_message(golden, load):
    def of_parameters(lines):
        return [
            each for each in said(load, NAV2, "".join(f"  {line}\n" for line in lines.splitlines())) if each[0] == "c"
        ]

    golden("campaign_files", "nav2_values", of_parameters)


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("mine/none.yaml", "there is no file 'mine/none.yaml'"),
        ("3", "expected text in quotes, got 3"),
    ],
)
def test_name_of_no_file_is_one_fault(load, name, fault):
    assert said(load, NAV2, "", "    []", name) == [f"c.vast:10:16: execution.nav2_params: {fault}"]


KEPT_OUT = """\
global_costmap:
  global_costmap:
    ros__parameters: {filters: [k], k.plugin: "nav2_costmap_2d::KeepoutFilter"}
"""


def test_mask_is_read_as_a_map_is_fixed_or_produced(load):
    produced = "  - ParameterVariationList: {name: keepout_mask, values: [room.yaml]}"
    for campaign in (load(KEPT_OUT, "  - keepout_mask: room.yaml\n"), load(KEPT_OUT, "", produced)):
        (configuration,) = instantiate(campaign).configurations
        assert configuration.scenario.system["keepout_mask"] == configuration.scenario.environment["map_file"]
    (found,) = said(load, KEPT_OUT, "  - keepout_mask: nowhere.yaml\n")
    assert "c.vast:7:19: configuration[0].parameters[3].keepout_mask: " in found


def test_produced_values_are_checked_with_the_controller_they_are_for(load):
    producer = "  - ParameterVariationList: {name: max_vel_theta, values: [1.0, -1.0]}"
    found = said(load, NAV2, "", producer)
    assert "values[1]: expected a number in [0, 100], got -1.0" in found[0] + found[-1]


def test_keys_of_a_controller_are_read_where_the_controller_varies():
    assert unread_keys({}, ["controller", "desired_linear_vel", "max_vel_x", "sped"]) == ("sped",)
    assert unread_keys({"controller": "dwb"}, ["desired_linear_vel", "max_vel_x"]) == ("desired_linear_vel",)
    assert unread_keys({"critics": ["PathDist"]}, ["controller"]) == ()


def test_controller_that_does_not_go_with_the_critics_is_refused():
    fixed = {"controller": "dwb", "critics": ["PathDist", "GoalDist"]}
    assert complaint_of("controller", "dwb", "system", fixed) is None
    found = complaint_of("controller", "mppi", "system", fixed)
    assert found is not None
    assert found[1].startswith("one that goes with the rest (critics: MPPI has no critic 'PathDist'")
