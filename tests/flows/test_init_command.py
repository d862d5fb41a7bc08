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
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file

QUICKSTART = Path(__file__).parents[2] / "campaigns" / "quickstart"


def called(*arguments, **environment):
    return CliRunner(env=environment).invoke(app, [str(argument) for argument in arguments])


def files_of(folder):
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@each_row("name", ["first", "a/folder with spaces"])
def test_quickstart_with_its_map_is_written_and_the_command_that_runs_it_is_named(tmp_path, name):
    done = called("init", tmp_path / name)
    assert done.exit_code == 0
    wanted = ("quickstart.vast", "maps/office.yaml", "maps/office.pgm")
    campaign = tmp_path / name / "quickstart.vast"
    quoted = f"'{campaign}'" if " " in name else str(campaign)
    shipped = {file: (QUICKSTART / file).read_bytes() for file in wanted}
    here = shipped[campaign.name].replace(b"campaigns/quickstart/quickstart.vast", quoted.encode())
    assert files_of(tmp_path / name) == {**shipped, campaign.name: here}
    assert b"campaigns/" not in here.replace(quoted.encode(), b"")
    assert done.stdout.splitlines()[-1] == f"vastflow run {quoted}"
    assert called("validate", campaign).exit_code == 0


def test_folder_with_other_files_is_taken_and_they_stay(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert called("init", tmp_path).exit_code == 0
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_file_that_is_there_is_not_written_over_and_nothing_else_is_written(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "office.yaml").write_text("mine")
    done = called("init", tmp_path)
    assert done.exit_code == 2
    assert re.fullmatch(r"\S+/maps/office\.yaml: there already; name another folder\n", done.stderr)
    assert files_of(tmp_path) == {"maps/office.yaml": b"mine"}


@pytest.mark.parametrize("params", [None, "robots/turtlebot4.yaml", "robots/rectangle.yaml", "nav2/rpp.yaml"])
def test_init_writes_random_paths_for_a_map_and_a_robot(tmp_path, params):
    office = QUICKSTART / "maps" / "office.yaml"
    options = () if params is None else ("--params", QUICKSTART.parent / params)
    assert called("init", tmp_path / "own", "--map", office, *options).exit_code == 0
    campaign, _ = read_campaign(tmp_path / "own" / "office.vast")
    made = instantiate(campaign)
    assert (len(made.configurations), made.rejections) == (10, ())
    system = made.configurations[0].scenario.system
    assert system.get("nav2_params") == (None if params is None else nav2_file(QUICKSTART.parent / params))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--params", "own.yaml"), "--params: requires --map"),
        (("--map", "nowhere.yaml"), "nowhere.yaml: no such file"),
        (("--map", QUICKSTART / "maps/office.yaml", "--params", "nowhere.yaml"), "nowhere.yaml"),
        (
            ("--map", QUICKSTART / "maps/office.yaml", "--params", QUICKSTART.parent / "robots/forklift.yaml"),
            "expected paths of 1 m on which a robot 2.2 m across can turn, got none",
        ),
    ],
)
def test_init_refuses_what_gives_no_campaign_with_one_line(tmp_path, options, said):
    done = called("init", tmp_path / "own", *options)
    assert (done.exit_code, len(done.stderr.splitlines())) == (2, 1)
    assert said in done.stderr
    assert not (tmp_path / "own").exists()


@each_row("taken", ["first", "first/maps"])
def test_file_where_a_folder_is_wanted_exits_with_2_and_one_sentence(tmp_path, taken):
    (tmp_path / taken).parent.mkdir(exist_ok=True)
    (tmp_path / taken).write_text("mine")
    done = called("init", tmp_path / "first")
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 1
    assert str(tmp_path / taken) in done.stderr


def test_version_is_that_of_the_distribution():
    assert called("--version").stdout == f"vastflow {version('vastflow')}\n"


@pytest.mark.timeout(300)
def test_shell_completes_commands_and_their_options():
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


def test_report_is_opened_with_the_option(opened, tmp_path):
    assert opened("--open", CI="") == [(tmp_path / "report.html").as_uri()]


def test_report_is_not_opened_without_the_option(opened):
    assert opened(CI="") == []


def test_report_is_never_opened_in_ci(opened):
    assert opened("--open", CI="true") == []
