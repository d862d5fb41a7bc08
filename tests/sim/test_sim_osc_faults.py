"""Scenario files that are refused: where, what was found, what would be right."""

import pickle
from pathlib import Path

import pytest
from table import each_row

from vastflow.sim.reading.abstract import abstract_content
from vastflow.sim.scenario.language.faults import OscError
from vastflow.sim.scenario.language.grammar import MOST_PARSED
from vastflow.sim.scenario.language.reading import files_of, read_scenarios, read_text

HEAD = "import osc.helpers\nimport osc.ros\nimport osc.nav2\nimport osc.gazebo\n"


def refused(text, folder=Path()):
    """The faults of a text, as they are shown."""
    with pytest.raises(OscError, match=r":\d+:\d+: .") as raised:
        read_text(text, "f.osc", folder)
    return [str(fault) for fault in raised.value.faults]


def fault_of(body, before=""):
    """The one fault of a scenario with that body, without its place."""
    lines = "".join(f"    {line}\n" for line in body.split("\n"))
    (fault,) = refused(f"{HEAD}{before}scenario visit:\n{lines}")
    return fault.split(": ", 1)[1]


@pytest.mark.parametrize(
    ("section", "before", "after"),
    [
        ("body", f"{HEAD}scenario visit:\n    ", ""),
        ("before", HEAD, "scenario visit:\n    do log('x')\n"),
        ("file", "", ""),
    ],
    ids=["body", "before", "file"],
)
def test_faults_of_a_scenario_have_place_and_message(golden, section, before, after):
    def faults(text):
        lines = text.replace("\n", "\n    ") + "\n" if section == "body" else text
        return refused(f"{before}{lines}{after}")

    golden("scenarios", section, faults)


def test_external_function_of_ones_own_is_not_run():
    before = "struct mine:\n    def f() -> int is external my.module.f()\n"
    assert "mine.f is external code of your own" in fault_of("do log(mine.f())", before)


def test_modifier_of_ones_own_is_not_run():
    assert "modifier 'fast' can't be executed" in fault_of("fast()\ndo log('x')", "modifier fast\n")


def test_action_that_two_imports_declare_can_be_imported_and_not_used(tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.osc").write_text("action dance\n")
    imports = 'import osc.helpers\nimport "one.osc"\nimport "two.osc"\n'
    assert read_text(f"{imports}scenario a:\n    do log('x')\n", "f.osc", tmp_path)
    (fault,) = refused(f"{imports}scenario a:\n    do dance()\n", tmp_path)
    assert f"'dance' is declared by {tmp_path}/one.osc and {tmp_path}/two.osc" in fault


def test_file_without_a_scenario_is_refused():
    assert refused("import osc.helpers\n") == ["f.osc:1:1: expected 'scenario name:' and what it does, got no scenario"]


def test_unknown_library_is_refused_with_the_nearest_name():
    text = "import osc.helper\nscenario a:\n    do emit end\n"
    assert refused(text) == ["f.osc:1:8: unknown library 'osc.helper'; did you mean 'osc.helpers'?"]


def test_library_of_another_machine_is_refused_by_what_it_is_about():
    assert "which vastflow does not have" in refused("import osc.docker\nscenario a:\n    do emit end\n")[0]


def test_imported_file_that_is_missing_is_a_fault_of_the_import(tmp_path):
    (fault,) = refused('import "absent.osc"\nscenario a:\n    do emit end\n', tmp_path)
    assert fault.startswith(f"f.osc:1:8: there is no file {tmp_path}/absent.osc")


def test_two_imports_that_declare_the_same_type_are_refused(tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.osc").write_text("struct box\n")
    (fault,) = refused('import "one.osc"\nimport "two.osc"\nscenario a:\n    do emit end\n', tmp_path)
    assert fault == "f.osc:2:8: 'box' is declared by an import above too; one of the imports"


def test_fault_of_an_imported_file_has_its_place_there(tmp_path):
    (tmp_path / "types.osc").write_text("struct a:\n    n: itn\n")
    (fault,) = refused('import "types.osc"\nscenario a:\n    do emit end\n', tmp_path)
    assert fault.startswith(f"{tmp_path}/types.osc:2:8: unknown type 'itn'; did you mean 'int'?")


def test_fault_has_line_and_column_from_one():
    assert refused("import osc.helpers\nscenario a:\n    do serial:\n        logg('x')\n")[0].startswith("f.osc:4:9: ")


def test_every_fault_of_a_file_is_said_at_once_in_its_order():
    text = f"{HEAD}scenario a:\n    v: sped\n    do serial:\n        logg('x')\n        wait elapsed(3m)\n"
    assert [fault.split(": ")[0] for fault in refused(text)] == ["f.osc:6:8", "f.osc:8:9", "f.osc:9:22"]


def test_nothing_is_said_of_the_use_of_a_name_whose_declaration_is_at_fault():
    body = "    v: sped\n    bot: robt\n    do serial:\n        log(v)\n        bot.nav_to_pose(v)\n"
    assert [fault.split(": ")[0] for fault in refused(f"{HEAD}scenario a:\n{body}")] == ["f.osc:6:8", "f.osc:7:10"]


def test_reading_goes_on_behind_lines_that_are_not_in_the_language():
    text = (
        f"{HEAD}scenari a:\n    do emit end\nscenario b:\n    v = 3\n    do paralel:\n        log('x',)\n    event 3\n"
    )
    assert [fault.split(": ")[0] for fault in refused(text)] == ["f.osc:5:1", "f.osc:8:7", "f.osc:9:8", "f.osc:11:11"]


def test_bracket_that_is_not_closed_is_one_fault():
    assert (
        len(refused(f"{HEAD}scenario b:\n    do serial:\n        log('x'\n        log('y')\n        emit end\n")) == 1
    )


@each_row("text", ["(" * 500, "not " * 5000 + "true", "1" + " + 1" * 5000])
def test_endless_expression_is_refused_like_any_other_fault(text):
    assert refused(f"{HEAD}scenario a:\n    do log({text})\n")


def test_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(OscError, match="there is no file"):
        read_scenarios(tmp_path / "absent.osc")
    with pytest.raises(OscError, match="there is no file"):
        files_of(tmp_path / "absent.osc")


def test_file_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "a.osc").write_bytes(b"scenario a:\n  \xff")
    with pytest.raises(OscError, match=r"a.osc:2:3: byte 0xff is not UTF-8"):
        read_scenarios(tmp_path / "a.osc")
    with pytest.raises(OscError, match="can't be read"):
        read_scenarios(tmp_path)


def test_error_survives_the_way_to_another_process():
    with pytest.raises(OscError, match="no scenario") as raised:
        read_text("", "f.osc", Path())
    assert str(pickle.loads(pickle.dumps(raised.value))) == str(raised.value)


def test_long_word_before_a_fault_costs_no_time_that_grows_with_its_square(loops):
    def refused(length):
        with pytest.raises(OscError, match="got "):
            read_text(f"# {'stands' * length}\nscenario a:\n  do x y:\n", "a.osc", Path())

    assert loops(lambda: refused(60_000)) < 40 * loops(lambda: refused(6_000))


def test_faults_of_a_large_file_are_looked_for_no_longer_than_a_few_parses_take():
    waits = "        wait elapsed(1s)\n" * 1_500
    text = f"scenario a:\n    do serial:\n{waits}" + "        wait = elapsed\n" * 20
    with pytest.raises(OscError, match="got '='") as caught:
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
        OscError, match=r"a.osc.*: expected fewer, got more than 150 compositions and modifiers in one another"
    ):
        with_timeouts(400)
