"""The command `init`, and what `vastflow` takes without a command."""

import json
import os
import re
import subprocess
import sys
import webbrowser
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import pytest
from table import each_row
from typer.testing import CliRunner

from vastflow.flows import api
from vastflow.flows.__main__ import app

QUICKSTART = Path(__file__).parents[2] / "campaigns" / "quickstart"


def called(*arguments, **environment):
    return CliRunner(env=environment).invoke(app, [str(argument) for argument in arguments])


def files_of(folder):
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@each_row("name", ["first", "a/folder with spaces"])
def test_the_quickstart_with_its_map_is_written_and_the_command_that_runs_it_is_named(tmp_path, name):
    done = called("init", tmp_path / name)
    assert done.exit_code == 0
    wanted = ("quickstart.vast", "maps/office.yaml", "maps/office.pgm")
    assert files_of(tmp_path / name) == {file: (QUICKSTART / file).read_bytes() for file in wanted}
    campaign = tmp_path / name / "quickstart.vast"
    quoted = f"'{campaign}'" if " " in name else str(campaign)
    assert done.stdout.splitlines()[-1] == f"vastflow run {quoted}"
    assert called("validate", campaign).exit_code == 0


def test_a_folder_with_other_files_is_taken_and_they_stay(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert called("init", tmp_path).exit_code == 0
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_file_that_is_there_is_not_written_over_and_nothing_else_is_written(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "office.yaml").write_text("mine")
    done = called("init", tmp_path)
    assert done.exit_code == 2
    assert re.fullmatch(r"\S+/maps/office\.yaml: there already; name another folder\n", done.stderr)
    assert files_of(tmp_path) == {"maps/office.yaml": b"mine"}


@each_row("taken", ["first", "first/maps"])
def test_a_file_where_a_folder_is_wanted_exits_with_2_and_one_sentence(tmp_path, taken):
    (tmp_path / taken).parent.mkdir(exist_ok=True)
    (tmp_path / taken).write_text("mine")
    done = called("init", tmp_path / "first")
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 1
    assert str(tmp_path / taken) in done.stderr


def test_the_version_is_that_of_the_distribution():
    assert called("--version").stdout == f"vastflow {version('vastflow')}\n"


@pytest.mark.timeout(300)
def test_a_shell_completes_commands_and_their_options():
    def completed(*words):
        asked = {
            "_VASTFLOW_COMPLETE": "complete_bash",
            "COMP_WORDS": " ".join(words),
            "COMP_CWORD": str(len(words) - 1),
        }
        command = Path(sys.executable).with_name("vastflow")
        done = subprocess.run([command], env={**os.environ, **asked}, capture_output=True, text=True, check=False)
        return set(done.stdout.split())

    assert completed("vastflow", "in") == {"init"}
    assert {"--open", "--only"} <= completed("vastflow", "run", "--o")


@pytest.fixture
def opened(monkeypatch, tmp_path):
    """The addresses that a run of a campaign with options opens; the campaign's report is there already."""
    (tmp_path / "report.html").write_text("")
    summary = SimpleNamespace(json_text=lambda: json.dumps({}))
    found = SimpleNamespace(directory=tmp_path, summary=summary, notes=(), faults=())
    monkeypatch.setattr(api, "run_campaign", lambda path, **options: found)
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))  # where no earlier run is kept
    addresses = []
    monkeypatch.setattr(webbrowser, "open", lambda address: addresses.append(address) or True)

    def run(*options, **environment):
        assert called("run", QUICKSTART / "quickstart.vast", "--json", *options, **environment).exit_code == 0
        return addresses

    return run


def test_the_report_is_opened_with_the_option(opened, tmp_path):
    assert opened("--open", CI="") == [(tmp_path / "report.html").as_uri()]


def test_the_report_is_not_opened_without_the_option(opened):
    assert opened(CI="") == []


def test_the_report_is_never_opened_in_ci(opened):
    assert opened("--open", CI="true") == []
