"""A search on a schedule that is canceled, with a real API and a real worker.

`VASTFLOW_DEPLOYMENTS=all` runs them: the schedule has a flow run each minute.
"""

import json
import os
import subprocess
import sys

import pyarrow.parquet as pq
import pytest
from asleep import END_S, SLEEP_X, SLEEPING_SEARCH, wait_until
from command_line import called
from prefect.states import Cancelling

pytestmark = [
    pytest.mark.timeout(580),
    pytest.mark.skipif(os.environ.get("VASTFLOW_DEPLOYMENTS") != "all", reason="VASTFLOW_DEPLOYMENTS=all runs it"),
]

PLAN = "import asyncio\nfrom prefect.server.services.scheduler import schedule_deployments as s\nasyncio.run(s())"
"""Work that Prefect's own scheduler does every minute."""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the search; Prefect's home and the store are beside it."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "sleep.osc").write_text(SLEEP_X)
    (folder / "asleep.vast").write_text(SLEEPING_SEARCH)
    return folder


@pytest.fixture(scope="module")
def nights(api, place, started_worker):
    """Flow runs of the schedule: one canceled in its second batch, and the next, which completed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        options = ("--pool", "lab", "--workers", "1", "--store", str(place / "store"), "--schedule", "* * * * *")
        deployed = called("deploy", "asleep.vast", *options)
    assert deployed.exit_code == 0, deployed.output
    environment = {**os.environ, "PREFECT_HOME": str(place / "prefect")}
    subprocess.run([sys.executable, "-c", PLAN], env=environment, timeout=END_S, check=True)
    with started_worker(api, place / "worker", limit=1):
        wait_until(lambda: any("batch 2" in each.name for each in batches(api)))
        (canceled,) = of_schedule(api, "RUNNING")
        api.set_flow_run_state(canceled.id, Cancelling())
        wait_until(lambda: of_schedule(api, "CANCELLED"))
        wait_until(lambda: of_schedule(api, "COMPLETED"))
        yield of_schedule(api, "CANCELLED")[0], of_schedule(api, "COMPLETED")[0]


def of_schedule(api, state):
    deployment = api.read_deployment_by_name("campaign/asleep")
    found = (each for each in api.read_flow_runs() if each.deployment_id == deployment.id and each.auto_scheduled)
    return [each for each in found if each.state.type.value == state]


def batches(api):
    return [each for each in api.read_flow_runs() if each.name.startswith("asleep, batch")]


def test_next_scheduled_flow_run_resumes_canceled_search(nights, place):
    canceled, completed = nights
    assert (canceled.state.name, completed.state.name) == ("Cancelled", "Completed")
    directory = min((place / "results").glob("asleep-*"))
    found = json.loads((directory / "metadata.json").read_text())
    assert found["search"]["ended_by"] == "batches 2 of 2"
    assert len(pq.read_table(directory / "evaluations.parquet")) == 8
    assert 4 <= 8 - found["counts"]["executed"] < 8
    assert completed.state.message.endswith("from the store")


def test_canceled_search_leaves_no_batch_open(nights, api):
    _, completed = nights
    of_both = [each for each in batches(api) if each.start_time and each.start_time <= completed.end_time]
    assert {each.name for each in of_both} == {
        "asleep, batch 1, point-0001 to point-0004",
        "asleep, batch 2, point-0005 to point-0008",
    }
    assert [each.name for each in of_both if not each.state.is_final()] == []


def test_task_runs_of_a_canceled_batch_end_as_cancelled_and_log_no_error(nights, api):
    canceled, _ = nights
    ended = [each for each in batches(api) if each.start_time <= canceled.end_time]
    identities = {"any_": [str(each.id) for each in ended]}
    states = api.request("POST", "/task_runs/filter", json={"flow_runs": {"id": identities}}).json()
    assert {each["state_name"] for each in states} == {"Completed", "Cancelled"}
    logs = api.request("POST", "/logs/filter", json={"logs": {"flow_run_id": identities, "level": {"ge_": 40}}}).json()
    assert [each["message"] for each in logs] == []
