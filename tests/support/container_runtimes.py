"""Runtimes of containers for tests: those that work here, and a small root file system made of busybox."""

import os
import shutil
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.scenario.programs.run import process_run

RUNTIMES = ("docker", "podman", "runc", "bubblewrap")
IMAGE = "vastflow-test:1"
COMMANDS = ("sh", "sleep", "touch", "wget", "test", "env", "cat")


def missing(runtime):
    """Why containers can't be tested with a runtime here; empty if they can."""
    if shutil.which("busybox") is None or "statically" not in _said("file", "-L", str(shutil.which("busybox"))):
        return "needs a static busybox: apt-get install busybox-static file"
    if runtime in ("docker", "podman") and not _said(runtime, "info", "--format", "{{json .}}"):
        return f"{runtime} does not answer"
    if runtime == "runc" and (shutil.which("runc") is None or os.geteuid() != 0):
        return "needs runc, and root"
    return "needs bubblewrap" if runtime == "bubblewrap" and shutil.which("bwrap") is None else ""


def made_root(runtime, folder):
    """Make a root file system: an image, or a folder."""
    root = folder / "root"
    for each in ("bin", "etc", "tmp"):
        (root / each).mkdir(parents=True)
    shutil.copy(str(shutil.which("busybox")), root / "bin/busybox")
    for name in COMMANDS:
        (root / "bin" / name).symlink_to("busybox")
    if runtime not in ("docker", "podman"):
        return {"rootfs": str(root)}
    if not _said(runtime, "image", "inspect", IMAGE):
        tar = subprocess.run(["tar", "-C", root, "-c", "."], capture_output=True, check=True).stdout
        subprocess.run([runtime, "import", "-", IMAGE], input=tar, capture_output=True, check=True)
    return {"image": IMAGE}


def refused(runtime):
    """Why a runtime can't run the image here; empty if it can."""
    if runtime not in ("docker", "podman"):
        return ""
    command = [runtime, "run", "--rm", "--init", "--network", "none", IMAGE, "env"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return f"{runtime} can't run a container here: {done.stderr.strip()[-200:]}" if done.returncode else ""


def containers_left(runtime, run=""):
    """Names of containers and control groups that are left of a run, or of any."""
    names = [path.name for path in Path("/sys/fs/cgroup").glob("*/vastflow-*")]
    if runtime in ("docker", "podman"):
        names += _said(runtime, "ps", "--all", "--filter", "label=vastflow", "--format", "{{.Names}}").split()
    return [name for name in names if run in name]


@contextmanager
def in_containers(runtime, folder, containers, **setup):
    """Begin a run with these containers, and wait until none is left."""
    with process_run(ProcessSetup(containers=containers, container_runtime=runtime, **setup), where=folder) as run:
        mark = run._mark.split(".")[-2]
        yield run
    until_s = time.monotonic() + 30
    while left := containers_left(runtime, mark):
        assert time.monotonic() < until_s, left
        time.sleep(0.1)


def _said(*command):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return "" if done.returncode else done.stdout
