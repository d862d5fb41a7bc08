"""Values of names: globals, members, defaults, `keep`, and variables of actors."""

from pathlib import Path

import numpy as np
import pytest
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.reading.abstract import abstract_content, definition_of
from vastflow.sim.scenario.language.parameters import bound
from vastflow.sim.scenario.language.reading import read_text
from vastflow.sim.scenario.tree.helpers import HELPERS, helper_functions
from vastflow.sim.scenario.tree.tree import ScenarioTree

HEAD = "import osc.helpers\nimport osc.gazebo\nimport osc.nav2\nimport osc.ros\n"


def read(body, before=""):
    lines = "".join(f"    {line}\n" for line in body.strip("\n").split("\n"))
    return read_text(f"{HEAD}{before}scenario visit:\n{lines}", "visit.osc", Path())[0]


def logged(body, before="", **overrides):
    """The lines that a scenario logs until it ends, well."""
    lines: list[str] = []
    definition = read(body, before)
    functions = helper_functions(np.random.default_rng(0), Path("/scenarios"), Path("/out"))
    tree = ScenarioTree(definition, bound(definition, overrides), HELPERS, functions, log=lines.append)
    for _ in range(100):
        if not tree.ended:
            tree.tick()
    assert tree.passed, tree.reason.message
    return lines


def log(*values):
    return "do serial:\n" + "".join(f"    log({value})\n" for value in values)


def test_scenario_logs_values_of_its_names(golden):
    """Declarations stand above a line `scenario:`."""

    def lines(text):
        before, _, body = text.rpartition("scenario:\n")
        return logged(body, before)

    golden("scenarios", "logs", lines, key="lines")


def test_values_that_follow_from_others_follow_from_what_is_given():
    assert logged(f"p: string = q + '!'\nq: string = 'x'\n{log('p')}", q="y") == ["y!"]
    assert logged(f"v: box\n{log('v.h')}", "struct box:\n    f: int = 3\n    h: int = f + 1\n", v={"f": 7}) == ["8"]


def test_derived_scenario_may_give_a_parameter_another_default():
    text = f"{HEAD}scenario base:\n    p: string = 'a'\n    v: speed = 1mps\n    do log(p)\n"
    _, derived = read_text(f"{text}scenario derived inherits base:\n    p: string = 'b'\n", "f.osc", Path())
    assert bound(derived, {}) == {"p": "b", "v": 1.0}


def test_actor_of_ones_own_acts_as_its_base_with_its_own_defaults():
    before = "actor courier inherits differential_drive_robot:\n    namespace: string = 'courier'\n"
    definition = read("bot: courier\ndo bot.nav_to_pose(pose_3d())", before)
    assert definition.actors[0].members["namespace"].value == "courier"
    assert (definition.root.action, definition.root.actor) == ("differential_drive_robot.nav_to_pose", "bot")


def test_action_of_ones_own_does_what_it_inherits_from_with_its_own_defaults():
    before = (
        "global dock: pose_3d = pose_3d(position_3d(x: 2.0m))\n"
        "action differential_drive_robot.go_home inherits differential_drive_robot.nav_to_pose:\n"
        "    goal_pose: pose_3d = dock\n"
        "action cheer inherits log:\n    keep(it.msg == 'done')\n"
        "action sigh inherits log:\n    msg: string = 'alas'\n"
    )
    root = read("bot: differential_drive_robot\ndo bot.go_home()", before).root
    assert root.action == "differential_drive_robot.nav_to_pose"
    assert root.arguments["goal_pose"].path == ("dock",)
    assert logged("do serial:\n    cheer()\n    cheer('again')\n    sigh()", before) == ["done", "again", "alas"]


def test_keep_gives_a_member_of_an_argument_and_leaves_the_others():
    body = """\
g: pose_3d = pose_3d(position_3d(x: 1m))
bot: differential_drive_robot
do serial:
    bot.nav_to_pose() with:
        keep(it.goal_pose.position.x == 3m)
    bot.nav_to_pose(g) with:
        keep(it.goal_pose.position.y == 4m)
"""
    definition = read(body)
    first, second = (call.arguments["goal_pose"].members["position"].members for call in definition.root.children)
    assert (first["x"].value, first["y"].value) == (3.0, 0.0)
    assert (second["x"].path, second["y"].value) == (("g", "position", "x"), 4.0)


@each_row(
    ("call", "name", "value"),
    [
        ("bot.odometry_distance_traveled(2)", "distance", 2),
        ("bot.odometry_distance_traveled(2.5)", "distance", 2.5),
        ("bot.tf_close_to(0.5, position_3d(x: 1, y: 2.0))", "threshold", 0.5),
        ("log('x') with:\n    timeout(10)", "duration", 10),
        ("log(key_value('a', 3))", "msg", "3"),
        ("log(key_value('a', false))", "msg", "false"),
        ("log(random.get_float(1, 2))", "msg", None),
    ],
)
def test_plain_numbers_of_a_call_stand_for_si_units_and_texts(call, name, value):
    argument = read(f"bot: differential_drive_robot\ndo {call}", "").root.arguments[name]
    if value is not None:
        found = argument.members["value"] if name == "msg" else argument
        assert found.value == value and type(found.value) is type(value)


def test_plain_number_that_keep_gives_is_in_si_units():
    body = """\
g: pose_3d with:
    keep(it.position.x == 2)
bot: differential_drive_robot
do serial:
    log(g.position.x)
    log('') with:
        keep(it.msg == 5)
    bot.odometry_distance_traveled() with:
        keep(it.distance == 3)
"""
    definition = read(body)
    (parameter,) = definition.parameters
    travel = definition.root.children[2]
    assert parameter.default.members["position"].members["x"].value == 2
    assert travel.arguments["distance"].value == 3


def test_omitted_list_is_empty_and_omitted_pose_at_the_origin():
    body = "bot: differential_drive_robot\ndo serial:\n    bot.init_nav2()\n    bag_record()"
    init, bag = read(body).root.children
    assert init.arguments["initial_pose"].members["position"].members["x"].value == 0.0
    assert bag.arguments["topics"].items == ()


def test_scenario_that_no_other_inherits_from_is_run(tmp_path):
    file = tmp_path / "trial.osc"
    base = f"{HEAD}scenario base:\n    p: string = 'a'\n    do log(p)\n"
    file.write_text(f"{base}scenario derived inherits base:\n    p: string = 'b'\n")
    assert definition_of(abstract_content(file)).name == "derived"
    file.write_text(f"{base}scenario other:\n    do log('x')\n")
    with pytest.raises(ScenarioError, match="expected one scenario to run, got base, other"):
        abstract_content(file)
