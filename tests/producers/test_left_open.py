"""Needs of a scenario file that a family leaves open, and the notes on them."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from families import write_map
from table import each_row

from vastflow.producers.campaign import Campaign, load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.faults import FileError, Got, message_of
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.octile import passable

SCENARIO = """\
import osc.gazebo
import osc.nav2
import osc.ros

scenario go:
    goal_pose: pose_3d
{parameters}    robot: differential_drive_robot
    do parallel:
        ros_launch('nav2_bringup', 'tb4_simulation_launch.py')
        serial:
            robot.init_nav2(pose_3d())
            robot.nav_to_pose(goal_pose)
            emit end
"""
FILE = """\
configuration:
- name: a
  parameters:
{parameters}execution:
  scenario_file: go.osc
{execution}"""
GOAL = "  - goal_pose: {x: 2.0, y: 1.0}\n"
MAP = "  - map_file: room.yaml\n"
Load = Callable[..., Campaign]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    def load_text(parameters: str, own: str = "", execution: str = "") -> Campaign:
        write_map(tmp_path, columns=60, rows=40)
        (tmp_path / "go.osc").write_text(SCENARIO.format(parameters=own))
        (tmp_path / "c.vast").write_text(FILE.format(parameters=parameters, execution=execution))
        return load_campaign(tmp_path / "c.vast")

    return load_text


@each_row(
    ("overrides", "words"),
    [
        ("- gaol_pose: {x: 1.0}", r"'gaol_pose' is not a parameter of go.osc\. Did you mean 'goal_pose'"),
        ("- speed: fast", r"expected a speed, a number in mps, .*got 'fast'"),
        ("- speed: 1.0\n    - speed: 2.0", r"Duplicate key 'speed'"),
    ],
)
def test_unsuitable_override_is_a_fault(load: Load, overrides: str, words: str) -> None:
    local = f"  local:\n    parameter_overrides:\n    {overrides}\n"
    with pytest.raises(FileError, match=r"execution\.local\.parameter_overrides") as raised:
        load(f"{GOAL}{MAP}", "    speed: speed = 0.5mps\n", local)
    assert re.search(words, str(raised.value))


def test_parameter_override_replaces_family_values(load: Load) -> None:
    local = "  local:\n    parameter_overrides:\n    - goal_pose: {x: 1.5, y: 0.5}\n    - speed: 0.3\n"
    vary = "  variations:\n  - ParameterVariationList: {name: speed, values: [0.1, 0.2]}\n"
    campaign = load(f"{GOAL}{MAP}{vary}", "    speed: speed = 0.5mps\n", local)
    assert "execution.local" not in [note.place.where for note in campaign.notes]
    for configuration in instantiate(campaign).configurations:
        assert configuration.scenario.task["goal_pose"] == {"x": 1.5, "y": 0.5}
        assert configuration.factors["speed"] == 0.3


def said(campaign: Campaign) -> list[str]:
    return [
        message_of(note.problem, note.expected)
        for note in campaign.notes
        if note.place.where == "execution.scenario_file"
    ]


def test_example_simulation_is_replaced_by_hall(load: Load) -> None:
    campaign = load(GOAL)
    found = campaign.families[0].values["map_file"]
    assert isinstance(found, FileContent)
    hall = load_map(found.path)
    assert hall.shape == (1200, 1200) and hall.occupied.any()
    fits = passable(hall, 0.3)
    assert all(fits[hall.cell_of(float(x), float(y))] for x in range(-29, 30) for y in range(-29, 30))
    (note,) = said(campaign)
    assert note.startswith(
        "The scenario launches a simulation with a map of its own, which is not here. The robot drives in a hall"
    )


@each_row(("own", "key"), [("    map_file: string\n", "map_file"), ("    speed: float\n", "speed")])
def test_scenario_needs_its_parameters_without_a_value_from_the_family(load: Load, own: str, key: str) -> None:
    with pytest.raises(FileError, match=rf"go.osc needs {key}, which nothing writes"):
        load(GOAL, own=own)


@each_row(
    ("goals", "given"),
    [
        ("  - goal_poses: [{x: 2.0, y: 1.0}, {x: 1.0, y: 1.0}]\n", "goal_poses"),
        ("  - goal_pose1: {x: 2.0, y: 1.0}\n  - goal_pose2: {x: 1.0, y: 1.0}\n", "goal_pose1 to goal_pose2"),
    ],
)
def test_several_goals_are_visited_in_turn(load: Load, goals: str, given: str) -> None:
    campaign = load(goals + MAP)
    found = campaign.families[0].values["map_file"]
    assert isinstance(found, FileContent) and Path(found.path).name == "room.yaml"
    assert said(campaign) == [
        f"The scenario takes one goal_pose, and there are {given}. The robot is sent to each of them in turn."
    ]
    assert not [note for note in campaign.notes if note.kind == "unknown key"]


def test_omitted_spawn_objects_are_none(load: Load) -> None:
    campaign = load(GOAL + MAP, own="    static_objects: list of spawn_entity\n")
    assert said(campaign) == ["The scenario takes static_objects, which nothing writes. It spawns none of them."]


def test_family_without_goals_is_unavailable(load: Load) -> None:
    campaign = load(GOAL + MAP + "- name: b\n  parameters:\n  - goal_poses: []\n" + MAP)
    assert [family.name for family in campaign.families] == ["a"]
    (fault,) = campaign.unavailable["b"]
    assert (fault.place.line, fault.problem) == (8, Got("[]"))
