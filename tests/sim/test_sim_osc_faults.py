"""Scenario files that are refused: place, problem, and expected value."""

import pickle
from pathlib import Path

import pytest
from table import each_row

from vastflow.sim.model.faults import FileError
from vastflow.sim.reading.abstract import abstract_content
from vastflow.sim.reading.vocabulary import ACTIONS
from vastflow.sim.scenario.language.grammar import MOST_PARSED
from vastflow.sim.scenario.language.reading import files_of, read_scenarios, read_text
from vastflow.sim.scenario.tree.support import unsupported

HEAD = "import osc.helpers\nimport osc.ros\nimport osc.nav2\nimport osc.gazebo\n"


def refused(text, folder=Path()):
    """The faults of a text, as they are shown."""
    with pytest.raises(FileError, match=r":\d+:\d+: .") as raised:
        read_text(text, "f.osc", folder)
    return [str(fault) for fault in raised.value.faults]


AROUND = {
    "body": (f"{HEAD}scenario visit:\n    ", ""),
    "before": (HEAD, "scenario visit:\n    do log('x')\n"),
    "file": ("", ""),
}


@pytest.mark.parametrize("section", AROUND)
def test_faults_of_a_scenario_have_place_and_message(golden, section):
    before, after = AROUND[section]

    def faults(text):
        lines = text.replace("\n", "\n    ") + "\n" if section == "body" else text
        return refused(f"{before}{lines}{after}")

    golden("scenarios", section, faults)


def test_faults_of_imports_have_place_and_message(golden, tmp_path):
    """An input begins with the file that is read; a line `>>> name` begins each file that it may import."""

    def faults(text):
        main, *others = text.split(">>> ")
        for name, _, content in (other.partition("\n") for other in others):
            (tmp_path / name).write_text(content)
        return [fault.replace(f"{tmp_path}/", "") for fault in refused(main, tmp_path)]

    golden("scenarios", "imports", faults)


def test_error_of_a_scenario_file_is_pickled():
    with pytest.raises(FileError, match="no scenario") as raised:
        read_text("", "f.osc", Path())
    assert str(pickle.loads(pickle.dumps(raised.value))) == str(raised.value)


def test_actions_that_can_not_be_run_have_place_and_reason(golden):
    def faults(text):
        lines = text.replace("\n", "\n    ")
        (definition,) = read_text(f"{HEAD}import osc.network\nscenario visit:\n    {lines}\n", "f.osc", Path())
        return list(map(str, unsupported(definition, ACTIONS)))

    golden("scenarios", "unsupported", faults)


def test_action_that_two_imports_declare_can_be_imported(tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.osc").write_text("action dance\n")
    imports = 'import osc.helpers\nimport "one.osc"\nimport "two.osc"\n'
    assert read_text(f"{imports}scenario a:\n    do log('x')\n", "f.osc", tmp_path)


@each_row("text", ["(" * 500, "not " * 5000 + "true", "1" + " + 1" * 5000])
def test_endless_expression_is_refused_like_any_other_fault(text):
    assert refused(f"{HEAD}scenario a:\n    do log({text})\n")


def test_file_that_is_missing_or_no_text_is_refused(tmp_path):
    (tmp_path / "a.osc").write_bytes(b"scenario a:\n  \xff")
    for reading, file, message in (
        (read_scenarios, tmp_path / "absent.osc", "There is no file"),
        (files_of, tmp_path / "absent.osc", "There is no file"),
        (read_scenarios, tmp_path / "a.osc", "a.osc:2:3: Byte 0xff is not UTF-8"),
        (read_scenarios, tmp_path, "It is a folder"),
    ):
        with pytest.raises(FileError, match=message):
            reading(file)


def test_fault_after_long_word_is_found_in_linear_time(loops):
    long, short = (f"# {'stands' * n}\nscenario a:\n  do x y:\n" for n in (60_000, 6_000))
    assert loops(lambda: refused(long)) < 40 * loops(lambda: refused(short))


def test_search_for_faults_of_a_large_file_is_bounded():
    waits = "        wait elapsed(1s)\n" * 1_500
    text = f"scenario a:\n    do serial:\n{waits}" + "        wait = elapsed\n" * 20
    assert 1 < len(refused(text)) <= MOST_PARSED // len(text) + 1


def test_nested_modifiers_have_a_limit(tmp_path):
    file = tmp_path / "a.osc"

    def with_timeouts(n):
        timeouts = "    timeout(60s)\n" * n
        file.write_text(f"import osc.helpers\nscenario a:\n{timeouts}    do log('x')\n")
        return abstract_content(file)

    assert with_timeouts(140).digest
    with pytest.raises(FileError, match=r"a.osc.*: expected fewer, got more than 150 compositions and modifiers"):
        with_timeouts(400)
