"""The commands about scenario files, as a user meets them."""

import json

import pytest
from typer.testing import CliRunner

from vastflow.flows.__main__ import app

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


def run(*arguments):
    return CliRunner().invoke(app, ["scenario", *map(str, arguments)])


def test_check_says_which_scenarios_a_sound_file_has(file):
    result = run("check", file)
    assert (result.exit_code, result.stdout) == (0, "OK: scenario patrol\n")


@pytest.mark.parametrize("command", ["check", "parameters"])
def test_every_fault_is_said_with_its_place_and_nothing_is_printed_else(file, command):
    file.write_text(PATROL.replace("speed =", "sped =").replace("log(", "logg("))
    result = run(command, file)
    assert (result.exit_code, result.stdout) == (2, "")
    places = [line.split(": ")[0] for line in result.stderr.splitlines()]
    assert places == [f"{file}:6:18", f"{file}:10:8"]
    assert "did you mean 'speed'?" in result.stderr and "did you mean 'log'?" in result.stderr


def test_check_says_of_every_action_that_nothing_here_can_do_where_it_stands_and_why(file):
    body = "do serial:\n        bag_play('drive')\n        log('x')\n        load_world('flat.sdf')\n"
    file.write_text(PATROL.replace("osc.ros", "osc.ros\nimport osc.sim").replace('do log("x")\n', body))
    result = run("check", file)
    assert (result.exit_code, result.stdout) == (2, "")
    bag, world = result.stderr.splitlines()
    assert bag.startswith(f"{file}:12:9: bag_play can't be run here; ")
    assert world.startswith(f"{file}:14:9: load_world can't be run here; ")


def test_scenario_that_can_t_be_run_here_still_has_parameters(file):
    file.write_text(PATROL.replace('log("x")', "bag_play('drive')"))
    result = run("parameters", file)
    assert result.exit_code == 0 and json.loads(result.stdout)[0]["scenario"] == "patrol"


def test_missing_file_is_said_without_a_traceback(tmp_path):
    result = run("check", tmp_path / "absent.osc")
    assert result.exit_code == 2 and "there is no file" in result.stderr and "Traceback" not in result.stderr


def test_parameters_lists_names_types_and_defaults_as_json(file):
    result = run("parameters", file)
    assert result.exit_code == 0
    (listed,) = json.loads(result.stdout)
    assert listed["scenario"] == "patrol"
    assert listed["parameters"] == [
        {"name": "start", "type": "pose_3d", "is_list": False, "default": None},
        {"name": "speed_limit", "type": "speed", "is_list": False, "default": pytest.approx(10.0)},
        {"name": "names", "type": "string", "is_list": True, "default": ["a"]},
        {"name": "stop", "type": "signal", "is_list": False, "default": "sigint"},
    ]
