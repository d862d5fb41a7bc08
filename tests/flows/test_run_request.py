"""The request of a run: one model behind the command line, Python, deployments and schedules."""

import inspect
import json
import os
import shutil
import subprocess
import sys
from types import SimpleNamespace

import pytest
import yaml
from command_line import called, refused
from prefect.exceptions import ParameterTypeError
from table import each_row

from vastflow.flows import run_campaign
from vastflow.flows.campaign import campaign
from vastflow.flows.request.run_request import NAMES, RunRequest, request_of

CLUTTER = """
  - name: clutter
    parameters:
      - map_file: room.yaml
    variations:
      - PathVariationRandom: {path_length: 2.0, robot_diameter: 0.35, goal_poses: "@goal_pose"}
      - ObstacleVariation:
          obstacle_configs: [{amount: 1, max_distance: 3.0, args: "width:=9.0, length:=0.02"}]
execution:"""
"""A board of 9 m finds no room in a room of 4 m, unless it may stand in its walls."""


HEAVY = {"prefect", "numba", "matplotlib", "pandas", "pyarrow", "numpy", "scipy"}
PLAN = "from typer.testing import CliRunner; assert CliRunner().invoke(app, ['plan', 'room.vast']).exit_code == 0"
TABLE = "from pathlib import Path; write_table(Path('t.parquet'), RUNS, [{'run_index': 1}])"


@each_row(
    ("statement", "unwanted"),
    [
        ("import vastflow.flows", {"numba", "prefect"}),
        ("from vastflow.flows import run_campaign", {"prefect"}),
        ("import vastflow.tasks.engine.work, vastflow.tasks.engine.pool", {"numba", "prefect"}),
        ("import vastflow.flows.cli.__main__", HEAVY),
        (f"from vastflow.flows.cli.__main__ import app; {PLAN}", {"prefect"}),
        (f"from vastflow.oracles.results.schema import RUNS, write_table; {TABLE}", {"pandas"}),
    ],
)
def test_imports_load_nothing_heavy(small_room, statement, unwanted):
    script = f"{statement}; import sys; print(*{unwanted!r} & sys.modules.keys())"
    environment = {**os.environ, "VASTFLOW_STORE": "store"}
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=small_room.parent,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert (done.stdout, done.stderr) == ("\n", "")


def test_request_takes_name_client_or_scheduler_file_and_survives_json(tmp_path):
    file = tmp_path / "scheduler.json"
    file.write_text("{}")
    client = SimpleNamespace(scheduler=SimpleNamespace(address="tls://lab:1"))
    for cluster, address in ((client, "tls://lab:1"), (file, str(file)), ("local:3", "local:3")):
        request = request_of(tmp_path / "x.vast", {"runs": 3, "only": "hall", "cluster": cluster})
        assert RunRequest.model_validate_json(request.model_dump_json()) == request
        assert (request.only, request.cluster) == (("hall",), address)


def test_command_python_call_and_flow_take_the_fields_of_a_request():
    said = " ".join(called("run", "--help", COLUMNS="400").output.split())
    for name in NAMES:
        if name != "reports":
            assert f"--{name.replace('_', '-')} " in said and RunRequest.model_fields[name].description in said
    assert [*inspect.signature(run_campaign).parameters] == ["campaign", "observer", *NAMES]
    assert [*campaign.parameters.properties] == ["request"]
    with pytest.raises(ParameterTypeError, match=r"request\.runs_each: Extra inputs are not permitted"):
        campaign.validate_parameters({"request": {"campaign": "x.vast", "runs_each": 3}})


@each_row(
    ("options", "error", "words"),
    [
        ({"runs": 0}, ValueError, "^runs is at least 1, got 0$"),
        ({"pool": "lab"}, TypeError, "^expected an option of .*, got 'pool'$"),
        (
            {"cluster": "lab:8786"},
            ValueError,
            "^--cluster: expected tcp://HOST:PORT, .* got 'lab:8786', and no such file exists$",
        ),
        (
            {"cluster": "local:0"},
            ValueError,
            "^--cluster: expected .* or local:N, got 'local:0', and no such file exists$",
        ),
        ({"run": 2}, TypeError, r"expected an option of runs, results, store.*, got 'run'"),
    ],
)
def test_request_refuses_wrong_option(options, error, words):
    with pytest.raises(error, match=words):
        run_campaign("x.vast", **options)


def deployed(file, *options):
    """The parameters of the deployment that `deploy` would make."""
    result = called("deploy", file, "--pool", "p", "--dry-run", *options)
    (deployment,) = yaml.safe_load(result.stdout.split("---")[0])["deployments"]
    return deployment["parameters"]["request"]


@pytest.fixture
def apart(small_room, tmp_path, monkeypatch):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    maps = tmp_path / "maps" / "halls"
    maps.mkdir(parents=True)
    for name in ("room.yaml", "room.pgm"):
        shutil.move(small_room.with_name(name), maps / name)
    small_room.write_text(small_room.read_text().replace("room.yaml", "halls/room.yaml"))
    return small_room, maps.parent


def test_map_dir_holds_maps_missing_beside_the_file(apart, tmp_path):
    file, maps = apart
    assert called("validate", file, "--map-dir", maps).exit_code == 0
    assert "--map-dir" in refused("validate", file)
    options = ["--map-dir", maps, "--sample", 1, "--results", tmp_path]
    said = json.loads(called("plan", file, *options, "--json").stdout)
    assert (said["coverage"]["realized"], said["configurations"], said["sampled_from"]) == (2, 1, 2)
    assert said["stages"]["execute"] == {"reused": 0, "computed": 2}
    assert "a sample of 1 of 2 distinct configurations" in called("plan", file, *options).stdout
    request = deployed(file, "--map-dir", maps, "--sample", 3)
    assert (request["map_dir"], request["sample"]) == (str(maps), 3)


@each_row("command", ["run", "validate", "plan", "deploy --pool p"])
def test_map_dir_must_exist(command, apart):
    file, maps = apart
    name, *options = command.split()
    words = f"--map-dir: expected a folder of maps, got '{maps / 'none'}'"
    assert words in refused(name, file, "--map-dir", maps / "none", *options)


def test_public_request_has_no_credentials_in_its_addresses():
    asked = {"store": "s3://KEY:SE/CRET@bucket/store", "results": "sftp://me:pw@host/out?token=abc&y=1"}
    public = RunRequest(campaign="x.vast", cluster="tls://h:1", **asked).public()
    assert (public.store, public.results) == ("s3://bucket/store", "sftp://host/out?y=1")
    assert (public.campaign, public.cluster, public.reports) == ("x.vast", "tls://h:1", None)
