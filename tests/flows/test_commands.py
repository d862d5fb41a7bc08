"""The command line: what it prints where, and its exit codes."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from vastflow.flows import api
from vastflow.flows.__main__ import RENAMED, app
from vastflow.flows.results.summary import Summary
from vastflow.flows.terminal.ending import check_writable
from vastflow.oracles.evidence.rates import Counts
from vastflow.tasks.engine.progress import Progress

SUMMARY = Summary(2, 0, 0, 4, 4, 0, 4, 0, 0, 40.0, 3.0, 2.0, "results/x", {"success": Counts(4, 0, 0)})


def called(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def running(monkeypatch, behave):
    """Put `behave(observer)` in the campaign's place."""

    def run_campaign(path, *, observer, **options):
        return behave(observer)

    monkeypatch.setattr(api, "run_campaign", run_campaign)


def edited(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def not_yaml(path):
    path.write_text("configuration: [\n  - name: {a\n")


def unknown_key(path):
    edited(path, "  runs: 2", "  rums: 2")


def wrong_type(path):
    edited(path, "  runs: 2", "  runs: many")


def missing_map(path):
    edited(path, "room.yaml", "cellar.yaml")


def map_with_a_missing_image(path):
    path.with_name("room.pgm").unlink()


def unknown_producer(path):
    edited(path, "ParameterVariationList", "ParameterVariationLiszt")


def producer_parameter_out_of_range(path):
    edited(path, "ParameterVariationList:", "ParameterVariationDistributionUniform:")
    edited(path, "values: [0.0, 0.02]", "{num_variations: 0, min: 0.0, max: 1.0}"[1:-1].replace(", ", "\n          "))


def goal_that_no_producer_writes(path):
    edited(path, "      - goal_pose: {x: 3.0, y: 1.0, yaw: 0.0}\n", "")


def empty_campaign(path):
    path.write_text("version: 1\nconfiguration: []\nexecution:\n  runs: 2\n")


def unknown_oracle(path):
    path.write_text(path.read_text() + "evaluation:\n  oracles:\n    - performence\n")


def oracle_parameter_of_wrong_type(path):
    path.write_text(path.read_text() + "evaluation:\n  oracles:\n    - success: {allow_missed: perhaps}\n")


BAD_FILES = {
    not_yaml: ":",
    unknown_key: "did you mean 'runs'?",
    wrong_type: "execution.runs",
    missing_map: "cellar.yaml",
    map_with_a_missing_image: "room.pgm",
    unknown_producer: "did you mean 'ParameterVariationList'?",
    producer_parameter_out_of_range: "num_variations",
    goal_that_no_producer_writes: "goal_pose",
    empty_campaign: "an empty campaign",
    unknown_oracle: "did you mean 'performance'?",
    oracle_parameter_of_wrong_type: "allow_missed",
}


@pytest.mark.parametrize(("spoil", "words"), BAD_FILES.items(), ids=[spoil.__name__ for spoil in BAD_FILES])
@pytest.mark.parametrize("command", ["validate", "run"])
def test_bad_file_exits_with_2_says_where_and_writes_nothing(small_room, tmp_path, monkeypatch, command, spoil, words):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    spoil(small_room)
    before = sorted(tmp_path.rglob("*"))
    result = called(command, "campaign/room.vast")
    assert result.exit_code == 2
    assert result.stdout == ""
    (fault,) = result.stderr.splitlines()
    file, line, column, rest = fault.split(":", 3)
    assert (file, line.isdigit(), column.isdigit()) == ("campaign/room.vast", True, True)
    assert words in rest and "Traceback" not in result.stderr
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("command", ["validate", "run"])
def test_file_that_is_not_there_exits_with_2(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    result = called(command, "nowhere.vast")
    assert result.exit_code == 2 and "nowhere.vast" in result.stderr and "Traceback" not in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_all_faults_of_a_file_are_said_at_once(small_room):
    unknown_key(small_room)
    missing_map(small_room)
    oracle_parameter_of_wrong_type(small_room)
    assert len(called("validate", small_room).stderr.splitlines()) == 3


def test_section_that_is_wrong_itself_is_said_once(small_room):
    missing_map(small_room)
    small_room.write_text(small_room.read_text() + "evaluation:\n  oracles: {1: 2}\n")
    said = called("validate", small_room).stderr
    assert len(said.splitlines()) == 2 and "evaluation.oracles" in said


def test_valid_file_is_ok_with_its_counts(small_room):
    result = called("validate", small_room)
    assert (result.exit_code, result.stdout) == (0, "OK: 1 family, 1 producer, 1 oracle\n")


def test_what_this_version_does_not_execute_is_said_and_the_file_is_ok(small_room):
    edited(small_room, "  runs: 2", "  runs: 2\n  image: some/image")
    result = called("validate", small_room)
    assert result.exit_code == 0
    note, ok = result.stdout.splitlines()
    assert "execution.image" in note and "not executed by this version" in note and ok.startswith("OK")


def test_validate_and_run_refuse_a_search_with_an_unknown_step(tmp_path):
    file = tmp_path / "search.vast"
    (tmp_path / "wait.osc").write_text("import osc.helpers\nscenario patient:\n    a: int\n    do wait elapsed(1s)\n")
    file.write_text(
        "version: 1\nexecution: {scenario_file: wait.osc}\n"
        "search:\n  strategy: random\n  search_space: {a: {type: int, low: 1, high: 2}}\n  budget: {batches: 1}\n"
        "  postprocessing: [render]\n"
    )
    result = called("validate", file)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "'render' is not executed by this version" in result.stderr
    result = called("run", file, "--results", tmp_path / "results")
    assert result.exit_code == 2 and "search" in result.stderr
    assert not (tmp_path / "results").exists()


def test_help_lists_twelve_commands_and_two_groups():
    _, listed = called("--help").stdout.split("Commands:\n")
    assert [line.split()[0] for line in listed.splitlines() if line.strip()] == [
        *("init", "validate", "plan", "run", "show", "replay", "compare", "minimize", "export", "params", "deploy"),
        *("store", "floorplan", "scenario"),
    ]


@pytest.mark.parametrize("former", RENAMED)
def test_former_command_names_its_successor(former):
    result = called(*former.split(), "x")
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == f"expected `vastflow {RENAMED[former]}`, got `vastflow {former}`, which it replaces\n"


@pytest.mark.parametrize("option", [("--runs", "2"), ("--only", "room"), ("--as-v1",)], ids=" ".join)
@pytest.mark.parametrize("command", ["run", "plan"])
def test_campaign_directory_takes_no_option_that_changes_what_is_run(tmp_path, command, option):
    result = called(command, tmp_path, *option)
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{option[0]}: expected a campaign file, got {tmp_path}" in result.stderr


def test_schema_is_json_and_knows_the_sections():
    result = called("validate", "--schema")
    assert {"configuration", "execution", "evaluation"} <= set(json.loads(result.stdout)["properties"])


@pytest.mark.parametrize(
    "arguments", [["--runs", "0"], ["--workers", "0"], ["--runs", "many"], ["--nonsense"]], ids=" ".join
)
def test_bad_arguments_exit_with_2(small_room, arguments):
    result = called("run", small_room, *arguments)
    assert result.exit_code == 2 and arguments[0] in result.stderr


def test_results_folder_that_is_a_file_is_found_before_anything_runs(small_room, tmp_path):
    (tmp_path / "taken").write_text("")
    result = called("run", small_room, "--results", tmp_path / "taken" / "below")
    assert result.exit_code == 2 and "is not a folder" in result.stderr


def test_results_folder_may_be_made(tmp_path):
    check_writable(tmp_path / "a" / "b")
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("a" * 300, "File name too long"),
        (f"there/{'a' * 300}/b", "File name too long"),
        ("dangling", "dangling is a link that leads nowhere"),
        ("dangling/below", "dangling is a link that leads nowhere"),
        ("loop", "loop is a link that leads nowhere"),
        ("gone/../there", "gone is not there"),
    ],
)
def test_results_folder_that_can_not_be_made_is_said_before_anything_is_run(
    small_room, tmp_path, monkeypatch, name, why
):
    def behave(observer):
        raise AssertionError("it was run")

    running(monkeypatch, behave)
    monkeypatch.chdir(tmp_path)
    Path("dangling").symlink_to("nowhere")
    Path("loop").symlink_to("loop")
    result = called("run", small_room, "--results", name)
    assert (result.exit_code, len(result.stderr.splitlines())) == (2, 1)
    assert result.stderr.startswith(f"--results {name}: ") and f"{why}; name a folder" in result.stderr


def test_with_json_standard_output_is_the_summary_and_nothing_else(small_room, monkeypatch):
    def behave(observer):
        observer.update(Progress("starting Prefect", runs_total=4, runs_done=2))
        return SimpleNamespace(summary=SUMMARY, directory=Path("results/x"), faults=(), notes=())

    running(monkeypatch, behave)
    result = called("run", small_room, "--json")
    assert result.exit_code == 0
    assert result.stdout == SUMMARY.json_text() + "\n"
    assert "2/4 runs" in result.stderr


def test_what_was_not_executed_is_said_after_the_run(small_room, monkeypatch):
    notes = ("room.vast:9:3: execution.image: not executed by this version",)
    found = SimpleNamespace(summary=SUMMARY, directory=Path("results/x"), faults=(), notes=notes)
    running(monkeypatch, lambda observer: found)
    assert called("run", small_room, "--json").stderr == notes[0] + "\n"


def test_store_that_cannot_be_used_exits_with_2(small_room, tmp_path):
    (tmp_path / "taken").write_text("")
    result = called("run", small_room, "--results", tmp_path / "results", "--store", tmp_path / "taken")
    assert result.exit_code == 2 and str(tmp_path / "taken") in result.stderr and "Traceback" not in result.stderr
    assert not (tmp_path / "results").exists()


def test_our_own_faults_exit_with_3(small_room, monkeypatch):
    found = SimpleNamespace(summary=SUMMARY, directory=Path("results/x"), faults=("broken",), notes=())
    running(monkeypatch, lambda observer: found)
    assert called("run", small_room, "--json").exit_code == 3


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupt_exits_with_130_and_says_how_to_go_on(small_room, monkeypatch, number):
    def behave(observer):
        os.kill(os.getpid(), number)
        raise AssertionError("the interrupt should have come before this")

    running(monkeypatch, behave)
    monkeypatch.setattr(sys, "argv", ["/usr/bin/vastflow", "run", "my room.vast"])
    before = signal.getsignal(number)
    result = called("run", small_room)
    assert result.exit_code == 130
    assert result.stderr == "interrupted; `vastflow run 'my room.vast'` again computes only what is missing\n"
    assert signal.getsignal(number) is before


def test_show_says_what_is_wrong_with_a_folder_that_is_no_campaign_directory(tmp_path):
    result = called("show", tmp_path)
    assert result.exit_code == 2 and "has no metadata.json" in result.stderr
    result = called("show", tmp_path / "nowhere")
    assert result.exit_code == 2 and "no such folder" in result.stderr


def test_show_points_from_the_folder_of_all_results_to_the_newest(tmp_path):
    for name in ("old", "new", ".hidden.partial"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metadata.json").write_text("{}")
    os.utime(tmp_path / "old" / "metadata.json", (0, 0))
    result = called("show", tmp_path)
    assert result.exit_code == 2
    assert f"holds 2 campaign directories; name one of them, the newest is {tmp_path / 'new'}" in result.stderr


def test_show_says_when_a_campaign_directory_is_damaged(tmp_path):
    (tmp_path / "metadata.json").write_text("{}")
    result = called("show", tmp_path)
    assert result.exit_code == 2 and "damaged campaign directory" in result.stderr


def test_entry_module_imports_nothing_heavy():
    program = (
        "import sys, vastflow.flows.__main__\n"
        "heavy = {'prefect', 'numba', 'matplotlib', 'pandas', 'pyarrow', 'numpy', 'scipy'} & set(sys.modules)\n"
        "print(*heavy)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=240, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "\n", "")
