"""What values name and what gives them: globals, members, defaults above and below, `keep`, actors' variables."""

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
    assert tree.passed, tree.message
    return lines


def test_default_may_name_what_is_declared_below_it():
    body = "p: string = q + '!'\nq: string = 'x'\ndo log(p)"
    assert logged(body) == ["x!"]
    assert logged(body, q="y") == ["y!"]


def test_globals_name_globals_and_parameters_name_globals():
    before = "global greeting: string = name_ + '!'\nglobal name_: string = 'hall'\n"
    assert logged("p: string = greeting\ndo serial:\n    log(p)\n    log(greeting)", before) == ["hall!", "hall!"]


def test_member_of_a_global_is_a_value():
    before = "global home: pose_3d = pose_3d(position_3d(x: 1.5m))\n"
    body = "p: pose_3d = home\nq: length = home.position.x\ndo log(q)"
    assert logged(body, before) == ["1.5"]


def test_parameter_hides_a_global_of_its_name():
    assert logged("g: string = 'mine'\ndo log(g)", "global g: string = 'everyones'\n") == ["mine"]


@each_row("kind", ["struct", "actor"])
def test_defaults_of_members_name_globals_and_members_above(kind):
    before = f"global g: int = 3\n{kind} box:\n    f: int = g\n    h: int = f + 1\n"
    value = " = box()" if kind == "struct" else ""
    assert logged(f"v: box{value}\ndo serial:\n    log(v.f)\n    log(v.h)", before) == ["3", "4"]


def test_member_that_names_another_follows_the_value_that_is_given():
    before = "struct box:\n    f: int = 3\n    h: int = f + 1\n"
    assert logged("v: box = box(f: 7)\ndo log(v.h)", before) == ["8"]
    assert logged("v: box\ndo log(v.h)", before, v={"f": 7}) == ["8"]


@each_row("kind", ["struct", "actor"])
def test_what_inherits_may_give_a_member_another_default(kind):
    before = f"{kind} base:\n    x: int = 1\n    y: int = x\n{kind} derived inherits base:\n    x: int = 2\n"
    fields = "v: derived = derived()\nw: base = base()" if kind == "struct" else "v: derived\nw: base"
    assert logged(f"{fields}\ndo serial:\n    log(v.x)\n    log(v.y)\n    log(w.x)", before) == ["2", "2", "1"]


def test_derived_scenario_may_give_a_parameter_another_default():
    text = f"{HEAD}scenario base:\n    p: string = 'a'\n    v: speed = 1mps\n    do log(p)\n"
    _, derived = read_text(f"{text}scenario derived inherits base:\n    p: string = 'b'\n", "f.osc", Path())
    assert bound(derived, {}) == {"p": "b", "v": 1.0}


def test_actor_of_ones_own_presets_what_it_inherits_and_acts_as_what_it_inherits_from():
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


def test_keep_gives_arguments_of_an_action_and_takes_the_place_of_what_is_in_the_brackets():
    body = """\
n: string = 'named'
do serial:
    log() with:
        keep(it.msg == 'kept')
    log('written') with:
        keep(it.msg == 'kept over ' + n)
        timeout(3s)
"""
    assert logged(body) == ["kept", "kept over named"]


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


def test_variables_of_an_actor_are_counted_compared_and_awaited():
    before = "actor rover:\n    var laps: int = 1\n"
    body = """\
one: rover
other: rover
do parallel:
    serial:
        increment(one.laps)
        increment(one.laps)
    serial:
        wait one.laps == 3
        compare(other.laps, '==', 1)
        log(one.laps)
"""
    assert logged(body, before) == ["3"]


def test_variable_of_a_struct_without_a_value_has_that_of_its_type():
    assert logged("var p: pose_3d\ndo log(p.position.x)") == ["0.0"]


def test_actors_and_variables_have_their_values_in_whatever_order_they_are_written():
    before = "actor rover:\n    top: int = limit\nglobal limit: int = 4\n"
    assert logged("var double: int = bot.top * 2\nbot: rover\ndo log(double)", before) == ["8"]


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
def test_in_the_brackets_of_a_call_plain_numbers_stand_for_si_units_and_for_texts(call, name, value):
    argument = read(f"bot: differential_drive_robot\ndo {call}", "").root.arguments[name]
    if value is not None:
        found = argument.members["value"] if name == "msg" else argument
        assert found.value == value and type(found.value) is type(value)


@each_row("duration", ["random.get_int(1, 2)", "random.get_float(0.1, 0.3)"])
def test_function_that_gives_a_number_gives_the_seconds_of_a_wait_and_of_a_timeout(duration):
    assert logged(f"do serial:\n    wait elapsed({duration})\n    log('waited')") == ["waited"]
    assert logged(f"do log('in time') with:\n    timeout({duration})") == ["in time"]


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


@each_row("kind", ["struct", "actor"])
def test_name_of_a_type_has_the_defaults_of_its_members(kind):
    before = f"struct load:\n    n: int = 3\n    w: length = 2km\n{kind} truck:\n    wheels: int = 6\n    cargo: load = load(n: 4)\n"
    body = "do serial:\n    log(truck.wheels)\n    log(truck.cargo.n)\n    log(load.n)\n    log(load.w)"
    assert logged(body, before) == ["6", "4", "3", "2000.0"]


def test_member_of_an_enumeration_is_logged_as_it_is_written():
    assert logged("how: signal = signal!sigint\ndo serial:\n    log(how)\n    log(signal!sigterm)") == [
        "signal!sigint",
        "signal!sigterm",
    ]


def test_parameter_hides_a_type_of_its_name():
    assert logged("load: string = 'mine'\ndo log(load)", "struct load:\n    n: int = 3\n") == ["mine"]


def test_list_and_a_pose_that_are_left_out_are_empty_and_at_the_origin():
    body = "bot: differential_drive_robot\ndo serial:\n    bot.init_nav2()\n    bag_record()"
    init, bag = read(body).root.children
    assert init.arguments["initial_pose"].members["position"].members["x"].value == 0.0
    assert bag.arguments["topics"].items == ()


def test_retry_without_a_count_goes_on_until_it_succeeds():
    body = """\
var n: int = 0
do serial:
    serial:
        increment(n)
        compare(n, '>', 20)
    with:
        retry()
    log(n)
"""
    assert logged(body) == ["21"]


def test_emit_start_is_allowed_and_nothing_follows_from_it():
    assert logged("do serial:\n    emit start\n    log('x')") == ["x"]


def test_label_of_a_modifier_is_no_matter():
    assert read("do serial:\n    limit: timeout(3s)\n    log('x')").root.modifier == "timeout"


def test_function_may_be_declared_in_a_scenario_an_actor_and_a_struct():
    before = "actor rover:\n    def f() -> int is external my.module.f()\nstruct mine:\n    def g() is external my.module.g()\n"
    assert logged("def h() -> string is external os.getcwd()\nr: rover\ndo log('x')", before) == ["x"]


def test_folder_of_a_ros_package_is_a_text_that_a_launch_may_have():
    assert logged("do log(ament.get_package_share_directory('maps') + '/hall.yaml')") == [
        "/opt/ros/share/maps/hall.yaml"
    ]


def test_of_a_file_with_a_scenario_that_another_inherits_from_the_other_is_run(tmp_path):
    file = tmp_path / "trial.osc"
    base = f"{HEAD}scenario base:\n    p: string = 'a'\n    do log(p)\n"
    file.write_text(f"{base}scenario derived inherits base:\n    p: string = 'b'\n")
    assert definition_of(abstract_content(file)).name == "derived"
    file.write_text(f"{base}scenario other:\n    do log('x')\n")
    with pytest.raises(ScenarioError, match="expected one scenario to run, got base, other"):
        abstract_content(file)
