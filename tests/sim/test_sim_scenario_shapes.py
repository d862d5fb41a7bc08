"""Scenario files in the shapes in which people write them for scenario-execution: each drives when it is executed."""

import pytest
from outside import robovast_file

from vastflow.sim.model.scenario import scenario_of
from vastflow.sim.reading.abstract import abstract_content, hall_file
from vastflow.sim.reading.vocabulary import ACTIONS
from vastflow.sim.run import execute
from vastflow.sim.scenario.language.reading import read_scenarios
from vastflow.sim.scenario.tree.support import unsupported
from vastflow.sim.world.world import map_content

IMPORTS = "".join(
    f"import osc.{name}\n" for name in ("helpers", "ros", "nav2", "gazebo", "os", "x11", "floorplan_dsl", "sim")
)

GIVEN = {
    "start_pose": {"x": 1.0, "y": 1.0},
    "goal_pose": {"x": 3.0, "y": 1.0},
    "mesh_file": "hall.stl",
    "static_objects": [],
}


def driven(file, two_rooms, **given):
    """The run of a scenario file in the two rooms."""
    (definition,) = read_scenarios(file)
    assert unsupported(definition, ACTIONS) == []
    known = {parameter.name for parameter in definition.parameters}
    values = {key: value for key, value in {**GIVEN, **given}.items() if key in {"start_pose", *known}}
    tags = {"static_objects": "environment"}
    scenario = scenario_of({**values, "map_file": two_rooms}, tags, abstract=abstract_content(file), timeout_s=400.0)
    return execute(scenario, 0).recording.run


def test_scenario_of_each_shape_drives(golden, tmp_path, two_rooms):
    def told(text):
        file = tmp_path / "trial.osc"
        file.write_text(IMPORTS + text)
        found = driven(file, two_rooms)
        return [f"{found.outcome} {found.reason}".strip(), "drove" if found.distance_m > 1.0 else "stood"]

    golden("scenarios", "shapes", told, key="told")


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("navigation/scenario.osc", {}),
        ("navigation/nav_to_pose_single.osc", {}),
        ("navigation/nav_to_pose_multiple.osc", {f"goal_pose{k}": {"x": 1.0 + k % 3, "y": 1.0} for k in range(1, 6)}),
        ("navigation/nav_through_poses.osc", {"goal_poses": [{"x": 2.0, "y": 1.0}, {"x": 3.2, "y": 1.5}]}),
        ("examples/basic_nav/scenario.osc", {"start_pose": {"x": 0.0, "y": 0.0}}),
    ],
)
def test_scenario_of_robovasts_drives(two_rooms, name, given):
    file = robovast_file(name)
    found = driven(file, map_content(hall_file()) if "basic_nav" in name else two_rooms, **given)
    assert (found.outcome, found.reason) == ("succeeded", "")
    assert found.distance_m > 1.0
