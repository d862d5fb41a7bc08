"""`deployments/prefect.yaml` at a real API: deployed as the page says, and run by a worker that starts elsewhere."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from vastflow.flows.cli.deploy import IMAGE_FOLDER

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "schedule-a-campaign.md").read_text()
COMMAND_S = 300


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("lab")


@pytest.fixture(scope="module")
def command(api, place):
    """Call a command with the API configured, and give its output."""

    def called(*words, folder):
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        own = {"PATH": path, "PREFECT_API_URL": str(api.api_url), "PREFECT_HOME": str(place / "home")}
        done = subprocess.run(
            words, cwd=folder, env=os.environ | own, capture_output=True, text=True, timeout=COMMAND_S, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return called


@pytest.fixture(scope="module")
def deployed(api, command):
    """The deployments by their names, made by the commands of the page in the checkout."""
    (script,) = re.findall(r"```sh\n(cd deployments .*?)```", PAGE, re.DOTALL)
    command("sh", "-e", "-c", script, folder=ROOT)
    return {each.name: each for each in map(api.read_deployment_by_name, _names())}


def _names():
    return [f"campaign/quickstart-{pool}" for pool in ("lab", "docker", "cluster")]


def test_deployments_of_file_name_folder_of_campaign(api, deployed):
    folders = {}
    for name, each in deployed.items():
        (step,) = each.pull_steps
        folders[name] = step["prefect.deployments.steps.set_working_directory"]["directory"]
    own = folders.pop("quickstart-lab")
    assert Path(own).is_absolute() and Path(own).resolve() == ROOT
    assert set(folders.values()) == {IMAGE_FOLDER}
    pools = {each.work_pool_name: api.read_work_pool(each.work_pool_name).type for each in deployed.values()}
    assert pools == {"lab": "process", "docker": "docker", "cluster": "kubernetes"}


def test_worker_that_starts_elsewhere_finds_the_campaign(api, deployed, command, place):
    deployment = deployed["quickstart-lab"]
    places = {"results": str(place / "results"), "store": str(place / "store")}
    request = {**deployment.parameters["request"], **places, "runs": 1, "only": ["clutter-1-1"]}
    asked = api.create_flow_run_from_deployment(deployment.id, parameters={"request": request})
    command("prefect", "worker", "start", "--pool", "lab", "--limit", "1", "--run-once", folder=place)
    state = api.read_flow_run(asked.id).state
    assert state.name == "Completed", state.message
    assert [*(place / "results").glob("quickstart-*/report.html")]
