"""A deployment from end to end: a real API, a real worker, and pages of Prefect.

One flow run in the ordinary course of the tests. `VASTFLOW_DEPLOYMENTS=all` adds those of a second night and of a broken file.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import called, refused
from room import SHORT_DRIVES, drawn_room

from vastflow.flows import run_campaign
from vastflow.flows.request.run_request import RunRequest
from vastflow.sim.model.digest import file_digest

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
more = pytest.mark.skipif(os.environ.get("VASTFLOW_DEPLOYMENTS") != "all", reason="VASTFLOW_DEPLOYMENTS=all runs it")

WORKER_S = 420
DEPLOYMENT = "campaign/tiny"
CAMPAIGN = SHORT_DRIVES.replace("NAME", "tiny")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the campaign; Prefect's home and the store are beside it."""
    folder = tmp_path_factory.mktemp("lab")
    drawn_room(folder, 60)
    (folder / "tiny.vast").write_text(CAMPAIGN)
    return folder


@pytest.fixture(scope="module")
def deployed(api, place):
    """The result of the command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        options = ("--pool", "lab", "--workers", "2", "--store", str(place / "store"), "--schedule", "0 2 * * *")
        return called("deploy", "tiny.vast", *options)


@pytest.fixture(scope="module")
def work(api, place, deployed):
    """Asks for a flow run with these parameters, lets a worker take it, and gives it as it is afterwards."""
    assert deployed.exit_code == 0, deployed.output
    environment = {**os.environ, "PREFECT_API_URL": str(api.api_url), "PREFECT_HOME": str(place / "worker")}

    def done(**fields):
        deployment = api.read_deployment_by_name(DEPLOYMENT)
        parameters = {"request": {**deployment.parameters["request"], **fields}}
        asked = api.create_flow_run_from_deployment(deployment.id, parameters=parameters)
        worker = (sys.executable, "-m", "prefect", "worker", "start", "--pool", "lab", "--limit", "1", "--run-once")
        subprocess.run(
            worker, check=True, timeout=WORKER_S, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        return api.read_flow_run(asked.id)

    return done


@pytest.fixture(scope="module")
def first(work):
    """The first flow run of the deployment."""
    return work()


def artifacts(api, flow_run):
    found = api.request("POST", "/artifacts/filter", json={"artifacts": {"flow_run_id": {"any_": [str(flow_run.id)]}}})
    return {each["key"]: each for each in found.json() if each["key"]}  # without the result's


def logged(api, flow_run):
    asked = {"logs": {"flow_run_id": {"any_": [str(flow_run.id)]}}, "sort": "TIMESTAMP_ASC"}
    return [each["message"] for each in api.request("POST", "/logs/filter", json=asked).json()]


def test_deploy_creates_pool_and_deployment_and_prints_next_step(api, deployed):
    assert deployed.exit_code == 0, deployed.output
    made, address, again = deployed.stdout.splitlines()
    assert made == "made the work pool lab, now start a worker: prefect worker start --pool lab"
    assert address.startswith(f"{DEPLOYMENT}: http://127.0.0.1:")
    assert again == f"run it: prefect deployment run '{DEPLOYMENT}'"
    assert api.read_work_pool("lab").type == "process"


def test_deployment_has_a_schedule_a_limit_and_parameters_that_a_form_can_show(api, place, deployed):
    deployment = api.read_deployment_by_name(DEPLOYMENT)
    assert deployment.schedules[0].schedule.cron == "0 2 * * *"
    assert (deployment.global_concurrency_limit.limit, deployment.tags) == (1, ["vastflow", "tiny"])
    assert deployment.concurrency_options.collision_strategy.value == "ENQUEUE"
    assert deployment.version == file_digest(place / "tiny.vast")[:12]
    schema = deployment.parameter_openapi_schema
    assert schema["required"] == ["request"]
    properties = schema["definitions"]["RunRequest"]["properties"]
    assert set(properties) == set(RunRequest.model_fields)
    assert all("description" in about for about in properties.values())
    assert deployment.enforce_parameter_schema


def test_result_of_flow_run_is_summary_with_directory(first, place):
    summary = first.state.result()
    assert (Path(summary["results"]) / "metadata.json").is_file()
    assert (summary["configurations"], summary["executed"]) == (2, 4)


def test_schedule_makes_flow_runs(api, place, deployed):
    # What Prefect's own scheduler does every minute, which it can't with every release of SQLAlchemy.
    code = "import asyncio\nfrom prefect.server.services.scheduler import schedule_deployments as s\nasyncio.run(s())"
    environment = {**os.environ, "PREFECT_HOME": str(place / "prefect")}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, timeout=WORKER_S, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    deployment = api.read_deployment_by_name(DEPLOYMENT)
    asked = {"deployments": {"id": {"any_": [str(deployment.id)]}}, "limit": 50}
    planned = [run for run in api.request("POST", "/flow_runs/filter", json=asked).json() if run["auto_scheduled"]]
    assert len(planned) >= 3
    assert all(run["expected_start_time"][11:16] == "02:00" for run in planned)


def test_deploying_again_changes_the_same_deployment(api, place, deployed, monkeypatch):
    monkeypatch.chdir(place)
    before = api.read_deployment_by_name(DEPLOYMENT)
    result = called("deploy", "tiny.vast", "--pool", "lab", "--name", "tiny", "--runs", 9)
    after = api.read_deployment_by_name(DEPLOYMENT)
    assert (result.exit_code, after.id, after.parameters["request"]["runs"]) == (0, before.id, 9)
    assert (result.stdout.splitlines()[0].split()[0], after.schedules) == ("found", [])
    options = ("--workers", "2", "--store", str(place / "store"))
    assert called("deploy", "tiny.vast", "--pool", "lab", *options).exit_code == 0


def test_pool_of_other_type_is_refused(api, place, deployed, monkeypatch):
    monkeypatch.chdir(place)
    said = refused("deploy", "tiny.vast", "--pool", "lab", "--type", "docker")
    assert said == "--pool: Expected a work pool of type 'docker', got 'lab' of type 'process'. Give --type process."


def test_contradictory_parameters_are_refused_before_running(api, deployed):
    deployment = api.read_deployment_by_name(DEPLOYMENT)
    with pytest.raises(Exception, match="0 is less than the minimum of 1"):
        api.create_flow_run_from_deployment(deployment.id, parameters={"request": {"campaign": "tiny.vast", "runs": 0}})


def test_worker_runs_campaign_in_one_flow_run_with_log_and_artifacts(api, place, first):
    assert first.state.name == "Completed", first.state.message
    assert first.name == "tiny, 2 configurations × 2 runs"
    assert (
        first.state.message.startswith("100 % passed; ")
        and "2 configurations × 2 runs: 4 passed" in first.state.message
    )
    assert first.state.message.endswith("; 4 runs executed, 0 from the store")
    (directory,) = (place / "results").glob("tiny-*")
    report = directory / "report.html"
    assert report.is_file()
    assert json.loads((directory / "metadata.json").read_text())["counts"]["executed"] == 4
    found = artifacts(api, first)
    assert {key: each["type"] for key, each in found.items()} == {
        "tiny-progress": "progress",
        "tiny-results": "table",
        "tiny-why": "table",
        "tiny-report": "markdown",
    }
    assert found["tiny-progress"]["data"] == 100
    (row,) = json.loads(found["tiny-results"]["data"])
    assert (row["family"], row["configurations"], row["runs"]) == ("room", 2, 4)
    assert found["tiny-report"]["data"] == f"[report.html]({report.as_uri()})"
    lines = logged(api, first)
    assert len(lines) < 20
    own = [line for line in lines if line.startswith(("2 configurations", "executing", "writing", "100 %"))]
    assert own[0] == "2 configurations × 2 runs; 0 runs are in the store"
    assert own[-1].startswith("100 % passed; ") and "report: " in own[-1]


def test_stages_are_task_runs_of_one_flow_run(api, first):
    assert [run.id for run in api.read_flow_runs() if run.state.name == "Completed"] == [first.id]
    assert {"vastflow", "tiny"} <= set(first.tags)
    asked = {"flow_runs": {"id": {"any_": [str(first.id)]}}}
    names = [each["name"] for each in api.request("POST", "/task_runs/filter", json=asked).json()]
    stages = {f"{stage} {k} of room" for stage in ("execute", "observe", "judge") for k in (1, 2)}
    assert sorted(names) == sorted(stages | {"instantiate room by ParameterVariationList"})


def test_manual_run_has_own_flow_run_page(api, place, first):
    def run():
        return run_campaign(place / "tiny.vast", runs=4, results=place / "by-hand", store=place / "store", workers=2)

    result = run()
    (shown,) = (each for each in api.read_flow_runs() if each.name == "tiny, 2 configurations × 4 runs")
    assert shown.parent_task_run_id is None
    assert {"vastflow", "tiny"} <= set(shown.tags)
    found = artifacts(api, shown)
    assert set(found) == {"tiny-progress", "tiny-results", "tiny-why", "tiny-report"}
    assert found["tiny-progress"]["data"] == 100
    assert (result.directory / "report.html").resolve().as_uri() in found["tiny-report"]["data"]
    run()  # nothing is left to do
    assert sum(each.name == shown.name for each in api.read_flow_runs()) == 1


@more
def test_invalid_campaign_file_fails_flow_run_with_place(place, first, work):
    Path(place, "broken.vast").write_text(CAMPAIGN.replace("runs: 2", "runs: none"))
    broken = work(campaign=str(place / "broken.vast"))
    assert broken.state.name == "Failed"
    assert "broken.vast:13:19" in broken.state.message
