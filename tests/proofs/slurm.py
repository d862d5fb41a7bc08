"""Run the docs' script on a real SLURM of this machine, and compare the results with those of one process.

munged, slurmctld, and slurmd run in a folder of their own. SLURM's one node claims ten cores, whatever this machine has, so of the
hundred jobs of the page's script ten run and ninety wait. The script is taken from the page; what differs on each cluster is
replaced: the network's interface, the shared folder, and the campaign, here of 30 configurations with `--runs` each. All files of the
campaign directory must be equal byte by byte but for what says when and how it was computed, and no job may be left.

Takes root, and of Debian `apt-get install slurm-wlm munge`, and `pip install dask-jobqueue`.

    python tests/proofs/slurm.py [--runs N] [--folder FOLDER]
"""

import argparse
import ctypes
import json
import os
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import psutil
from killed_life import CONFIGURATIONS, RUNS, Lab
from killed_outcome import differing, digests

PAGE: Final = Path(__file__).parents[2] / "docs" / "run-on-a-cluster.md"
CAMPAIGN: Final = "campaigns/quickstart/quickstart.vast"
SHARED: Final = "/shared"
INTERFACE: Final = "ib0"
NODE_CORES: Final = 10
START_S: Final = 60.0
RUN_S: Final = 1200.0
PROGRAMS: Final = ("munged", "mungekey", "slurmctld", "slurmd", "sbatch", "scancel", "squeue", "sinfo")
PR_SET_CHILD_SUBREAPER: Final = 36

CONFIGURATION: Final = """\
ClusterName=proof
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
SlurmctldPort={controller_port}
SlurmdPort={node_port}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdParameters=config_overrides
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory=1000000
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE
"""
"""Configuration of a cluster without control groups, which a container may not have; `config_overrides` believes `CPUs`."""


def missing() -> list[str]:
    """Return what has to be there and is not."""
    os.environ["PATH"] = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin"])
    found = [f"the program {name}" for name in PROGRAMS if shutil.which(name) is None]
    found += [] if find_spec("dask_jobqueue") else ["the package dask-jobqueue"]
    return found + ([] if os.geteuid() == 0 else ["root"])


def page_script(campaign: Path, shared: Path) -> str:
    """Return the page's script with a campaign, a shared folder, and an interface of this machine."""
    text = PAGE.read_text().partition("## SLURM")[2].partition("```python\n")[2].partition("```")[0]
    for written, here in ((CAMPAIGN, str(campaign)), (SHARED, str(shared)), (INTERFACE, "lo")):
        if written not in text:
            raise SystemExit(f"{PAGE}: expected {written!r} in the script for SLURM, got {text!r}")
        text = text.replace(written, here)
    return text


def start_slurm(folder: Path) -> None:
    """Start SLURM's daemons, and wait until the node is idle; the environment then names its configuration."""
    key, host = folder / "munge.key", socket.gethostname().partition(".")[0]
    with socket.create_server(("127.0.0.1", 0)) as first, socket.create_server(("127.0.0.1", 0)) as second:
        ports = {"controller_port": first.getsockname()[1], "node_port": second.getsockname()[1]}
    (folder / "slurm.conf").write_text(CONFIGURATION.format(folder=folder, host=host, cores=NODE_CORES, **ports))
    os.environ["SLURM_CONF"] = str(folder / "slurm.conf")
    for name in ("state", "spool"):
        (folder / name).mkdir()
    subprocess.run(["mungekey", "--create", "--keyfile", key], check=True)
    files = [f"--{name}-file={folder / name}" for name in ("pid", "log", "seed")]
    munge = ["munged", "--foreground", "--force", f"--key-file={key}", f"--socket={folder}/munge.socket", *files]
    for command in (munge, ["slurmctld", "-D"], ["slurmd", "-D"]):
        with (folder / f"{command[0]}.out").open("wb") as output:
            subprocess.Popen(command, stdout=output, stderr=output)
    deadline_s = time.monotonic() + START_S
    while "idle" not in said("sinfo", "--noheader", "--format=%T"):
        if time.monotonic() > deadline_s:
            raise SystemExit(f"SLURM did not start within {START_S:.0f} s; see {folder}/*.out")
        time.sleep(0.2)


def said(*command: str) -> str:
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=60).stdout.strip()


def queued() -> dict[str, int]:
    """Return the number of jobs by state."""
    states = said("squeue", "--noheader", "--format=%T").split()
    return {state: states.count(state) for state in sorted({*states})}


def called(command: Sequence[str | Path], folder: Path, environment: Mapping[str, str]) -> dict[str, int]:
    """Run a command; return the most jobs that SLURM had in each state meanwhile."""
    most: dict[str, int] = {}
    folder.mkdir(exist_ok=True)
    with (folder / "output").open("wb") as output:
        process = subprocess.Popen(command, cwd=folder, env=environment, stdout=output, stderr=output)
        deadline_s = time.monotonic() + RUN_S
        while process.poll() is None and time.monotonic() < deadline_s:
            for state, number in queued().items() if "SLURM_CONF" in environment else ():
                most[state] = max(number, most.get(state, 0))
            time.sleep(2)
    if process.poll() != 0:
        raise SystemExit(f"ended with {process.poll()}: {(folder / 'output').read_text()[-4000:]}")
    return most


def cpu_s() -> float:
    """Return the CPU time of all that ended below this process."""
    with suppress(ChildProcessError):  # SLURM's step daemons leave their parent, and come here
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def proven(folder: Path, runs: int) -> bool:
    lab = Lab.made(folder, copied=False, robot=True)
    lab.campaign.write_text(lab.campaign.read_text().replace(f"runs: {RUNS}", f"runs: {runs}"))
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", "VASTFLOW_"))}
    environment = {"XDG_CACHE_HOME": str(folder / "cache"), **kept, "HOME": str(folder)}
    here, shared = folder / "here", folder / "shared"
    command = [sys.executable, "-m", "vastflow.flows.cli", "run", str(lab.campaign), "--store", "store"]
    with suppress(SystemExit):  # Prefect's API may start late on a busy machine; the second call goes on
        called(command, here, environment)
    called(command, here, environment)
    print(f"one process: {cpu_s():.1f} CPU-s", flush=True)
    start_slurm(folder)
    before_s, began_s = cpu_s(), time.monotonic()
    shared.mkdir()
    (shared / "script.py").write_text(page_script(lab.campaign, shared))
    most = called([sys.executable, "script.py"], shared, environment | {"SLURM_CONF": os.environ["SLURM_CONF"]})
    wall_s = time.monotonic() - began_s
    # A canceled job takes a moment to complete.
    while (left := queued()) and time.monotonic() < began_s + wall_s + START_S:
        time.sleep(1)
    workers = sum("Registered to" in log.read_text() for log in (shared / "logs").glob("*.err"))
    end_all()
    mine, theirs = (next((each / "results").glob("killed-*")) for each in (here, shared))
    counts = json.loads((theirs / "metadata.json").read_text())["counts"]
    print(f"SLURM: {wall_s:.0f} s, {cpu_s() - before_s:.1f} CPU-s with daemons; {workers} workers; most jobs {most}")
    print(f"executed {counts['executed']} runs; {counts['cpu_s']:.1f} CPU-s by metadata.json")
    different = differing(digests(mine), digests(theirs))
    print(different or f"{len(digests(mine))} files of the campaign directory are equal; jobs left: {left or 'none'}")
    right = most.get("RUNNING") == workers == NODE_CORES and counts["executed"] == CONFIGURATIONS * runs
    return right and not different and not left


def end_all() -> None:
    """End SLURM's daemons and what they started."""
    there = psutil.Process().children(recursive=True)
    for end in (psutil.Process.terminate, psutil.Process.kill):
        for process in there:
            with suppress(psutil.Error):
                end(process)
        there = psutil.wait_procs(there, timeout=10)[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="where all is made and kept; else a temporary one")
    parser.add_argument("--runs", type=int, default=RUNS, help="runs of each configuration")
    asked = parser.parse_args()
    if lacking := missing():
        parser.error(f"takes {', '.join(lacking)}")
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))
    with tempfile.TemporaryDirectory(prefix="vastflow-slurm-") as temporary:
        folder = (asked.folder or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        try:
            right = proven(folder, asked.runs)
        finally:
            end_all()
    raise SystemExit(not right)


if __name__ == "__main__":
    main()
