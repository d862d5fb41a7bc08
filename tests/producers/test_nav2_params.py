"""A campaign's Nav2 parameter file: what it means for the families, its faults and notes with their places."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from table import each_row

from vastflow.producers.campaign import Campaign, load_campaign
from vastflow.producers.campaign_file.scenario_values import complaint_of, unread_keys
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file

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

Load = Callable[..., Campaign]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "room.yaml").write_text("{image: room.pgm, resolution: 0.05, origin: [0.0, 0.0, 0.0]}")
    (tmp_path / "room.pgm").write_bytes(b"P5\n40 20\n255\n" + bytes([255]) * 800)
    (tmp_path / "mine").mkdir()
    return tmp_path


@pytest.fixture
def load(folder: Path) -> Load:
    def load_text(nav2: str, parameters: str = "", variations: str = "    []") -> Campaign:
        text = CAMPAIGN.replace("PARAMETERS\n", parameters).replace("VARIATIONS", variations)
        (folder / "c.vast").write_text(text)
        (folder / "mine" / "nav2.yaml").write_text(nav2)
        return load_campaign(folder / "c.vast")

    return load_text


def faults(load: Load, *arguments: str) -> list[str]:
    with pytest.raises(FileError) as caught:
        load(*arguments)
    return [
        f"{Path(fault.place.file).name}{str(fault).removeprefix(fault.place.file)}" for fault in caught.value.faults
    ]


def notes(campaign: Campaign) -> list[str]:
    return [f"{Path(note.place.file).name}{str(note).removeprefix(note.place.file)}" for note in campaign.notes]


def system(campaign: Campaign) -> Any:
    (configuration,) = instantiate(campaign).configurations
    return configuration.scenario.system


def test_file_is_in_every_scenarios_system_by_its_content(load: Load, folder: Path) -> None:
    value = system(load(NAV2))["nav2_params"]
    assert isinstance(value, FileContent)
    assert value == nav2_file(folder / "mine" / "nav2.yaml")


def test_comment_in_the_file_changes_no_scenario_and_a_value_does(load: Load) -> None:
    digests = [
        instantiate(load(text)).configurations[0].scenario.digest
        for text in (NAV2, f"# Mine.\n{NAV2}", NAV2.replace("0.3", "0.31"))
    ]
    assert digests[0] == digests[1] != digests[2]


def test_fixed_and_varied_parameters_rewrite_the_file(load: Load) -> None:
    campaign = load(
        NAV2,
        "  - local_costmap.robot_radius: 0.25\n",
        "  - ParameterVariationList: {name: desired_linear_vel, values: ['0.2', 0.3]}",
    )
    found = [parameters_of(c.scenario.system) for c in instantiate(campaign).configurations]
    assert {p.local_costmap.robot_radius for p in found} == {0.25}
    assert [p.controller.desired_linear_vel for p in found] == [0.2, 0.3]  # type: ignore[union-attr]


def test_file_of_which_everything_is_modeled_is_noted_for_its_missing_nodes_alone(load: Load) -> None:
    assert notes(load(NAV2)) == [
        (
            "nav2.yaml:1:1: warning: file: has no amcl, global_costmap, planner_server, behavior_server, "
            "waypoint_follower; as in Nav2 Jazzy's default file"
        ),
        "nav2.yaml:1:1: warning: file: has no velocity_smoother, collision_monitor; the stack does without",
    ]


def test_what_is_not_modeled_is_noted_once_with_its_place(load: Load) -> None:
    text = NAV2.replace("controller_frequency: 20.0", "costmap_update_timeout: 0.5").replace(
        "robot_radius: 0.3", "map_vis_z: 0.1"
    )
    found = notes(
        load(f"{text}ekf:\n  ros__parameters:\n    a: 1\n    b: {{c: 2}}\n      \namcl: {{ros__parameters: {{x: 1}}}}")
    )
    assert found[2:] == [
        "nav2.yaml:3:29: controller_server.costmap_update_timeout: expected 0.3 is built in, got 0.5, which is not modeled",
        "nav2.yaml:11:18: local_costmap.local_costmap.map_vis_z: not modeled",
        "nav2.yaml:13:3: ekf: its 2 parameters are not modeled; nothing of this node is",
        "nav2.yaml:17:29: amcl.x: not modeled",
    ]  # fmt: skip


def test_rate_that_is_no_whole_number_of_ticks_is_noted_with_the_one_it_runs_at(load: Load) -> None:
    (said,) = notes(load(NAV2.replace("20.0", "8.0")))[2:]
    assert said == (
        "nav2.yaml:3:27: warning: controller_server.controller_frequency: "
        "expected runs at 10 Hz, got 8.0, which is no whole number of ticks of 50 ms"
    )
    assert notes(load(NAV2.replace("20.0", "10.0")))[2:] == []


def test_value_that_a_later_one_takes_the_place_of_is_noted(load: Load) -> None:
    assert notes(load(f"{NAV2}      robot_radius: 0.4\n"))[2] == (
        "nav2.yaml:12:21: warning: local_costmap.local_costmap.robot_radius: a second time; this value counts"
    )


def test_controller_without_critics_is_noted(load: Load) -> None:
    text = "controller_server: {ros__parameters: {controller_plugins: [F], F: {plugin: 'dwb_core::DWBLocalPlanner', critics: []}}}"
    assert notes(load(text))[2] == (
        "nav2.yaml:1:21: warning: controller_server: enables no critic of its controller; it will not follow a path"
    )


def test_faults_of_campaign_and_parameter_file_come_together_each_at_its_place(load: Load) -> None:
    text = NAV2.replace("0.3", "-0.3").replace("RegulatedPurePursuitController", "Pursuit")
    assert [found.split(": ")[0] for found in faults(load, text, "  - goal_poses: []\n")] == [
        "c.vast:7:17",
        "nav2.yaml:6:15",
        "nav2.yaml:11:21",
    ]


@each_row(
    ("text", "message"),
    [
        ("a: [\n", "nav2.yaml:2:1: file: not YAML: "),
        ("- 1", "nav2.yaml:1:1: file: expected a whole Nav2 parameter file"),
        ("a: {b: {}}", "nav2.yaml:1:1: file: no ros__parameters anywhere; "),
        (
            NAV2.replace("0.3", "wide"),
            "nav2.yaml:11:21: local_costmap.local_costmap.ros__parameters.robot_radius: expected ",
        ),
    ],
)
def test_file_that_cannot_be_used_is_a_fault(load: Load, text: str, message: str) -> None:
    (found,) = faults(load, text)
    assert found.startswith(message)


def test_file_that_is_not_there_is_a_fault_of_the_campaign(load: Load, folder: Path) -> None:
    load(NAV2)
    (folder / "mine" / "nav2.yaml").unlink()
    with pytest.raises(
        FileError, match=r"c.vast:\d+:16: execution.nav2_params: expected .*got 'mine/nav2.yaml', and there"
    ):
        load_campaign(folder / "c.vast")


def test_name_that_is_no_text_is_one_fault(load: Load, folder: Path) -> None:
    load(NAV2)
    text = (folder / "c.vast").read_text().replace("mine/nav2.yaml", "3")
    (folder / "c.vast").write_text(text)
    with pytest.raises(FileError, match=r"execution\.nav2_params: expected text in quotes, got 3") as caught:
        load_campaign(folder / "c.vast")
    assert len(caught.value.faults) == 1


def test_fixed_parameter_is_checked_against_the_file(load: Load) -> None:
    (found,) = faults(load, NAV2, "  - FollowPath.plugin: 'x::Y'\n")
    assert found.startswith(
        "c.vast:7:24: configuration[0].parameters[3].FollowPath.plugin: expected one of dwb_core::DWB"
    )


def test_key_that_the_file_does_not_have_is_unread(load: Load) -> None:
    assert notes(load(NAV2, "  - sigma_hit: 0.1\n"))[0] == (
        "c.vast:7:5: warning: configuration[0].parameters[3].sigma_hit: unknown key 'sigma_hit' is ignored"
    )


KEPT_OUT = """\
global_costmap:
  global_costmap:
    ros__parameters: {filters: [k], k.plugin: "nav2_costmap_2d::KeepoutFilter"}
"""


def test_filter_without_a_mask_is_a_fault_with_the_line_that_would_be_right(load: Load) -> None:
    (found,) = faults(load, KEPT_OUT)
    assert found.startswith(
        "c.vast:3:3: configuration[0].parameters: the keepout filter of the global_costmap has no mask; "
    )
    assert found.endswith("'keepout_mask: keepout.yaml', a map_server YAML file")


def test_mask_is_read_as_a_map_is_fixed_or_produced(load: Load) -> None:
    produced = "  - ParameterVariationList: {name: keepout_mask, values: [room.yaml]}"
    for campaign in (load(KEPT_OUT, "  - keepout_mask: room.yaml\n"), load(KEPT_OUT, "", produced)):
        (configuration,) = instantiate(campaign).configurations
        assert configuration.scenario.system["keepout_mask"] == configuration.scenario.environment["map_file"]
    (found,) = faults(load, KEPT_OUT, "  - keepout_mask: nowhere.yaml\n")
    assert "c.vast:7:19: configuration[0].parameters[3].keepout_mask: " in found


def test_every_fixed_parameter_that_is_wrong_is_named(load: Load) -> None:
    found = faults(load, NAV2, "  - robot_radius: wide\n  - desired_linear_vel: -1\n")
    assert [line.split(": ")[0] for line in found] == ["c.vast:7:19", "c.vast:8:25"]


def test_family_names_no_file_of_its_own(load: Load) -> None:
    (found,) = faults(load, NAV2, "  - nav2_params: other.yaml\n")
    assert "nav2_params: expected execution.nav2_params, the file of all families, got 'other.yaml'" in found


def test_produced_values_are_checked_with_the_controller_they_are_for(load: Load) -> None:
    producer = "  - ParameterVariationList: {name: max_vel_theta, values: [1.0, -1.0]}"
    (found,) = faults(load, NAV2, "", producer)
    assert "values[1]: expected a number in [0, 100], got -1.0" in found


def test_keys_of_a_controller_are_read_where_the_controller_varies() -> None:
    assert unread_keys({}, ["controller", "desired_linear_vel", "max_vel_x", "sped"]) == ("sped",)
    assert unread_keys({"controller": "dwb"}, ["desired_linear_vel", "max_vel_x"]) == ("desired_linear_vel",)
    assert unread_keys({"critics": ["PathDist"]}, ["controller"]) == ()


def test_controller_that_does_not_go_with_the_critics_is_refused() -> None:
    fixed = {"controller": "dwb", "critics": ["PathDist", "GoalDist"]}
    assert complaint_of("controller", "dwb", "system", fixed) is None
    found = complaint_of("controller", "mppi", "system", fixed)
    assert found is not None
    assert found[1].startswith("one that goes with the rest: critics: MPPI has no critic 'PathDist'")
