"""Scenario files that are refused: where, what was found, what would be right."""

import pickle
from pathlib import Path

import pytest

from vastflow.sim.osc.faults import OscError
from vastflow.sim.osc.grammar import MOST_PARSED
from vastflow.sim.osc.reading import files_of, read_scenarios, read_text
from vastflow.sim.reading.abstract import abstract_content

HEAD = "import osc.helpers\nimport osc.ros\nimport osc.nav2\nimport osc.gazebo\n"


def refused(text, folder=Path()):
    """The faults of a text, as they are shown."""
    with pytest.raises(OscError, match=r":\d+:\d+: .+; .+") as raised:
        read_text(text, "f.osc", folder)
    return [str(fault) for fault in raised.value.faults]


def fault_of(body, before=""):
    """The one fault of a scenario with that body, without its place."""
    lines = "".join(f"    {line}\n" for line in body.split("\n"))
    (fault,) = refused(f"{HEAD}{before}scenario visit:\n{lines}")
    return fault.split(": ", 1)[1]


@pytest.mark.parametrize(
    ("done", "words"),
    [
        ("log('x',)", "found ')'"),
        ("logg('x')", "unknown action 'logg'; did you mean 'log'?"),
        ("log(mesage: 'x')", "log has no parameter 'mesage'; did you mean 'msg'?"),
        ("run_process(comand: 'x')", "run_process has no parameter 'comand'; did you mean 'command'?"),
        ("log('x', 'y')", "found one argument more than log takes; 1 at most"),
        ("log(msg: 'x', msg: 'y')", "'msg' of log is given twice"),
        ("run_process(wait_for_shutdown: true, 'x')", "found a value after a named one"),
        ("run_process()", "run_process is called without command: string"),
        ("run_process(pose_3d())", "found a pose_3d for 'command' of run_process, a string; a text in quotes"),
        ("log(absent)", "unknown name 'absent'"),
        ("nav_to_pose(pose_3d())", "it is an action of differential_drive_robot: instance.nav_to_pose(…)"),
        ("capture_screen()", "unknown action 'capture_screen'; 'import osc.x11', which declares it"),
        ("robot.nav_to_pose(pose_3d())", "unknown actor instance 'robot'"),
        ("emit done", "unknown event 'done'; known: end, fail"),
        ("wait @done", "unknown event 'done'; 'event done' in the scenario"),
        ("wait elapsed(3m)", "found 3m, a length, for a duration, a time; a number with a unit of time, such as 3s"),
        ("wait elapsed(3)", "found 3, an int, for a duration, a time; a number with a unit of time, such as 3s"),
        ("wait elapsed()", "found elapsed without one duration"),
        ("wait elapsed(random.get_random_string(['1']))", "found a string for a duration, a time"),
        ("log(spawn_entity.entity_name)", "unknown name 'spawn_entity'"),
        ("log(position_3d.w)", "a position_3d has no member 'w'"),
        ("wait elapsed(3sek)", "unknown unit 'sek'; did you mean 'sec'?"),
        ("wait 3", "found 3, an int, for a condition, a bool; true or false"),
        ("wait 3 == 'x'", "'==' does not go with an int and a string; values of one type"),
        ("log(3s + 2m)", "'+' does not go with a time and a length"),
        ("log(1 + 'x')", "'+' does not go with an int and a string"),
        ("log(pose_3d(potision: 3))", "pose_3d(…) has no parameter 'potision'; did you mean 'position'?"),
        ("log(pose())", "unknown struct 'pose'; did you mean 'pose_3d'?"),
        ("log(spawn_entity('a'))", "spawn_entity(…) is called without model: string"),
        ("log(signal!term)", "enum signal has no member 'term'; did you mean 'sigterm'?"),
        ("log(signals!term)", "unknown enum 'signals'; did you mean 'signal'?"),
        ("log(random.get_integer(1, 2))", "random has no function 'get_integer'"),
        ("log(rnd.get_int(1, 2))", "unknown function 'rnd.get_int'"),
        ("log(random.get_int(1))", "random.get_int() is called without max_val: int"),
        ("log([1, 'x'])", "found a list of int and string; items of one type"),
        ("log(log('x'))", "'log' is an action, which has no value"),
        ("increment(n)", "found n for 'target_variable' of increment, the name of a variable"),
        ("log('x') with:\n    timout(3s)", "unknown modifier 'timout'; did you mean 'timeout'?"),
        ("log('x') with:\n    timeout()", "timeout is called without duration: time"),
        ("log('x') with:\n    timeout(3m)", "found 3m, a length, for 'duration' of timeout, a time"),
        ("log('x') with:\n    keep(it.x == 3)", "no member 'x'; known: msg"),
        ("log('x') with:\n    keep(it.msg != 'y')", "found a 'keep' that gives no value"),
        ("log('x') with:\n    keep(msg == 'y')", "found a 'keep' that gives no value"),
        (
            "log('x') with:\n    keep(it.msg in ['y', 'z'])",
            "and a ParameterVariationList of the parameter in the campaign",
        ),
        ("serial:\n    log('x')\nwith:\n    keep(it.x == 3)", "found 'keep' where nothing has members"),
        ("log([])", "found an empty list, which the language does not have; one item or more"),
        ("visit()", "unknown action 'visit'; an action; a scenario can be inherited from and not be called"),
        ("increment(robot.laps)", "found robot.laps for 'target_variable' of increment, the name of a variable"),
        ("log(3.)", "found '.'; a number with digits after the point, such as 3.0"),
        ("log('x)", "found a string that does not end"),
        ("log($)", "found '$'"),
        ("serial:\n    repeat()", "found an empty serial"),
        ("serail:\n    log('x')", "found 'serail'; did you mean 'serial'?"),
        ("all:\n    log('x')", "found 'all'; serial, parallel, one_of or an action"),
        ("serial:", "a block, indented deeper than the line before"),
    ],
)
def test_what_is_done_is_checked(done, words):
    assert words in fault_of(f"do {done}")


@pytest.mark.parametrize(
    ("member", "words"),
    [
        ("v: float = 3", "found 3, an int, for 'v', a float; 3.0"),
        ("v: int = 3.0", "found 3.0, a float, for 'v', an int; a whole number"),
        ("v: uint = -3", "a whole number that is not negative"),
        ("v: bool = 1", "true or false"),
        ("v: string = 1", "a text in quotes"),
        ("v: speed = 3s", "found 3s, a time, for 'v', a speed; a number with a unit of speed, such as 3mps"),
        ("v: speed = 3", "found 3, an int, for 'v', a speed; a number with a unit of speed, such as 3mps"),
        ("v: sped", "unknown type 'sped'; did you mean 'speed'?"),
        ("v: pose_3d = position_3d()", "found a position_3d for 'v', a pose_3d; pose_3d(…)"),
        ("v: list of int = [1, 'x']", "found 'x', a string, for an item of 'v', an int"),
        ("v: list of int = 1", "[…], a list of int"),
        ("v: signal = 3", "one of signal!sighup"),
        ("v: any = 3", "unknown type 'any'"),
        ("s: string", "'s' is a base unit, a reserved word"),
        ("event m", "'m' is a base unit, a reserved word"),
        ("v: int\nv: int", "'v' is declared already"),
        ("bot: differential_drive_robt", "did you mean 'differential_drive_robot'?"),
        ("bot: differential_drive_robot = 3", "an instance of differential_drive_robot"),
        ("bot: differential_drive_robot with:\n    keep(it.name_space == 'a')", "did you mean 'namespace'?"),
        ("p: pose_3d with:\n    keep(it.position == 3)", "found 3, an int, for 'position', a position_3d"),
        ("p: pose_3d with:\n    keep(it.position.w == 3m)", "a position_3d has no member 'w'"),
        ("p: pose_3d with:\n    keep(p.position.x == 3m)", "found a 'keep' that gives no value"),
        ("p: pose_3d with:\n    timeout(3s)", "found a modifier of a field"),
        ("w: int = later\nlater: int = w + 1", "the value of 'w' needs 'w' itself; a value"),
        ("w: int = w", "the value of 'w' needs 'w' itself"),
        ("v: list of int = []", "found an empty list, which the language does not have; one item or more"),
        ("v: list of int = [ ]", "found an empty list"),
        ("v: listof int", "found 'int'; '=', 'with' or the end of the line"),
        ("v: listofint", "unknown type 'listofint'"),
        ("v: list ofint", "found 'ofint'; a blank behind 'of'"),
        ("timout(3s)", "did you mean 'timeout'?"),
        ("log('early')", "found log(…) in the body of a scenario; 'do' before it"),
        ("do log('z')", "found a second 'do'"),
        (
            "bot: differential_drive_robot\nbot.nav_to_pose(pose_3d())",
            "found bot.nav_to_pose(…) in the body of a scenario",
        ),
        ("bots: list of differential_drive_robot", "found a list of actors; 'name: actor' for each instance"),
        ("var bot: differential_drive_robot", "found a variable of an actor"),
        ("v: int = 9999999999999999.e", "found '.'"),
        ("v: float = 1" + "0" * 400 + ".0", "found a number that is too large"),
    ],
)
def test_the_members_of_a_scenario_are_checked(member, words):
    assert words in fault_of(f"{member}\ndo log('x')")


@pytest.mark.parametrize(
    ("body", "construct"),
    [
        ("on @e:\n    log('x')\ndo log('x')", "on"),
        ("do serial:\n    on elapsed(3s):\n        log('x')", "on"),
        ("call log('x')\ndo log('x')", "call"),
        ("do call log('x')", "call"),
        ("cover(x)\ndo log('x')", "cover"),
        ("record(x)\ndo log('x')", "record"),
        ("remove_default(it.x)\ndo log('x')", "remove_default"),
        ("do wait every(3s)", "every"),
        ("do wait rise(1 == 2)", "rise"),
        ("do wait fall(1 == 2)", "fall"),
        ("do log(range(1, 2))", "range"),
        ("do log([1..2])", "a range"),
        ("do log(sample(1, 2))", "sample"),
        ("do log(true ? 1 : 2)", "? :"),
        ("p: list of int = [1]\ndo log(p[0])", "an index"),
        ("do serial(duration: 3s):\n    log('x')", "serial with arguments"),
        ("do emit end(3)", "emit with arguments"),
        ("event e is @other\ndo log('x')", "event … is"),
    ],
)
def test_a_construct_that_is_not_executed_is_refused_by_name_with_what_to_write_in_its_place(body, construct):
    assert fault_of(body).startswith(f"found {construct}, which vastflow does not have; ")


@pytest.mark.parametrize(
    ("declaration", "words"),
    [
        ("extend visit:\n    n: int\n", "found extend, which vastflow does not have"),
        ("extend signal: [more]\n", "found extend, which vastflow does not have"),
        ("action a:\n    do log('x')\n", "found 'do' in an action"),
        ("actor a:\n    timeout(3s)\n", "found a modifier of an actor"),
        ("modifier robot.fast\n", "found modifier robot.fast, with an actor"),
        ("struct s\n", "'s' is a base unit, a reserved word"),
        ("struct a:\n    s: string\n", "'s' is a base unit, a reserved word"),
        ("struct pose_3d\n", "'pose_3d' is declared already"),
        ("struct a\nstruct a\n", "'a' is declared already at f.osc:5:8"),
        ("struct listofwishes\n", "found type 'listofwishes', which begins with 'listof'; another name"),
        ("struct a inherits position_3d:\n    x: int = 3\n", "'x' is declared already, as length; length, or another"),
        ("struct a inherits pose\n", "unknown struct 'pose'; did you mean 'pose_3d'?"),
        ("struct a:\n    n: int = 3.0\n", "found 3.0, a float, for 'n', an int"),
        ("struct a:\n    n: int\n    n: int\n", "'n' is declared already"),
        ("action rover.drive\n", "unknown actor 'rover'"),
        ("action a.b.c\n", "an actor and a name at most"),
        ("enum e: [a, a]\n", "'a' is declared already"),
        ("enum e: [a = 1.5]\n", "found 1.5 for 'a'; a whole number"),
        ("enum e: [a,]\n", "found ']'; a name"),
        ("unit furlong of lenght is SI(m: 1)\n", "did you mean 'length'?"),
        ("scenario a inherits visited:\n    do log('x')\n", "unknown scenario 'visited'; did you mean 'visit'?"),
        ("scenario a inherits a:\n    do log('x')\n", "scenario 'a' inherits from itself"),
        ("scenario a:\n    n: int\n", "scenario a does nothing; 'do' and an action"),
        ("global g: int = 3.0\n", "found 3.0, a float, for 'g', an int"),
        ("namespace n\n", "found 'namespace'"),
        ("scenari a:\n    do log('x')\n", "did you mean 'scenario'?"),
    ],
)
def test_declarations_are_checked(declaration, words):
    assert words in fault_of("do log('x')", declaration)


def test_a_change_of_a_condition_is_awaited_as_two_waits():
    assert fault_of("do wait rise(1 == 2)").endswith("a serial of 'wait not (…)' and 'wait …'")
    assert fault_of("do wait fall(1 == 2)").endswith("a serial of 'wait …' and 'wait not (…)'")


def test_an_external_function_of_ones_own_is_not_run():
    before = "struct mine:\n    def f() -> int is external my.module.f()\n"
    assert "mine.f is external code of your own" in fault_of("do log(mine.f())", before)


def test_a_modifier_of_ones_own_is_not_run():
    assert "modifier 'fast' can't be executed" in fault_of("fast()\ndo log('x')", "modifier fast\n")


def test_an_action_that_two_imports_declare_can_be_imported_and_not_used(tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.osc").write_text("action dance\n")
    imports = 'import osc.helpers\nimport "one.osc"\nimport "two.osc"\n'
    assert read_text(f"{imports}scenario a:\n    do log('x')\n", "f.osc", tmp_path)
    (fault,) = refused(f"{imports}scenario a:\n    do dance()\n", tmp_path)
    assert f"'dance' is declared by {tmp_path}/one.osc and {tmp_path}/two.osc" in fault


def test_a_file_without_a_scenario_is_refused():
    assert refused("import osc.helpers\n") == ["f.osc:1:1: found no scenario; 'scenario name:' and what it does"]


def test_an_unknown_library_is_refused_with_the_nearest_name():
    text = "import osc.helper\nscenario a:\n    do emit end\n"
    assert refused(text) == ["f.osc:1:8: unknown library 'osc.helper'; did you mean 'osc.helpers'?"]


def test_a_library_of_another_machine_is_refused_by_what_it_is_about():
    assert "which vastflow does not have" in refused("import osc.docker\nscenario a:\n    do emit end\n")[0]


def test_an_imported_file_that_is_missing_is_a_fault_of_the_import(tmp_path):
    (fault,) = refused('import "absent.osc"\nscenario a:\n    do emit end\n', tmp_path)
    assert fault.startswith(f"f.osc:1:8: there is no file {tmp_path}/absent.osc")


def test_two_imports_that_declare_the_same_type_are_refused(tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.osc").write_text("struct box\n")
    (fault,) = refused('import "one.osc"\nimport "two.osc"\nscenario a:\n    do emit end\n', tmp_path)
    assert fault == "f.osc:2:8: 'box' is declared by an import above too; one of the imports"


def test_a_fault_of_an_imported_file_has_its_place_there(tmp_path):
    (tmp_path / "types.osc").write_text("struct a:\n    n: itn\n")
    (fault,) = refused('import "types.osc"\nscenario a:\n    do emit end\n', tmp_path)
    assert fault.startswith(f"{tmp_path}/types.osc:2:8: unknown type 'itn'; did you mean 'int'?")


def test_a_fault_has_line_and_column_from_one():
    assert refused("import osc.helpers\nscenario a:\n    do serial:\n        logg('x')\n")[0].startswith("f.osc:4:9: ")


def test_every_fault_of_a_file_is_said_at_once_in_its_order():
    text = f"{HEAD}scenario a:\n    v: sped\n    do serial:\n        logg('x')\n        wait elapsed(3m)\n"
    assert [fault.split(": ")[0] for fault in refused(text)] == ["f.osc:6:8", "f.osc:8:9", "f.osc:9:22"]


def test_nothing_is_said_of_the_use_of_a_name_whose_declaration_is_at_fault():
    body = "    v: sped\n    bot: robt\n    do serial:\n        log(v)\n        bot.nav_to_pose(v)\n"
    assert [fault.split(": ")[0] for fault in refused(f"{HEAD}scenario a:\n{body}")] == ["f.osc:6:8", "f.osc:7:10"]


@pytest.mark.parametrize(
    ("type_", "words"),
    [
        ("floorplan_generator", "'import osc.floorplan_dsl', which declares it"),
        ("floorplan_genrator", "did you mean 'floorplan_generator' of osc.floorplan_dsl?"),
    ],
)
def test_a_type_of_a_library_that_is_not_imported_is_refused_with_the_import(type_, words):
    assert words in fault_of(f"a: {type_}\ndo log('x')")


def test_reading_goes_on_behind_lines_that_are_not_in_the_language():
    text = (
        f"{HEAD}scenari a:\n    do emit end\nscenario b:\n    v = 3\n    do paralel:\n        log('x',)\n    event 3\n"
    )
    assert [fault.split(": ")[0] for fault in refused(text)] == ["f.osc:5:1", "f.osc:8:7", "f.osc:9:8", "f.osc:11:11"]


def test_a_bracket_that_is_not_closed_is_one_fault():
    assert (
        len(refused(f"{HEAD}scenario b:\n    do serial:\n        log('x'\n        log('y')\n        emit end\n")) == 1
    )


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("scenario a:\n        do emit end\n    event e\n", "f.osc:3:5: found a line indented by 4 blanks"),
        ("scenario a:\n    event e\n      event f\n", "f.osc:3:7: found a line that is indented deeper"),
        ("scenario a\n    event e\n", "f.osc:2:5: found a line that is indented deeper"),
        ("scenario a:\nevent e\n", "f.osc:2:1: found 'event'; a block, indented deeper"),
        ("scenario a:", "f.osc:1:12: found the end of the file; a block, indented deeper"),
        ("/* open", "f.osc:1:1: found a comment that does not end"),
        ("scenario |a:\n", "f.osc:1:10: found a name that does not end"),
    ],
)
def test_a_text_that_is_not_in_the_language_is_refused_at_its_place(text, place):
    assert refused(text)[0].startswith(place)


@pytest.mark.parametrize("text", ["(" * 500, "not " * 5000 + "true", "1" + " + 1" * 5000])
def test_an_endless_expression_is_refused_like_any_other_fault(text):
    assert refused(f"{HEAD}scenario a:\n    do log({text})\n")


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(OscError, match="there is no file"):
        read_scenarios(tmp_path / "absent.osc")
    with pytest.raises(OscError, match="there is no file"):
        files_of(tmp_path / "absent.osc")


def test_a_file_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "a.osc").write_bytes(b"scenario a:\n  \xff")
    with pytest.raises(OscError, match=r"a.osc:2:3: byte 0xff is not UTF-8"):
        read_scenarios(tmp_path / "a.osc")
    with pytest.raises(OscError, match="can't be read"):
        read_scenarios(tmp_path)


def test_an_error_survives_the_way_to_another_process():
    with pytest.raises(OscError, match="no scenario") as raised:
        read_text("", "f.osc", Path())
    assert str(pickle.loads(pickle.dumps(raised.value))) == str(raised.value)


def test_a_long_word_before_a_fault_costs_no_time_that_grows_with_its_square(loops):
    def refused(length):
        with pytest.raises(OscError, match="found "):
            read_text(f"# {'stands' * length}\nscenario a:\n  do x y:\n", "a.osc", Path())

    assert loops(lambda: refused(60_000)) < 40 * loops(lambda: refused(6_000))


def test_faults_of_a_large_file_are_looked_for_no_longer_than_a_few_parses_take():
    waits = "        wait elapsed(1s)\n" * 1_500
    text = f"scenario a:\n    do serial:\n{waits}" + "        wait = elapsed\n" * 20
    with pytest.raises(OscError, match="found '='") as caught:
        read_text(text, "a.osc", Path())
    assert 1 < len(caught.value.faults) <= MOST_PARSED // len(text) + 1


def test_modifiers_in_one_another_have_a_limit_and_below_it_the_definition_has_a_digest(tmp_path):
    file = tmp_path / "a.osc"

    def with_timeouts(n):
        timeouts = "    timeout(60s)\n" * n
        file.write_text(f"import osc.helpers\nscenario a:\n{timeouts}    do log('x')\n")
        return abstract_content(file)

    assert with_timeouts(140).digest
    with pytest.raises(
        OscError, match=r"a.osc.*: found more than 150 compositions and modifiers in one another; fewer"
    ):
        with_timeouts(400)
