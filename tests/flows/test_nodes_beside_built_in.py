"""The built-in robot beside nodes that repeat its commands, and beside some with a planted difference."""

import json

import pytest
from command_line import called
from repeated import BRIDGE, repeated
from room import drawn_room

from vastflow.flows import run_campaign
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.producers.instantiation.instantiate import instantiate

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

CAMPAIGN = """\
version: 1
metadata: {name: room}
configuration:
  - name: room
    parameters:
      - map_file: room.yaml
    variations:
      - ParameterVariationList:
          name: [start_pose, goal_pose]
          values: [[{x: 1.0, y: 1.0, yaw: 0.0}, {x: 3.0, y: 1.0, yaw: 0.0}], [{x: 1.0, y: 4.0, yaw: 0.0}, {x: 2.6, y: 4.0, yaw: 0.0}]]
      - ParameterVariationList: {name: laserscan_gaussian_noise_std_deviation, values: [0.01, 0.1]}
      - ParameterVariationList: {name: laserscan_random_drop_percentage, values: [0.0, 0.3]}
      - ParameterVariationList:
          name: static_objects
          values: [[], [{entity_name: box, model: box, spawn_pose: {x: 4.5, y: 2.5}, xacro_arguments: "width:=0.5, length:=0.5"}]]
execution:
  runs: 2
  timeout: 60
"""
DRIVEN = """\
  system: ros2
  env: [REPEATED: FILE]
  nodes: [{stays: {command: sleep 600}}]
  ros2: {python: BRIDGE, localization: ideal}
"""


def halved(said):
    """The same way at half the speed."""
    slow = [[part / 2 for part in command] for command in said["commands"] for _ in range(2)]
    return {"commands": slow, "ended": said["ended"] and 2 * said["ended"]}


@pytest.fixture(scope="module")
def directories(tmp_path_factory):
    """Campaigns of the built-in robot, of nodes that repeat it, and of some that are slow where noise is high."""
    folder = tmp_path_factory.mktemp("room")
    drawn_room(folder)
    (folder / "built_in.vast").write_text(CAMPAIGN)
    campaign, _ = read_campaign(folder / "built_in.vast")
    runs, slow = {}, {}
    for each in instantiate(campaign).configurations:
        for k in range(2):
            scan, said, _ = repeated(each.scenario, k, campaign.seed)
            is_noisy = each.scenario.system["laserscan_gaussian_noise_std_deviation"] == 0.1
            runs[scan], slow[scan] = said, halved(said) if is_noisy else said
    for name, content in (("repeated", runs), ("slow", slow)):
        (folder / f"{name}.json").write_text(json.dumps(content))
        text = DRIVEN.replace("FILE", str(folder / f"{name}.json")).replace("BRIDGE", BRIDGE)
        (folder / f"{name}.vast").write_text(CAMPAIGN + text)
    names = ("built_in", "repeated", "slow")
    return {name: run_campaign(folder / f"{name}.vast", results=folder / name).directory for name in names}


def compared(*directories):
    return json.loads(called("compare", *directories, "--json").stdout)


def test_nodes_repeating_the_built_in_robot_show_no_difference(directories):
    found = compared(directories["built_in"], directories["repeated"])
    assert found["paired"]["judged_both_times"] == 32 and found["paired"]["other_system"] == 16
    assert (found["difference"]["lost"], found["difference"]["gained"]) == (0, 0)
    assert [(one["equal"], one["difference"]) for one in found["metrics"]] == [(32, 0.0)] * len(found["metrics"])
    assert {one["metric"] for one in found["metrics"]} >= {"time", "path length", "final error"}
    assert found["explained"] == []


def test_nodes_slow_in_high_noise_differ_by_noise(directories):
    found = compared(directories["built_in"], directories["slow"])
    (time,) = (one for one in found["metrics"] if one["metric"] == "time")
    assert (time["pairs"], time["equal"]) == (32, 16) and time["interval"][0] > 0.0 and time["adjusted"] < 0.05
    first = found["explained"][0]
    assert (first["name"], first["metric"]) == ("laserscan_gaussian_noise_std_deviation", "time")
    assert first["means"][0] == 0.0 and first["means"][1] > 3.0
    assert "laserscan_random_drop_percentage" not in {one["name"] for one in found["explained"]}
