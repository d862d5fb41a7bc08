"""The command line: what it prints where, its exit codes, and what it refuses."""

import errno
import json
import os
import pickle
import signal
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import typer
from command_line import called, options_of, options_on, refused
from room import edited
from table import each_row

from vastflow.flows import api
from vastflow.flows.results.summary import Summary
from vastflow.flows.terminal.ending import Interruptible
from vastflow.flows.terminal.options import with_stages
from vastflow.oracles.statistics.intervals import Counts
from vastflow.tasks.engine.progress import Progress
from vastflow.tasks.store.store import StoreError

SUMMARY = Summary(2, 0, 0, 4, 4, 0, 4, 0, 0, 40.0, 3.0, 2.0, "results/x", {"success": Counts(4, 0, 0)})
ROOM = "campaign/room.vast"


def finished(**parts):
    return SimpleNamespace(**{"summary": SUMMARY, "directory": Path("results/x"), "faults": (), "notes": (), **parts})


@pytest.fixture
def running(monkeypatch):
    def running(behave):
        monkeypatch.setattr(api, "run_campaign", lambda path, *, observer, **options: behave(observer))

    return running


@pytest.fixture
def here(small_room, tmp_path, monkeypatch):
    """The working directory, with a campaign among other files and folders."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VASTFLOW_STORE", "store")
    for name in ("damaged", "results/old", "results/new", "results/.hidden.partial"):
        Path(name).mkdir(parents=True)
        Path(name, "metadata.json").write_text("{}")
    os.utime("results/old/metadata.json", (0, 0))
    Path("taken").write_text("")
    Path("empty").mkdir()
    Path("dangling").symlink_to("nowhere")
    Path("loop").symlink_to("loop")
    return tmp_path


def test_commands_refuse_wrong_arguments_with_one_line_and_write_nothing(here, golden):
    before = sorted(here.rglob("*"))

    def faults_of(arguments):
        line = refused(*arguments.replace("AAA", "a" * 300).split()).replace("a" * 300, "AAA")
        assert sorted(here.rglob("*")) == before
        return [line.replace(str(here), "HERE")]

    golden("command_line", "arguments", faults_of)


MISSING_MAP = ("room.yaml", "cellar.yaml")


def test_bad_file_exits_with_2_and_writes_nothing(here):
    edited(here, (ROOM, *MISSING_MAP))
    before = sorted(here.rglob("*"))
    for command in ("validate", "run"):
        file, line, column, rest = refused(command, ROOM).split(":", 3)
        assert (file, line.isdigit(), column.isdigit()) == (ROOM, True, True)
        assert "cellar.yaml" in rest
    assert sorted(here.rglob("*")) == before


def test_validate_counts_parts_and_names_unexecuted_keys(small_room):
    ok = "OK: 1 family, 1 producer, 1 oracle\n"
    result = called("validate", small_room)
    assert (result.exit_code, result.stdout) == (0, ok)
    edited(small_room.parent, ("room.vast", "  runs: 2", "  runs: 2\n  image: some/image"))
    result = called("validate", small_room)
    note, _, rest = result.stdout.partition("\n")
    assert (result.exit_code, rest) == (0, ok)
    assert "execution.image" in note and "Not executed by this version" in note


def test_search_with_unknown_step_is_refused(tmp_path):
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
    assert "search" in refused("run", file, "--results", tmp_path / "results")
    assert not (tmp_path / "results").exists()


def test_help_lists_commands_and_groups_then_those_of_entry_points():
    _, listed = called("--help").stdout.split("Commands:\n")
    assert [line.split()[0] for line in listed.splitlines() if line.strip()] == [
        *("init", "validate", "plan", "run", "show", "replay", "compare", "benchmark", "minimize"),
        *("report-failure", "repeat-failure", "export", "notebook", "publish", "verify", "params", "deploy", "import"),
        *("calibrate", "store", "floorplan", "scenario", "mcp", "ui"),
    ]


@each_row(
    ("command", "page"),
    [
        ("compare", "compare-campaigns.md"),
        ("export", "export-results.md"),
        ("replay", "replay-a-run.md"),
        ("report-failure", "report-a-failure.md"),
    ],
)
def test_page_of_command_describes_every_option(command, page):
    assert options_on(page) == options_of(command)


def test_schema_knows_sections():
    result = called("validate", "--schema")
    assert {"configuration", "execution", "evaluation"} <= set(json.loads(result.stdout)["properties"])


def test_run_prints_summary_on_stdout_and_progress_and_notes_on_stderr(small_room, running):
    note = "room.vast:9:3: execution.image: not executed by this version"

    def behave(observer):
        observer.update(Progress("starting Prefect", runs_total=4, runs_done=2))
        return finished(notes=(note,))

    running(behave)
    result = called("run", small_room, "--json")
    assert (result.exit_code, result.stdout) == (0, SUMMARY.json_text() + "\n")
    progress, last = result.stderr.splitlines()
    assert "2/4 runs" in progress and last == note


def test_run_with_faults_exits_with_3(small_room, running):
    running(lambda observer: finished(faults=("broken",)))
    assert called("run", small_room, "--json").exit_code == 3


@each_row("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_run_exits_with_130_and_prints_resume_command(small_room, running, monkeypatch, number):
    def behave(observer):
        os.kill(os.getpid(), number)
        raise AssertionError("the interrupt should have come before this")

    running(behave)
    monkeypatch.setattr(sys, "argv", ["/usr/bin/vastflow", "run", "my room.vast", "--runs", "5"])
    before = signal.getsignal(number)
    result = called("run", small_room)
    assert result.exit_code == 130
    assert result.stderr == "Interrupted. `vastflow run 'my room.vast' --runs 5` again computes only what is missing.\n"
    assert signal.getsignal(number) is before


@each_row(
    ("arguments", "words"),
    [
        (["run", "--force"], ["run", "--force", "all"]),
        (["run", "--force", "--json", "a.vast"], ["run", "--force", "all", "--json", "a.vast"]),
        (["run", "--force", "a.vast"], ["run", "--force", "all", "a.vast"]),
        (["run", "--force", "judge", "a.vast"], ["run", "--force", "judge", "a.vast"]),
        (["run", "--force", "jugde", "a.vast"], ["run", "--force", "jugde", "a.vast"]),  # refused with the stages
    ],
)
def test_force_without_a_stage_means_all(arguments, words):
    assert with_stages(arguments) == words


def test_interrupted_forced_run_is_resumed_without_force(small_room, running, monkeypatch):
    def behave(observer):
        os.kill(os.getpid(), signal.SIGINT)

    running(behave)
    monkeypatch.setattr(sys, "argv", ["/usr/bin/vastflow", "run", "room.vast", "--force"])
    assert (
        "`vastflow run room.vast --force` without --force again computes only"
        in called("run", small_room, "--force").stderr
    )


def test_interruptible_treats_interrupted_import_as_interrupt(capsys):
    with pytest.raises(typer.Exit) as ended, Interruptible("bye"):
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            raise SystemError("an extension module was interrupted half-way") from None
    assert (ended.value.exit_code, capsys.readouterr().err) == (130, "bye\n")
    with pytest.raises(ValueError, match="mine"), Interruptible("bye"):
        raise ValueError("mine")


def test_store_error_of_worker_keeps_its_number():
    come = pickle.loads(pickle.dumps(StoreError(errno.ENOSPC, "no space")))
    assert (type(come), come.errno) == (StoreError, errno.ENOSPC)
