"""`vastflow deploy` without Prefect's API: what a dry run prints, and what it says of a wrong option."""

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
import yaml
from prefect.cli.deploy._models import DeploymentConfig
from prefect.settings import temporary_settings
from typer.testing import CliRunner

from vastflow.flows.__main__ import app
from vastflow.flows.campaign import campaign as campaign_flow
from vastflow.flows.cli import deploy as deploy_command
from vastflow.flows.cli.deploy import NO_API
from vastflow.tasks.execution.job import PoolType, base_job_template
from vastflow.tasks.prefect import retry
from vastflow.tasks.prefect.adapter import flow_schema


def called(*arguments):
    return CliRunner().invoke(app, ["deploy", *map(str, arguments)])


@pytest.fixture
def file(campaign_file):
    """A campaign file with resources and nothing of containers."""
    return campaign_file("  runs: 7\n  resources: {cpu: 3, memory: 6Gi}\n")


def printed(result):
    assert result.exit_code == 0, result.output
    written, pool = yaml.safe_load_all(result.stdout)
    return DeploymentConfig.model_validate(written["deployments"][0]), pool


def test_dry_run_prints_the_deployment_and_its_pool(file):
    deployment, pool = printed(
        called(file, "--pool", "lab", "--schedule", "0 2 * * *", "--timezone", "Asia/Tokyo", "--dry-run")
    )
    assert (deployment.name, deployment.work_pool.name, pool["type"]) == ("Two_rooms", "lab", "process")
    assert deployment.tags == ["vastflow", "two-rooms"]
    assert (deployment.schedules[0].cron, deployment.schedules[0].timezone) == ("0 2 * * *", "Asia/Tokyo")
    assert "7 runs of each configuration" in deployment.description


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ((), "5 to 20 runs of each configuration, which ends when its class is decided, and writes its report"),
        (("--runs", 1), "1 run of each configuration, and writes its report"),
    ],
)
def test_of_a_campaign_that_stops_by_a_rule_the_description_says_the_least_and_the_most(campaign_file, options, said):
    file = campaign_file("  runs: {min: 5, max: 20, stop: {systematic: 0.5, reliable: 0.9}}\n")
    deployment, _ = printed(called(file, "--pool", "lab", *options, "--dry-run"))
    assert said in deployment.description


def test_parameters_are_those_of_the_flow_and_the_paths_are_absolute(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = (
        "--runs",
        2,
        "--only",
        "rooms",
        "--workers",
        1,
        "--store",
        "s3://bucket",
        "--reports",
        "https://lab.example",
    )
    deployment, _ = printed(called("rooms.vast", "--pool", "lab", *options, "--dry-run"))
    assert deployment.parameters["request"] == {
        "campaign": str(tmp_path / "rooms.vast"),
        "runs": 2,
        "only": ["rooms"],
        "results": str(tmp_path / "results"),
        "store": "s3://bucket",
        "workers": 1,
        "reports": "https://lab.example",
    }
    campaign_flow.validate_parameters(deployment.parameters)


def test_without_a_schedule_it_runs_on_request_only(file):
    deployment, _ = printed(called(file, "--pool", "lab", "--dry-run"))
    assert deployment.schedules == []


def test_cluster_gets_the_resources_of_the_file_and_paths_of_the_image(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = ("--type", "kubernetes", "--image", "ghcr.io/me/vastflow:7", "--queue", "nightly")
    deployment, pool = printed(called("rooms.vast", "--pool", "cluster", *options, "--dry-run"))
    assert deployment.work_pool.job_variables == {
        "image": "ghcr.io/me/vastflow:7",
        "queue": "nightly",
        "cpu": "3",
        "memory": "6Gi",
    }
    assert deployment.parameters["request"] == {"campaign": "rooms.vast", "results": "/data/results", "workers": 3}
    assert pool["base_job_template"] == base_job_template(PoolType.kubernetes)


def test_file_that_is_in_no_image_is_a_users_mistake(file, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    result = called(file, "--pool", "cluster", "--type", "kubernetes", "--dry-run")
    assert result.exit_code == 2
    assert "call this from the folder that the image is built from" in result.stderr


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--schedule", "0 2 * *"), "--schedule: expected five fields, got '0 2 * *'"),
        (("--schedule", "0 2 * * * *"), "--schedule: expected five fields, got '0 2 * * * *'"),
        (("--schedule", "every night"), "--schedule: expected five fields, got 'every night'"),
        (
            ("--schedule", "0 2 * * *", "--timezone", "Asia/Tokio"),
            "--timezone: found 'Asia/Tokio'; did you mean 'Asia/Tokyo'?",
        ),
    ],
)
def test_schedule_that_prefect_can_not_read_is_a_users_mistake(file, options, said):
    result = called(file, "--pool", "lab", *options, "--dry-run")
    assert result.exit_code == 2
    assert said in result.stderr


def test_fault_of_the_campaign_file_is_found_before_it_is_deployed(campaign_file):
    file = campaign_file("  runs: none\n")
    result = called(file, "--pool", "lab", "--dry-run")
    assert result.exit_code == 2
    assert f"{file}:10:9" in result.stderr


def test_sidecars_without_an_image_are_a_fault_of_the_file(campaign_file):
    result = called(campaign_file("  secondary_containers: [nav]\n"), "--pool", "lab", "--dry-run")
    assert result.exit_code == 2
    assert "no 'image'" in result.stderr


def test_without_an_api_nothing_is_deployed_and_what_to_do_is_said(file, monkeypatch):
    monkeypatch.setattr("vastflow.tasks.prefect.server.configured_url", lambda: None)
    result = called(file, "--pool", "lab")
    assert (result.exit_code, result.stderr) == (2, NO_API + "\n")


def test_api_that_does_not_answer_is_said(file, monkeypatch):
    from prefect.settings import temporary_settings

    with temporary_settings({"api.url": "http://127.0.0.1:9/api", "client.max_retries": 0}):
        result = called(file, "--pool", "lab")
    assert (result.exit_code, result.stdout) == (3, "")
    assert result.stderr.startswith("Prefect's API at http://127.0.0.1:9/api does not answer: ")


def test_command_is_cheap_to_import():
    assert not any(name.startswith("prefect") for name in vars(deploy_command))


def test_shards_go_to_a_pool_of_their_own_where_one_is_named(file):
    result = called(file, "--pool", "lab", "--shards-in", "farm", "--dry-run")
    assert result.exit_code == 0, result.output
    written, pool, farm = yaml.safe_load_all(result.stdout)
    campaign, shards = (DeploymentConfig.model_validate(each) for each in written["deployments"])
    assert campaign.parameters["request"]["pool"] == "farm"
    assert "Workers of the work pool **farm** compute the runs." in campaign.description
    assert (shards.name, shards.work_pool.name, shards.parameters) == ("farm-shards", "farm", {})
    assert (pool["name"], farm["name"]) == ("lab", "farm")


def test_shards_of_a_cluster_have_image_and_queue_whatever_the_campaign(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = ("--type", "kubernetes", "--image", "ghcr.io/me/vastflow:7", "--queue", "nightly", "--dry-run")
    result = called("rooms.vast", "--pool", "cluster", "--shards-in", "cluster", *options)
    written, _ = yaml.safe_load_all(result.stdout)
    variables = written["deployments"][1]["work_pool"]["job_variables"]
    assert variables == {"image": "ghcr.io/me/vastflow:7", "queue": "nightly"}


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
        monkeypatch.setattr(retry, "IN_BETWEEN_S", 4.0)
        settings = {"api.url": f"http://127.0.0.1:{server.server_port}/api", "client.max_retries": 0}
        with temporary_settings(settings):
            yield
        server.shutdown()


def test_busy_api_is_asked_again_and_said_to_be_busy(file, busy_api):
    result = called(file, "--pool", "lab")
    assert result.exit_code == 3
    assert "is busy; trying again for up to 4 s" in result.output
    assert "was busy for 4 s; deploy again later" in result.output
    assert "503" not in result.output


def test_form_shows_no_internal_field():
    assert "bundle" not in str(flow_schema(campaign_flow)["definitions"]["RunRequest"]["properties"])
