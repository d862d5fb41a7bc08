"""Base job templates of work pools: valid jobs without settings of the worker."""

import asyncio
import json
import re
import uuid
from pathlib import Path
from typing import Any

import kubernetes_validate
import prefect
import pytest
from prefect.client.schemas.objects import FlowRun
from prefect.settings import Settings
from prefect.workers.base import BaseJobConfiguration
from pydantic import Field

from vastflow.tasks.prefect.deployment import DATA, IMAGE, NAME, PoolType, job_variables
from vastflow.tasks.prefect.registration import pool_template

QUEUE_LABEL = "kueue.x-k8s.io/queue-name"
IMAGE_USER = 1000
DOCKERFILE = Path(__file__).parents[2] / "deployments" / "Dockerfile"
LOOKED_FOR = "prefect-job"
"""The container in which Prefect's worker looks for the flow run."""
_ENV = pool_template(PoolType.kubernetes)["job_configuration"]["env"]
OF_THE_WORKER = tuple(name for name, value in _ENV.items() if value is None)
"""Settings that a job template gives no value: a worker hands all of its own on, and its addresses, paths and secrets mean nothing in a
container, or too much."""

NEITHER_IN_A_POD_SPEC = ("parallelism", "completions")
PLACES = re.compile(
    r".*_(PATH|URL|HOME|KEY|STRING|HOST|FILE|PASSWORD|USER|DIRECTORY|BLOCK|HEADERS|PORT|NAME|NAMESPACE)"
)
FOREIGN = "http://of-the-worker.example"


class Configuration(BaseJobConfiguration):
    """The use of a template by any worker, without the worker's own package."""

    job_manifest: dict[str, Any] = Field(default_factory=dict)
    volumes: list[str] = Field(default_factory=list)
    mem_limit: str | None = None
    container_create_kwargs: dict[str, Any] = Field(default_factory=dict)
    image: str = ""


def configured(kind, values, worker_environment=None, configuration=Configuration, monkeypatch=None):
    if monkeypatch is not None:
        monkeypatch.setattr(BaseJobConfiguration, "_base_environment", staticmethod(lambda: dict(worker_environment)))
    made = asyncio.run(configuration.from_template_and_values(pool_template(kind), values, client=object()))
    made.prepare_for_flow_run(FlowRun(id=uuid.uuid4(), name="quick-fox", flow_id=uuid.uuid4()))
    return made


def valid_job(manifest):
    """The Job as Kubernetes keeps it; what it does not know, it leaves out."""
    job = json.loads(json.dumps(manifest))
    for key in NEITHER_IN_A_POD_SPEC:
        assert job["spec"]["template"]["spec"].pop(key) == 1
    kubernetes_validate.validate(job, kubernetes_validate.latest_version(), strict=True)
    return job


def pod(configuration):
    return configuration.job_manifest["spec"]["template"]["spec"]


def test_job_of_every_key_of_campaign_file_is_valid_and_has_them(described):
    valid_job(configured(PoolType.kubernetes, {}).job_manifest)
    made = configured(PoolType.kubernetes, job_variables(PoolType.kubernetes, described(), IMAGE, NAME))
    valid_job(made.job_manifest)
    spec = pod(made)
    (main,) = spec["containers"]
    limits = {"memory": "8Gi", "nvidia.com/gpu": "1"}
    assert main["resources"] == {"requests": {"cpu": "4", "memory": "8Gi"}, "limits": limits}
    assert spec["nodeSelector"] == {"disk": "ssd", "example.org/fast": "true"}
    assert spec["securityContext"]["runAsUser"] == IMAGE_USER
    assert {mount["name"] for mount in main["volumeMounts"]} == {volume["name"] for volume in spec["volumes"]}
    for container in (*spec["initContainers"], main):
        assert container["securityContext"]["readOnlyRootFilesystem"] is True
        assert container["image"] == IMAGE
    folders = {mount["mountPath"] for mount in main["volumeMounts"]}
    assert {made.env["HOME"], made.env["XDG_CACHE_HOME"], DATA, "/tmp", "/dev/shm"} <= folders
    assert {"name": "data", "mountPath": DATA} in main["volumeMounts"]


def test_job_has_queue_secret_and_end_of_its_variables():
    made = configured(PoolType.kubernetes, {"secret": "s3", "queue": "nightly", "finished_job_ttl": 60})
    assert configured(PoolType.kubernetes, {}).labels[QUEUE_LABEL] == "vastflow"
    assert made.labels[QUEUE_LABEL] == "nightly"
    (main,) = pod(made)["containers"]
    assert (main["name"], main["envFrom"]) == (LOOKED_FOR, [{"secretRef": {"name": "s3", "optional": True}}])
    spec = made.job_manifest["spec"]
    assert (spec["ttlSecondsAfterFinished"], spec["backoffLimit"]) == (60, 0)
    template = pool_template(PoolType.kubernetes)
    assert "AWS" not in json.dumps(template)
    assert template["variables"]["properties"]["finished_job_ttl"]["default"] > 0


@pytest.mark.parametrize("kind", [PoolType.docker, PoolType.kubernetes])
def test_job_has_only_settings_of_deployment(kind, monkeypatch):
    foreign = dict.fromkeys((*OF_THE_WORKER, "PREFECT_API_URL", "PREFECT_HOME"), FOREIGN)
    made = configured(kind, {}, {**foreign, "PREFECT_LOGGING_LEVEL": "DEBUG"}, monkeypatch=monkeypatch)
    assert FOREIGN not in json.dumps(made.env)
    assert made.env["PREFECT_LOGGING_LEVEL"] == "DEBUG"
    assert made.env["VASTFLOW_STORE"].startswith(DATA)
    env = {"PREFECT_API_SSL_CERT_FILE": "/etc/ca.pem", "VASTFLOW_STORE": "s3://bucket"}
    made = configured(kind, {"env": env}, {"PREFECT_API_SSL_CERT_FILE": FOREIGN}, monkeypatch=monkeypatch)
    assert {name: made.env[name] for name in env} == env


def environment_names(settings):
    for name in type(settings).model_fields:
        value = getattr(settings, name)
        if hasattr(type(value), "model_fields"):
            yield from environment_names(value)
        else:
            yield (settings.model_config.get("env_prefix", "") + name).upper()


@pytest.mark.skipif(not prefect.__version__.startswith("3.8."), reason="the list was made for Prefect 3.8")
def test_template_removes_settings_of_places_and_secrets():
    known = {*OF_THE_WORKER, "PREFECT_API_URL", "PREFECT_HOME"}
    names = set(environment_names(Settings()))
    assert {name for name in names if PLACES.fullmatch(name)} - known <= {"PREFECT_SERVER_API_CORS_ALLOWED_HEADERS"}
    assert known <= names


def test_docker_job_has_volume_and_memory_and_process_job_neither(described):
    made = configured(PoolType.docker, job_variables(PoolType.docker, described(), IMAGE, NAME))
    assert (made.volumes, made.mem_limit, made.image) == ([f"vastflow:{DATA}"], f"{8 * 2**30}b", "vastflow:latest")
    assert made.container_create_kwargs["read_only"] is True
    folders = {mount["Target"] for mount in made.container_create_kwargs["mounts"]}
    assert {made.env["HOME"], made.env["XDG_CACHE_HOME"], "/tmp"} <= folders
    assert re.search(rf"XDG_CACHE_HOME={made.env['XDG_CACHE_HOME']}\s", DOCKERFILE.read_text())  # which has the kernels
    assert job_variables(PoolType.process, described(), IMAGE, NAME) == {}


def test_prefects_own_worker_accepts_the_template_and_puts_everything_into_the_job(described, monkeypatch):
    worker = pytest.importorskip("prefect_kubernetes.worker", reason="takes the package prefect-kubernetes")
    made = configured(
        PoolType.kubernetes,
        job_variables(PoolType.kubernetes, described(), IMAGE, NAME),
        {"PREFECT_API_KEY": FOREIGN},
        worker.KubernetesWorkerJobConfiguration,
        monkeypatch,
    )
    job = valid_job(made.job_manifest)
    assert FOREIGN not in json.dumps(job)
    assert job["metadata"]["labels"][QUEUE_LABEL] == job["spec"]["template"]["metadata"]["labels"][QUEUE_LABEL]
    assert job["spec"]["template"]["spec"]["containers"][0]["args"] == ["prefect", "flow-run", "execute"]


def test_prefects_own_docker_worker_accepts_the_template(monkeypatch):
    worker = pytest.importorskip("prefect_docker.worker", reason="takes the package prefect-docker")
    made = configured(
        PoolType.docker, {}, {"PREFECT_API_KEY": FOREIGN}, worker.DockerWorkerJobConfiguration, monkeypatch
    )
    assert (made.auto_remove, made.privileged, FOREIGN in json.dumps(made.env)) == (True, False, False)
