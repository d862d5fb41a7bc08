"""`vastflow deploy` without Prefect's API: what it prints and says of wrong options and lost APIs."""

import re
import shlex
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
import yaml
from command_line import called, refused
from prefect.cli.deploy._models import DeploymentConfig
from prefect.settings import temporary_settings

from vastflow.flows.campaign import campaign as campaign_flow
from vastflow.flows.cli import deploy as deploy_command
from vastflow.flows.cli.deploy import NO_API
from vastflow.sim.model.digest import file_digest
from vastflow.tasks.prefect import retry
from vastflow.tasks.prefect.deployment import PoolType
from vastflow.tasks.prefect.registration import pool_template

CLUSTER = ("--pool", "cluster", "--type", "kubernetes", "--image", "ghcr.io/me/vastflow:7", "--queue", "nightly")


@pytest.fixture
def file(campaign_file, tmp_path, monkeypatch):
    """A campaign file in the working directory with resources and nothing of containers."""
    monkeypatch.chdir(tmp_path)
    campaign_file("  runs: 7\n  resources: {cpu: 3, memory: 6Gi}\n")
    return Path("rooms.vast")


def printed(*arguments):
    result = called("deploy", *arguments, "--dry-run")
    assert result.exit_code == 0, result.output
    written, pool = yaml.safe_load_all(result.stdout)
    (deployment,) = written["deployments"]
    return DeploymentConfig.model_validate(deployment), pool


def test_dry_run_prints_deployment_and_pool(file, tmp_path):
    schedule = ("--schedule", "0 2 * * *", "--timezone", "Asia/Tokyo")
    request = {"runs": 2, "only": "rooms", "workers": 1, "store": "s3://bucket", "reports": "https://lab.example"}
    request["cluster"] = "tcp://scheduler:8786"
    options = (word for name, value in request.items() for word in (f"--{name}", value))
    deployment, pool = printed(file, "--pool", "lab", *schedule, *options)
    assert (deployment.name, deployment.work_pool.name, pool["type"]) == ("Two_rooms", "lab", "process")
    assert deployment.tags == ["vastflow", "two-rooms"]
    assert (deployment.schedules[0].cron, deployment.schedules[0].timezone) == ("0 2 * * *", "Asia/Tokyo")
    places = {"campaign": str(tmp_path / "rooms.vast"), "results": str(tmp_path / "results")}
    assert deployment.parameters["request"] == {**request, **places, "only": ["rooms"]}
    campaign_flow.validate_parameters(deployment.parameters)
    assert "Workers of the Dask cluster at `tcp://scheduler:8786` compute the runs." in deployment.description
    deployment, _ = printed(file, "--pool", "lab")
    assert deployment.schedules == [] and "7 runs of each configuration" in deployment.description


def test_deployment_has_a_version_that_changes_with_its_campaign_file(file):
    versions = {}
    for runs in (7, 8, 7):
        file.write_text(re.sub("runs: [78]", f"runs: {runs}", file.read_text()))
        deployment, _ = printed(file, "--pool", "lab")
        versions.setdefault(runs, set()).add(deployment.version)
    assert versions[7] != versions[8] and versions[7] == {file_digest(file)[:12]}


def test_description_of_campaign_with_stopping_rule_has_least_and_most_runs(campaign_file):
    file = campaign_file("  runs: {min: 5, max: 20, stop: {systematic: 0.5, reliable: 0.9}}\n")
    for options, said in (
        ((), "5 to 20 runs of each configuration, which ends when its class is decided, and writes its report"),
        (("--runs", 1), "1 run of each configuration, and writes its report"),
    ):
        deployment, _ = printed(file, "--pool", "lab", *options)
        assert said in deployment.description


def test_deployment_to_cluster_has_resources_of_file_and_paths_of_image(file):
    deployment, pool = printed(file, *CLUSTER)
    own = {"image": "ghcr.io/me/vastflow:7", "queue": "nightly"}
    assert deployment.work_pool.job_variables == {**own, "cpu": "3", "memory": "6Gi"}
    request = {"campaign": "rooms.vast", "results": "/data/results", "workers": 3}
    assert deployment.parameters["request"] == request
    assert pool["base_job_template"] == pool_template(PoolType.kubernetes)


def test_deploy_refuses_wrong_options_and_files(campaign_file, golden, tmp_path):
    def faults_of(case):
        options, execution = case.split("\n", 1)
        said = refused("deploy", campaign_file(execution), *shlex.split(options), "--dry-run")
        return [said.replace(str(tmp_path), "HERE")]

    golden("execution", "deploy", faults_of)


def test_deploy_refuses_file_outside_of_image(file, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    said = refused("deploy", tmp_path / file, "--pool", "cluster", "--type", "kubernetes", "--dry-run")
    assert "Call this from the folder that the image is built from" in said


def test_deploy_prints_remedy_without_api(file, monkeypatch):
    with temporary_settings({"api.url": "http://127.0.0.1:9/api", "client.max_retries": 0}):
        result = called("deploy", file, "--pool", "lab")
    assert (result.exit_code, result.stdout) == (3, "")
    assert result.stderr.startswith("Prefect's API at http://127.0.0.1:9/api does not answer: ")
    monkeypatch.setattr("vastflow.tasks.prefect.server.configured_url", lambda: None)
    assert refused("deploy", file, "--pool", "lab") == NO_API


def test_deploy_is_cheap_to_import():
    assert not any(name.startswith("prefect") for name in vars(deploy_command))


@pytest.fixture
def busy_api(monkeypatch):
    """An API of Prefect that answers every request with 503."""

    class Busy(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(503)
            self.end_headers()

        do_POST = do_GET

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Busy) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        monkeypatch.setattr(retry, "IN_BETWEEN_S", 2.5)
        settings = {"api.url": f"http://127.0.0.1:{server.server_port}/api", "client.max_retries": 0}
        with temporary_settings(settings):
            yield
        server.shutdown()


def test_deploy_asks_busy_api_again(file, busy_api):
    result = called("deploy", file, "--pool", "lab")
    assert result.exit_code == 3
    assert "is busy, trying again for up to 2 s" in result.output
    assert "was busy for 2 s. Deploy again later" in result.output
    assert "503" not in result.output
