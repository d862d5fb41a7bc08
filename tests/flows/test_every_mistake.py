"""Campaign files with three mistakes each, of different kinds and sections: all three are told at once."""

import pytest
from families import write_map
from table import each_row

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.sim.model.faults import FileError

POSES = "  - start_pose: {x: 0.5, y: 0.5, yaw: 0.0}\n  - goal_pose: {x: 1.5, y: 0.5}\n"
TWO_LOW = "  - robot_radius: 30.0\n  - inflation_radus: 0.5\n"
SEARCH = (
    "search:\n  search_space: {g: {type: float, low: 3, high: 6}}\n  parameters:\n  - map_file: maps/room.yaml\n"
    + POSES
)


def family(parameters="", beside="", map_file="room", poses=POSES):
    return f"configuration:\n- name: a\n  parameters:\n  - map_file: maps/{map_file}.yaml\n{poses}{parameters}{beside}"


@each_row(
    ("text", "places"),
    [
        (family("  - robot_radius: 30.0\n  - inflation_radus: 0.5\n  - controller: 3\n"), "7:19 8:5 9:17"),
        (family("  - number_of_loops: '@gone'\n" + TWO_LOW), "7:22 8:19 9:5"),
        (family("  - robot_radius: 99.0\n  - amcl.alpha1: -3.0\n  - robot_raduis: 0.2\n"), "7:19 8:18 9:5"),
        (family(TWO_LOW, map_file="none"), "4:15 7:19 8:5"),
        (family(TWO_LOW, poses=POSES.replace("{x: 1.5, y: 0.5}", "here")), "6:16 7:19 8:5"),
        (family(TWO_LOW, poses=POSES.replace("x: 1.5", "x: 9.0")), "6:16 7:19 8:5"),
        (family("", "  robot: {mass: -1, speed: 3, drive: 7}\n"), "7:17 7:21 7:38"),
        (family("  - inflation_radus: 0.5\n", "  robot: {mass: -1, lidar: {range_min: 2, range_max: 1}}\n"), "7:5 8:3 8:17"),
        (family("", "  variations:\n  - Path: {}\n  - ParameterVariationList: {name: robot_radius, values: [40], s: 1}\n"), "8:5 9:64"),
        (family("", "  variations:\n  - ParameterVariationList: {name: robot_radius, values: [40]}\n  - Path: {}\nverion: 1\n"), "8:59 9:5 10:1"),
        (family() + "execution: {runs: many, timout: 3, timeout: -4}\n", "7:19 7:25 7:45"),
        (family() + "execution: {scenario_file: gone.osc, nav2_params: none.yaml, runs: 0}\n", "7:28 7:51 7:68"),
        (family("  - inflation_radus: 0.5\n") + "execution: {nav2_params: nav2.yaml}\n", "1:34 1:48 7:5"),
        (family() + "evaluation: {oracles: [safty, success: {allow_mised: 1, allow_missed: 7}]}\n", "7:24 7:54 7:71"),
        (family("  - robot_radius: 30.0\n") + "evaluation: {oracles: [safty]}\nexecution: {run: 3}\n", "7:19 8:24 9:13"),
        (f"constraints:\n- a: 'robot_radus < 1'\n- b: '1 <'\n- c: 3\n{family()}", "2:7 3:10 4:6"),
        (f"constraints:\n- a: 'robot_radus < 1'\n{family(TWO_LOW)}", "2:7 9:19 10:5"),
        (f"verion: 1\ngeneral: 4\nmetadata: 5\n{family()}", "1:1 2:10 3:11"),
        (family(TWO_LOW) + "execution: {runs: 1, runs: 2}\n", "7:19 8:5 9:22"),
        (family("", "  dimensions: {robot_raduis: system}\n  design: {t_way: {strength: 9}}\n  start_check: maybe\n"), "7:16 8:30 9:16"),
        (SEARCH.replace("high: 6", "high: 1") + "  strategy: randm\n  budget: [{batch: 3}]\n", "2:18 7:13 8:13"),
        (SEARCH + TWO_LOW + "  - q: $h\n  strategy: random\n  budget: [{batches: 3}]\n", "7:19 8:5 9:8"),
    ],
)  # fmt: skip
def test_campaign_file_with_three_mistakes_tells_all(tmp_path, text, places):
    write_map(tmp_path / "maps", "room")
    (tmp_path / "nav2.yaml").write_text("amcl: {ros__parameters: {alpha1: fast, alpah2: 0.2}}\n")
    (file := tmp_path / "c.vast").write_text(text)
    with pytest.raises(FileError, match=":") as caught:
        read_campaign(file)
    found = [f"{fault.place.line}:{fault.place.column}" for fault in caught.value.faults]
    assert [place for place in places.split() if place not in found] == [], str(caught.value)
