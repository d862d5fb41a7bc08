"""Scenario files that are accepted, and what they define."""

import pickle
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.faults import FileError, Place
from vastflow.sim.scenario.definition import (
    Call,
    Composition,
    Constant,
    Elapsed,
    Emit,
    EnumValue,
    External,
    Happened,
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


def shown(part):
    """A definition in short."""
    match part:
        case Constant(value=value):
            number = float(f"{value:.9g}") if isinstance(value, float) else value
            return str(value) if isinstance(value, EnumValue) else repr(number)
        case Name(path=path):
            return ".".join(path)
        case Operation(operator=operator, operands=(left, right)):
            return f"({shown(left)} {operator} {shown(right)})"
        case External(function=function, arguments=arguments):
            return f"{function}({', '.join(map(shown, arguments))})"
        case ListOf(items=items):
            return f"[{', '.join(map(shown, items))}]"
        case Struct(type=type_, members=members):
            return f"{type_}({', '.join(f'{name}: {shown(member)}' for name, member in members.items())})"
        case Composition(kind=kind, children=children, label=label):
            return f"{f'{label}: ' if label else ''}{kind}[{'; '.join(map(shown, children))}]"
        case Call(action=action, actor=actor, arguments=arguments, label=label):
            called = f"{f'{label}: ' if label else ''}{action}{f' of {actor}' if actor else ''}"
            return f"{called}({', '.join(map(shown, arguments.values()))})"
        case Wait(until=until, label=label):
            return f"{f'{label}: ' if label else ''}wait {shown(until)}"
        case Elapsed(duration=duration):
            return f"elapsed({shown(duration)})"
        case Happened(event=event, condition=condition):
            return f"@{event}{f' if {shown(condition)}' if condition else ''}"
        case Emit(event=event, label=label):
            return f"{f'{label}: ' if label else ''}emit {event}"
        case Modified(modifier=modifier, arguments=arguments, child=child):
            return f"{modifier}({', '.join(map(shown, arguments.values()))}) {shown(child)}"
        case Until(until=until, child=child):
            return f"until {shown(until)} {shown(child)}"
        case _:
            return shown(part.condition)


def test_navigation_scenario_builds_tree_with_modifiers():
    (visit,) = read(NAVIGATION)
    assert [str(p.type) for p in visit.parameters] == ["pose_3d", "list of pose_3d", "list of spawn_entity"]
    assert visit.actors[0].types == ("differential_drive_robot", "robot", "osc_actor")
    assert shown(visit.root).startswith("timeout(120.0) parallel[repeat(-1) serial[wait elapsed(1.0); log('alive')]; ")
    _, init, drive, _ = visit.root.child.children[1].children
    assert init.arguments["initial_pose"] == Name(("start",), Place("visit.osc", 19, 27))
    assert isinstance(drive, Modified) and drive.child.action == "differential_drive_robot.nav_through_poses"
    assert pickle.loads(pickle.dumps(visit)) == visit


@each_row("name", library_names())
def test_library_is_read_without_scenario(name):
    assert library(name).units


@each_row(
    "text",
    [
        "import osc.helpers\nscenario a:\n\tdo serial:\n\t    log('x')\n            log('y')\n",
        (
            "/* two\nlines */ # more\nimport osc.helpers\n\n  # indented\nscenario a: # here\n    do serial: /* and\n here */\n"
            "        log(# in an argument list\n            'x' /* y */)\n        log('y')\n   # at the end"
        ),
        "\ufeffimport osc.helpers\r\nscenario a:\r\n    do serial:\r\n        log(\\\r\n 'x')\r\n        log('y')\r\n",
    ],
)
def test_tabs_comments_and_line_ends_do_not_matter(tmp_path, text):
    (tmp_path / "a.osc").write_bytes(text.encode())
    (definition,) = read_scenarios(tmp_path / "a.osc")
    assert shown(definition.root) == "serial[log('x'); log('y')]"


def test_scenario_defines_parameters_and_a_tree(golden):
    """Declarations stand above a line `scenario:`; a scenario without `do` is about its parameters."""

    def defined(text):
        before, _, body = text.rpartition("scenario:\n")
        does = "do " in body
        definition = scenario(body if does else f"{body}\ndo log('x')", "ros", "nav2", "gazebo", before=before)
        defaults = [f"{each.name}: {shown(each.default)}" for each in definition.parameters if each.default]
        members = [
            f"{each.name}.{name}: {shown(value)}" for each in definition.actors for name, value in each.members.items()
        ]
        return [*defaults, *members, *([shown(definition.root)] if does else [])]

    golden("scenarios", "definitions", defined, key="defined")


@each_row("modifier", ["inverter()", "repeat()", "retry(count: 3)", "timeout(1s)"])
def test_modifier_wraps_a_scenario_a_composition_and_a_call(modifier):
    whole = (
        f"{modifier}\ndo log('x')",
        f"do serial:\n    {modifier}\n    log('x')",
        f"do log('x') with:\n    {modifier}",
    )
    assert [scenario(body).root.modifier for body in whole] == [modifier.partition("(")[0]] * 3


def test_fields_keep_their_names_units_and_kinds():
    fields = "v: speed = 36.0kmph\n|a name|: int = 3\nvar c: int = 0\nw: speed = 36kmph\nkeep(it.w == 5mps)"
    definition = scenario(f"{fields}\ndo log('x')", before="global g: int = 1\n")
    assert [(p.name, p.unit) for p in definition.parameters] == [("v", "kmph"), ("a name", ""), ("w", "mps")]
    assert [v.name for v in definition.variables] == ["g", "c"]


def test_derived_scenario_inherits_undeclared_parts():
    text = "import osc.helpers\nscenario base:\n    n: int = 1\n    timeout(3s)\n    do log('x')\n"
    text += "scenario derived inherits base:\n    k: int = 2\nscenario other inherits base:\n    do log('y')\n"
    base, derived, other = read(text)
    assert [p.name for p in derived.parameters] == ["n", "k"]
    assert derived.root == base.root
    assert shown(other.root) == "timeout(3.0) log('y')"


def test_structs_units_and_enums_in_scope_belong_to_the_definition():
    definition = scenario("do log('x')", "gazebo")
    member = definition.structs["spawn_entity"]["xacro_arguments"]
    assert (member.type, member.default.value) == (Type("string", "basic"), "")
    assert definition.units["kmph"] == ("speed", 0.277777778, 0.0)
    assert definition.enums["signal"]["sigterm"] == 15


def test_imports_bring_their_declarations_and_are_among_the_files(tmp_path):
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "types.osc").write_text('import "../main.osc"\nstruct box:\n    width: int = 2\n')
    body = "    b: box = box()\n    do log('x')\n"
    for name in ("base", "other"):
        text = f'import osc.helpers\nimport "more/types.osc"\nscenario {name}:\n{body}'
        (tmp_path / f"{name}.osc").write_text(text)
    main = tmp_path / "main.osc"
    main.write_text('import "base.osc"\nimport "other.osc"\nimport "more/types.osc"\nscenario derived inherits base\n')
    (derived,) = read_scenarios(main)
    assert (derived.name, derived.parameters[0].type) == ("derived", Type("box", "struct"))
    assert [file.name for file in files_of(main)] == ["main.osc", "base.osc", "types.osc", "other.osc"]


@given(st.text(alphabet="abc \n\t:()[].'\"#/*=+-03s@!|\\", max_size=60))
def test_any_text_is_read_or_refused_with_a_place(text):
    try:
        read(f"import osc.helpers\nscenario a:\n    do log({text})\n")
    except FileError as error:
        assert all(fault.place.line >= 1 and fault.place.column >= 1 and fault.expected for fault in error.faults)


@given(st.lists(st.sampled_from(NAVIGATION.split()), max_size=30), st.randoms())
def test_words_of_a_scenario_in_any_order_are_read_or_refused(words, random):
    try:
        read("".join(word + random.choice([" ", "\n", "\n    ", "\n        "]) for word in words))
    except FileError as error:
        assert error.faults


def test_time_to_read_is_small_and_grows_with_the_length(loops):
    def text(lines):
        return "import osc.helpers\nscenario a:\n    do serial:\n" + "        log('x')\n" * lines

    short, long = text(100), text(1000)
    assert loops(lambda: read(NAVIGATION), 10) < 1.5
    assert loops(lambda: read(long)) < 40 * loops(lambda: read(short))
