"""Scenario files that are accepted, and what they define."""

import pickle
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.faults import Place
from vastflow.sim.scenario.definition import (
    Actor,
    Call,
    Composition,
    Constant,
    Elapsed,
    Emit,
    EnumValue,
    Happened,
    Holds,
    ListOf,
    Modified,
    Name,
    Operation,
    Struct,
    Type,
    Until,
    Wait,
)
from vastflow.sim.scenario.language.declaring import library, library_names
from vastflow.sim.scenario.language.faults import OscError
from vastflow.sim.scenario.language.parameters import bound
from vastflow.sim.scenario.language.reading import files_of, read_scenarios, read_text

NAVIGATION = """\
import osc.helpers
import osc.ros
import osc.nav2
import osc.gazebo

scenario visit:
    timeout(120s)
    start: pose_3d
    goals: list of pose_3d
    boxes: list of spawn_entity
    bot: differential_drive_robot
    do parallel:
        serial:
            repeat()
            wait elapsed(1s)
            log("alive")
        serial:
            spawn_multiple(boxes)
            bot.init_nav2(start)
            bot.nav_through_poses(goals) with:
                timeout(90s)
            emit end
"""


def read(text, folder=Path()):
    return read_text(text, "visit.osc", folder)


def scenario(body, *imports, before=""):
    """The one scenario with that body, which is indented by four blanks."""
    lines = "".join(f"    {line}\n" for line in body.strip("\n").split("\n"))
    heads = "".join(f"import osc.{name}\n" for name in ("helpers", *imports))
    (definition,) = read(f"{heads}{before}\nscenario visit:\n{lines}")
    return definition


def value(text, type_, before=""):
    """What `text` becomes as the default of a parameter of that type."""
    (parameter,) = scenario(f"p: {type_} = {text}\ndo log('x')", before=before).parameters
    return parameter.default


def test_navigation_scenario_becomes_a_tree_with_its_modifiers_round_it():
    (visit,) = read(NAVIGATION)
    assert visit.name == "visit"
    assert [(p.name, str(p.type), p.default) for p in visit.parameters] == [
        ("start", "pose_3d", None),
        ("goals", "list of pose_3d", None),
        ("boxes", "list of spawn_entity", None),
    ]
    assert visit.actors[0].types == ("differential_drive_robot", "robot", "osc_actor")
    root = visit.root
    assert isinstance(root, Modified) and root.modifier == "timeout"
    assert isinstance(root.child, Composition) and root.child.kind == "parallel"
    watchdog, work = root.child.children
    assert isinstance(watchdog, Modified) and (watchdog.modifier, watchdog.arguments["count"].value) == ("repeat", -1)
    assert isinstance(watchdog.child.children[0].until, Elapsed)
    spawn, init, drive, end = work.children
    assert (spawn.action, spawn.actor) == ("spawn_multiple", "")
    assert (init.action, init.actor) == ("differential_drive_robot.init_nav2", "bot")
    assert init.arguments["initial_pose"] == Name(("start",), Place("visit.osc", 19, 27))
    assert isinstance(drive, Modified) and drive.child.action == "differential_drive_robot.nav_through_poses"
    assert isinstance(end, Emit) and end.event == "end"


@each_row("name", library_names())
def test_every_library_can_be_read_alone(name):
    assert library(name).units


@each_row("action", ["init_nav2", "nav_to_pose", "nav_through_poses", "follow_waypoints"])
def test_robot_of_ros_can_navigate_once_nav2_is_imported(action):
    assert f"differential_drive_robot.{action}" in library("osc.nav2").actions


def test_tabs_reach_the_next_multiple_of_eight():
    definition = read("import osc.helpers\nscenario a:\n\tdo serial:\n\t    log('x')\n            log('y')\n")[0]
    assert len(definition.root.children) == 2


def test_comments_of_both_kinds_and_blank_lines_count_for_nothing():
    text = "/* two\nlines */ # more\nimport osc.helpers\n\n  # indented\nscenario a: # here\n"
    text += (
        "    do serial: /* and\n here */\n        log(# in an argument list\n            'x' /* y */)\n   # at the end"
    )
    assert isinstance(read(text)[0].root, Composition)


def test_brackets_and_backslashes_join_lines():
    body = "p: list of int = [\n1,\n    2\n]\ndo log(\\\n  'x')"
    assert len(scenario(body).parameters[0].default.items) == 2


def test_labels_are_kept():
    root = scenario("do all: serial:\n    first: log('x')\n    second: wait elapsed(1s)\n    third: emit end").root
    assert [root.label, *(child.label for child in root.children)] == ["all", "first", "second", "third"]


def test_struct_is_made_by_position_by_name_and_by_default():
    by_position = value("pose_3d(position_3d(1.0m, 2.0m))", "pose_3d")
    by_name = value("pose_3d(position: position_3d(y: 2.0m, x: 1.0m))", "pose_3d")
    for pose in (by_position, by_name):
        position = {name: member.value for name, member in pose.members["position"].members.items()}
        assert position == {"x": 1.0, "y": 2.0, "z": 0.0}
        assert pose.members["orientation"].members["yaw"].value == 0.0


@each_row(
    ("text", "type_", "si"),
    [
        ("3s", "time", 3.0),
        ("250 ms", "time", 0.25),
        ("2min", "time", 120.0),
        ("1h", "time", 3600.0),
        ("36.0kmph", "speed", 10.0),
        ("0.5mps", "speed", 0.5),
        ("-90deg", "angle", -1.5707963268),
        ("1.5e1km", "length", 15000.0),
        ("1inch", "length", 0.0254),
        ("-10C", "temperature", 263.15),
        ("32F", "temperature", 273.15),
        ("1atm", "pressure", 101325.0),
        ("2lb", "mass", 0.90718474),
        ("1mpspsps", "jerk", 1.0),
        ("180degps", "angular_rate", 3.1415926536),
    ],
)
def test_number_with_a_unit_is_in_si_units(text, type_, si):
    assert value(text, type_).value == pytest.approx(si, rel=1e-8)


def test_unit_of_a_default_is_kept():
    assert scenario("v: speed = 36.0kmph\ndo log('x')").parameters[0].unit == "kmph"


@each_row(
    ("text", "type_", "plain"),
    [
        ("0x1F", "int", 31),
        ("-3", "int", -3),
        ("3", "uint", 3),
        (".5", "float", 0.5),
        ("1.5e-3", "float", 0.0015),
        ("true", "bool", True),
        ("'it\\'s'", "string", "it's"),
        ('"a # b"', "string", "a # b"),
        ("'''two\n\nlines'''", "string", "two\n    \n    lines"),
        ('""', "string", ""),
        (r"'\d \\ \n'", "string", r"\d \ \n"),
    ],
)
def test_literals(text, type_, plain):
    assert value(text, type_).value == plain


def test_enumeration_counts_on_from_the_numbers_that_are_given():
    colors = "enum color: [red, green = 5, blue]\n"
    assert value("color!blue", "color", colors).value == EnumValue("color", "blue", 6)


def test_names_in_bars_may_hold_anything():
    assert scenario("|a name|: int = 3\ndo log('x')").parameters[0].name == "a name"


def test_lists_are_joined_by_plus():
    assert value("['a'] + ['b']", "list of string").operator == "+"


def test_file_may_hold_several_scenarios_and_an_inherited_one_runs_as_well():
    text = "import osc.helpers\nscenario base:\n    n: int = 1\n    do log('x')\n"
    base, derived = read(text + "scenario derived inherits base:\n    k: int = 2\n")
    assert [p.name for p in derived.parameters] == ["n", "k"]
    assert derived.root == base.root


def test_derived_scenario_does_what_it_says_itself():
    text = "import osc.helpers\nscenario base:\n    timeout(3s)\n    do log('x')\n"
    derived = read(text + "scenario derived inherits base:\n    do log('y')\n")[1]
    assert (derived.root.modifier, derived.root.child.arguments["msg"].value) == ("timeout", "y")


def test_events_are_awaited_and_emitted():
    root = scenario("event e\nc: int = 2\ndo parallel:\n    wait @e\n    wait @e if c == 2\n    emit e").root
    assert [type(child) for child in root.children] == [Wait, Wait, Emit]
    assert root.children[0].until.condition is None
    assert isinstance(root.children[1].until, Happened) and isinstance(root.children[1].until.condition, Operation)


def test_wait_may_be_for_a_condition_over_variables():
    definition = scenario("var c: int = 0\ndo wait c == 3")
    assert isinstance(definition.root.until, Holds)
    assert [v.name for v in definition.variables] == ["c"]


def test_globals_count_as_variables_of_each_scenario():
    assert [v.name for v in scenario("do wait g == 3", before="global g: int = 1\n").variables] == ["g"]


def test_variable_is_counted_by_its_name():
    assert scenario("var c: int = 0\ndo increment(c)").root.arguments["target_variable"].value == "c"


def test_in_a_with_block_the_first_modifier_is_outermost_and_until_outside_of_all():
    root = scenario("do log('x') with:\n    until elapsed(5s)\n    timeout(3s)\n    repeat(2)").root
    assert isinstance(root, Until)
    assert (root.child.modifier, root.child.child.modifier) == ("timeout", "repeat")
    assert isinstance(root.child.child.child, Call)


def test_until_takes_an_event_or_a_condition():
    body = "event e\nvar c: int = 0\ndo serial:\n    log('x') with:\n        until @e\n    log('y') with:\n        until (c == 1)"
    events = [type(child.until) for child in scenario(body).root.children]
    assert events == [Happened, Holds]


def test_composition_takes_a_with_block_behind_its_members():
    root = scenario("do serial:\n    retry(2)\n    log('x')\nwith:\n    timeout(3s)").root
    assert (root.modifier, root.child.modifier, root.child.child.kind) == ("timeout", "retry", "serial")


@each_row(
    "modifier",
    [
        "inverter()",
        "repeat()",
        "repeat(3)",
        "retry(count: 3)",
        "timeout(1s)",
        "failure_is_running()",
        "failure_is_success()",
        "running_is_failure()",
        "running_is_success()",
        "success_is_failure()",
        "success_is_running()",
    ],
)
def test_each_modifier_wraps_a_scenario_a_composition_and_a_call(modifier):
    name = modifier.partition("(")[0]
    bodies = (
        f"{modifier}\ndo log('x')",
        f"do serial:\n    {modifier}\n    log('x')",
        f"do log('x') with:\n    {modifier}",
    )
    assert [scenario(body).root.modifier for body in bodies] == [name] * 3


def test_keep_sets_a_member_of_a_parameter_and_of_an_actor():
    body = "p: pose_3d with:\n    keep(it.position.x == 3m)\nbot: differential_drive_robot with:\n    keep(it.namespace == 'r1')\n"
    definition = scenario(body + "do log('x')", "ros")
    assert definition.parameters[0].default.members["position"].members["x"].value == 3.0
    actor = definition.actors[0]
    assert isinstance(actor, Actor) and actor.members["namespace"].value == "r1"


def test_keep_in_the_body_of_a_struct_or_a_scenario_sets_a_default():
    before = "struct up inherits position_3d:\n    keep(it.z == 2m)\n"
    assert value("up()", "up", before).members["z"].value == 2.0
    definition = scenario("n: int = 1\nv: speed = 36kmph\nkeep(it.n == 2)\nkeep(it.v == 5mps)\ndo log('x')")
    assert [(p.default.value, p.unit) for p in definition.parameters] == [(2, ""), (5.0, "mps")]


def test_structs_and_actors_inherit_and_may_stand_below_their_use():
    before = "struct b inherits a:\n    w: c\nstruct a:\n    u: int = 1\nstruct c:\n    v: int = 2\n"
    made = value("b(u: 5)", "b", before)
    assert (made.members["u"].value, made.members["w"].members["v"].value) == (5, 2)
    assert value("b()", "a", before).type == "b"


def test_action_of_ones_own_inherits_parameters():
    before = "actor rover inherits osc_actor\naction move:\n    speed_limit: speed = 1mps\n"
    before += "action rover.drive_to inherits move:\n    goal: pose_3d\n"
    root = scenario("r: rover\ndo r.drive_to(goal: pose_3d())", before=before).root
    assert (root.action, list(root.arguments)) == ("rover.drive_to", ["speed_limit", "goal"])


def test_action_is_found_on_what_the_actor_inherits_from():
    root = scenario("bot: differential_drive_robot\ndo bot.spawn(pose_3d(), 'box.sdf')", "ros", "gazebo").root
    assert (root.action, root.actor) == ("osc_actor.spawn", "bot")


def test_fields_of_parameters_and_actors_are_arguments():
    body = "p: pose_3d\nplan: floorplan_generator\ndo serial:\n    log(p.position.x)\n    log(plan.generated_gazebo_world_path)"
    paths = [child.arguments["msg"].path for child in scenario(body, "floorplan_dsl").root.children]
    assert paths == [("p", "position", "x"), ("plan", "generated_gazebo_world_path")]


def test_name_of_a_number_can_stand_for_a_text():
    body = "p: pose_3d\nq: list of key_value = [key_value('x', p.position.x)]\ndo log('x')"
    (pair,) = bound(scenario(body), {"p": {"position": {"x": 1.5}}})["q"]
    assert pair == {"key": "x", "value": "1.5"}


def test_navigation_scenario_as_they_are_written_for_a_robot_with_ros_is_read():
    body = """\
timeout(300s)
start_pose: pose_3d
goal_pose: pose_3d = pose_3d(position: position_3d(x: 1.0m), orientation: orientation_3d(yaw: 90deg))
map_file: string = "maps/flat.yaml"
mesh_file: string
static_objects: list of spawn_entity
floorplan_gen: floorplan_generator
robot: differential_drive_robot
do parallel:
    screen: capture_screen(frame_rate: 10.0)
    watchdog: serial:
        repeat()
        wait elapsed(1s)
        check_process_running("gz")
    test_drive: serial:
        floorplan_gen.generate_gazebo_world("world.sdf.em", [
            key_value("mesh_file", mesh_file),           # of the floor plan
            key_value("x", start_pose.position.x)
        ])
        parallel:
            ros_launch("nav2_bringup", "navigation_launch.py", [
                key_value("map", common.get_scenario_file_directory() + "/" + map_file),
                key_value("world", floorplan_gen.generated_gazebo_world_path)
            ])
            bag_record(["/scan", "/tf"], use_sim_time: true)
            serial:
                wait_for_sim()
                spawn_multiple(static_objects)
                robot.init_nav2(start_pose, base_frame_id: "base_link")
                robot.nav_to_pose(goal_pose) with:
                    failure_is_success()
                emit end
"""
    root = scenario(body, "ros", "nav2", "gazebo", "os", "x11", "floorplan_dsl").root
    assert [child.label for child in (root.child.children[0], root.child.children[2])] == ["screen", "test_drive"]


def test_external_functions_are_called_by_their_library():
    root = scenario("do log('in ' + common.get_output_directory())").root
    assert root.arguments["msg"].operands[1].function == "common.get_output_directory"


@each_row(
    ("text", "type_"),
    [
        ("'a' + 'b'", "string"),
        ("1 + 2 * 3", "int"),
        ("1 / 2", "float"),
        ("1m / 2s", "speed"),
        ("2 * 3s", "time"),
        ("3s / 2", "time"),
        ("4m / 2m", "float"),
        ("not (1 < 2 and 2.5 >= 2)", "bool"),
        ("2 in [1, 2]", "bool"),
        ("-(1 + 2)", "int"),
        ("7 % 2", "int"),
    ],
)
def test_operators_give_values_of_a_type(text, type_):
    assert value(text, type_) is not None


def test_multiplication_binds_tighter_than_addition():
    product = value("1 + 2 * 3", "int")
    assert (product.operator, product.operands[1].operator) == ("+", "*")


def test_list_of_structs_keeps_its_order():
    places = value("[position_3d(1m), position_3d(2m)]", "list of position_3d")
    assert isinstance(places, ListOf)
    assert [place.members["x"].value for place in places.items] == [1.0, 2.0]


def test_structs_units_and_enums_in_scope_are_part_of_the_definition():
    definition = scenario("do log('x')", "gazebo")
    member = definition.structs["spawn_entity"]["xacro_arguments"]
    assert (member.type, member.default.value) == (Type("string", "basic"), "")
    assert definition.units["kmph"] == ("speed", 0.277777778, 0.0)
    assert definition.enums["signal"]["sigterm"] == 15


def test_definition_is_a_value_that_can_be_sent_to_a_worker():
    (visit,) = read(NAVIGATION)
    assert pickle.loads(pickle.dumps(visit)) == visit


def test_imported_file_brings_its_declarations_and_is_named_among_the_files(tmp_path):
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "types.osc").write_text("struct box:\n    width: int = 2\n")
    (tmp_path / "base.osc").write_text(
        'import osc.helpers\nimport "more/types.osc"\nscenario base:\n    b: box = box()\n    do log("x")\n'
    )
    main = tmp_path / "main.osc"
    main.write_text('import "base.osc"\nimport "more/types.osc"\nscenario derived inherits base\n')
    assert [definition.name for definition in read_scenarios(main)] == ["derived"]
    assert [file.name for file in files_of(main)] == ["main.osc", "base.osc", "types.osc"]


def test_file_that_two_others_import_is_known_to_both(tmp_path):
    (tmp_path / "c.osc").write_text("struct box\n")
    for name in "ab":
        (tmp_path / f"{name}.osc").write_text(f'import "c.osc"\nstruct {name}:\n    b: box\n')
    text = 'import osc.helpers\nimport "a.osc"\nimport "b.osc"\nscenario s1:\n    p: b = b()\n    do log("x")\n'
    assert read(text, tmp_path)[0].parameters[0].type == Type("b", "struct")


def test_files_that_import_each_other_are_read_once(tmp_path):
    (tmp_path / "a.osc").write_text('import osc.helpers\nimport "b.osc"\nscenario a:\n    do log("x")\n')
    (tmp_path / "b.osc").write_text('import "a.osc"\nstruct box\n')
    assert [definition.name for definition in read_scenarios(tmp_path / "a.osc")] == ["a"]
    assert len(files_of(tmp_path / "a.osc")) == 2


def test_byte_order_mark_and_windows_line_ends_are_no_matter(tmp_path):
    (tmp_path / "a.osc").write_bytes("\ufeffimport osc.helpers\r\nscenario a:\r\n    do log('x')\r\n".encode())
    assert len(read_scenarios(tmp_path / "a.osc")) == 1


@given(st.text(alphabet="abc \n\t:()[].'\"#/*=+-03s@!|\\", max_size=60))
def test_any_text_is_read_or_refused_with_a_place(text):
    try:
        read(f"import osc.helpers\nscenario a:\n    do log({text})\n")
    except OscError as error:
        assert all(fault.place.line >= 1 and fault.place.column >= 1 and fault.expected for fault in error.faults)


@given(st.lists(st.sampled_from(NAVIGATION.split()), max_size=30), st.randoms())
def test_words_of_a_scenario_in_any_order_are_read_or_refused(words, random):
    try:
        read("".join(word + random.choice([" ", "\n", "\n    ", "\n        "]) for word in words))
    except OscError as error:
        assert error.faults


def test_reading_the_navigation_scenario_takes_a_few_milliseconds_of_cpu(loops):
    read(NAVIGATION)
    assert loops(lambda: read(NAVIGATION), 10) < 1.5


def test_time_to_read_a_scenario_grows_with_its_length_and_no_faster(loops):
    def text(lines):
        return "import osc.helpers\nscenario a:\n    do serial:\n" + "        log('x')\n" * lines

    short, long = text(100), text(1000)
    assert loops(lambda: read(long)) < 40 * loops(lambda: read(short))


def test_structs_hold_every_member():
    pose = value("pose_3d()", "pose_3d")
    assert isinstance(pose, Struct) and isinstance(pose.members["position"], Struct)
    assert isinstance(pose.members["orientation"].members["roll"], Constant)
