"""The command `init`, and what `vastflow` takes without a command."""

import json
import re
import webbrowser
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import pytest
from command_line import called, refused
from table import each_row

from vastflow.flows import api
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.oracles.statistics.classes import runs_for_a_claim
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file

QUICKSTART = Path(__file__).parents[2] / "campaigns" / "quickstart"
OFFICE = QUICKSTART / "maps" / "office.yaml"


def files_of(folder):
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@each_row("name", ["first", "a/folder with spaces"])
def test_init_writes_quickstart_and_names_command_that_runs_it(tmp_path, name):
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


def test_init_leaves_other_files_and_overwrites_none(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert called("init", tmp_path).exit_code == 0
    assert (tmp_path / "notes.txt").read_text() == "mine"
    (tmp_path / "quickstart.vast").unlink()
    (tmp_path / "maps" / "office.pgm").unlink()
    before = files_of(tmp_path)
    assert re.fullmatch(r"\S+/maps/office\.yaml: There already\. Name another folder\.", refused("init", tmp_path))
    assert files_of(tmp_path) == before


@pytest.mark.parametrize("params", [None, "robots/turtlebot4.yaml", "robots/rectangle.yaml", "nav2/rpp.yaml"])
def test_init_writes_random_paths_for_map_and_robot(tmp_path, params):
    options = () if params is None else ("--params", QUICKSTART.parent / params)
    assert called("init", tmp_path / "own", "--map", OFFICE, *options).exit_code == 0
    campaign, _ = read_campaign(tmp_path / "own" / "office.vast")
    made = instantiate(campaign)
    assert (len(made.configurations), made.rejections) == (10, ())
    stems = ["office"] if params is None else ["office", Path(params).stem]
    assert campaign.spec.metadata["name"] == "-".join(stems)
    assert campaign.spec.execution.runs == runs_for_a_claim()["reliable"]
    system = made.configurations[0].scenario.system
    assert system.get("nav2_params") == (None if params is None else nav2_file(QUICKSTART.parent / params))


@each_row(
    ("options", "said"),
    [
        (("--params", "own.yaml"), "--params: requires --map"),
        (("--map", "nowhere.yaml"), "nowhere.yaml: No such file"),
        (("--map", OFFICE, "--params", "nowhere.yaml"), "nowhere.yaml"),
        (
            ("--map", OFFICE, "--params", QUICKSTART.parent / "robots/forklift.yaml"),
            "expected paths of 1 m on which a robot 2.2 m across can turn, got none",
        ),
    ],
)
def test_init_refuses_unusable_inputs(tmp_path, options, said):
    assert said in refused("init", tmp_path / "own", *options)
    assert not (tmp_path / "own").exists()


@each_row("taken", ["first", "first/maps"])
def test_init_refuses_file_where_it_needs_folder(tmp_path, taken):
    (tmp_path / taken).parent.mkdir(exist_ok=True)
    (tmp_path / taken).write_text("mine")
    assert str(tmp_path / taken) in refused("init", tmp_path / "first")


def test_version_is_that_of_distribution():
    assert called("--version").stdout == f"vastflow {version('vastflow')}\n"


@each_row(("options", "ci", "opens"), [((), "", False), (("--open",), "", True), (("--open",), "true", False)])
def test_report_opens_only_with_option_and_never_in_ci(monkeypatch, tmp_path, options, ci, opens):
    report = tmp_path / "report.html"
    report.write_text("")
    summary = SimpleNamespace(json_text=lambda: json.dumps({}))
    found = SimpleNamespace(directory=tmp_path, summary=summary, notes=(), faults=())
    monkeypatch.setattr(api, "run_campaign", lambda path, **options: found)
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))  # where no earlier run is kept
    addresses = []
    monkeypatch.setattr(webbrowser, "open", lambda address: addresses.append(address) or True)
    assert called("run", QUICKSTART / "quickstart.vast", "--json", *options, CI=ci).exit_code == 0
    assert addresses == [report.as_uri()] * opens
