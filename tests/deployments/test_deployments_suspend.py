"""A campaign that is suspended and resumed on Prefect's pages, with a real API and a real worker."""

import time

import psutil
import pytest
from asleep import wait_until
from command_line import called
from prefect.states import Suspended

pytestmark = [pytest.mark.slow, pytest.mark.timeout(580)]

RUNS = 40
CAMPAIGN = f"""
version: 1
metadata: {{name: asleep}}
configuration: [{{name: nap}}]
execution: {{scenario_file: sleep.osc, runs: {RUNS}, timeout: 60}}
"""
SLEEP_OSC = """
import osc.helpers

scenario nap:
    do serial:
        run_process('sleep 1')
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    (folder / "sleep.osc").write_text(SLEEP_OSC)
    (folder / "asleep.vast").write_text(CAMPAIGN)
    return folder


def test_suspended_campaign_ends_at_once_and_goes_on_when_resumed(api, place, started_worker, monkeypatch):
    monkeypatch.chdir(place)
    deployed = called("deploy", "asleep.vast", "--pool", "lab", "--workers", "1", "--store", str(place / "store"))
    assert deployed.exit_code == 0, deployed.output
    asked = api.create_flow_run_from_deployment(api.read_deployment_by_name("campaign/asleep").id)

    def logged():
        filters = {"logs": {"flow_run_id": {"any_": [str(asked.id)]}}, "sort": "TIMESTAMP_ASC"}
        return [each["message"] for each in api.request("POST", "/logs/filter", json=filters).json()]

    with started_worker(api, place / "worker", limit=1) as worker:
        wait_until(lambda: list(place.glob("store/execute/**/manifest")))
        api.set_flow_run_state(asked.id, Suspended(timeout_seconds=600))
        wait_until(lambda: any(line.startswith("Finished in state Suspended") for line in logged()))
        assert api.read_flow_run(asked.id).state.name == "Suspended"
        # Prefect's worker breaks if it gets a flow run again before its process is gone.
        wait_until(lambda: not psutil.Process(worker.pid).children())
        time.sleep(2)
        api.resume_flow_run(asked.id)
        wait_until(lambda: api.read_flow_run(asked.id).state.name == "Completed")
    (before,) = (line for line in logged() if line.endswith("runs are in the store") and " 0 runs" not in line)
    reused = int(before.partition("; ")[2].split()[0])
    assert 1 <= reused < RUNS
    assert api.read_flow_run(asked.id).state.message.endswith(f"{RUNS - reused} runs executed, {reused} from the store")
