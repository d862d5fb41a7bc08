"""The commands about scenario files, as a user meets them."""

import json

import pytest
from command_line import called

PATROL = """\
import osc.helpers
import osc.ros

scenario patrol:
    start: pose_3d
    speed_limit: speed = 36kmph
    names: list of string = ['a']
    stop: signal = signal!sigint
    bot: differential_drive_robot
    do log("x")
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "patrol.osc"
    path.write_text(PATROL)
    return path


def test_check_lists_scenarios_of_sound_file(file):
    result = called("scenario", "check", file)
    assert (result.exit_code, result.stdout) == (0, "OK: scenario patrol\n")


def test_check_names_actions_that_cannot_be_run(file):
    body = "do serial:\n        bag_play('drive')\n        log('x')\n        load_world('flat.sdf')\n"
    file.write_text(PATROL.replace("osc.ros", "osc.ros\nimport osc.sim").replace('do log("x")\n', body))
    result = called("scenario", "check", file)
    assert (result.exit_code, result.stdout) == (2, "")
    bag, world = (line for line in result.stderr.splitlines() if line.startswith(str(file)))
    assert bag.startswith(f"{file}:12:9: bag_play can't be run here. ")
    assert world.startswith(f"{file}:14:9: load_world can't be run here. ")
    result = called("scenario", "parameters", file)
    assert result.exit_code == 0 and json.loads(result.stdout)[0]["scenario"] == "patrol"


def test_parameters_lists_names_types_and_defaults(file):
    result = called("scenario", "parameters", file)
    assert result.exit_code == 0
    (listed,) = json.loads(result.stdout)
    assert listed["scenario"] == "patrol"
    assert listed["parameters"] == [
        {"name": "start", "type": "pose_3d", "is_list": False, "default": None},
        {"name": "speed_limit", "type": "speed", "is_list": False, "default": pytest.approx(10.0)},
        {"name": "names", "type": "string", "is_list": True, "default": ["a"]},
        {"name": "stop", "type": "signal", "is_list": False, "default": "sigint"},
    ]
