"""Strikes with kill -9 at a campaign of nodes while its runs are in flight, and what they leave.

It belongs to `ros2_nodes.py`.
"""

import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from container_runtimes import containers_left
from containers import own_daemon
from killed_outcome import differing, digests

from vastflow.sim.scenario.programs.guard import VARIABLE, marked

IMAGE = "vastflow-nodes:1"
MODES = ("plain", "docker", "runc", "bubblewrap")
CLIENTS = ("docker", "runc", "bwrap")


@contextlib.contextmanager
def docker():
    """Start a daemon with an image of links and empty folders, over which this machine's programs are mounted."""
    with tempfile.TemporaryDirectory(prefix="proof-daemon-") as folder:
        root = Path(folder) / "root"
        for name in ("usr", "etc", "opt", "root", "tmp", "sbin"):
            (root / name).mkdir(parents=True)
        for name in ("bin", "lib", "lib64"):
            if Path("/", name).is_symlink():
                (root / name).symlink_to(os.readlink(Path("/", name)))
        with own_daemon(Path(folder)):
            tar = subprocess.run(["tar", "-C", root, "-c", "."], capture_output=True, check=True).stdout
            subprocess.run(["docker", "import", "-", IMAGE], input=tar, capture_output=True, check=True)
            yield


@contextlib.contextmanager
def small_disk():
    """Mount a disk of 8 MiB, in which runs then have their folders."""
    with tempfile.TemporaryDirectory(prefix="proof-disk-") as folder:
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", folder], check=True)
        before, tempfile.tempdir = tempfile.tempdir, folder
        try:
            yield folder
        finally:
            tempfile.tempdir = before
            subprocess.run(["umount", folder], check=True)


def container(mode, python):
    """The main container in which nodes are started."""
    if mode != "docker":
        return {"rootfs": "/"}
    needed = ("/usr", "/etc", str(Path(python).parents[1]), str(Path(os.path.realpath(python)).parents[1]))
    return {"image": IMAGE, "mounts": [{"source": each, "target": each} for each in dict.fromkeys(needed)]}


class Striker:
    """A campaign by one way to run its nodes, in a place of its own, and its strikes.

    Attributes:
        struck: Strikes at runs in flight so far, by whom they hit.
        left: What they left.
    """

    def __init__(self, place, text, mode, python, rng):
        self.place, self.mode, self.python, self.rng = place, mode, python, rng
        self.mark = f"strikes-{os.getpid()}-{mode}-{place.name}."
        self.flow, self.struck, self.left, self.in_need = None, [], [], True
        self.campaign = place / "nodes" / "nodes.vast"
        self.campaign.parent.mkdir(parents=True)
        (place / "tmp").mkdir()
        shutil.copytree(Path(__file__).parents[2] / "campaigns" / "nodes", self.campaign.parent, dirs_exist_ok=True)
        if mode != "plain":
            main = json.dumps(container(mode, python))
            text = text.replace(
                "\n  nodes:", f"\n  containers: {{main: {main}}}\n  container_runtime: {mode}\n  nodes:", 1
            )
        self.campaign.write_text(text)

    def begin(self, runs):
        """Begin the campaign, or resume it; one that is whole is begun anew."""
        if self.flow is not None and self.flow.returncode == 0 and self.in_need:
            shutil.rmtree(self.place / "store")
            shutil.rmtree(self.place / "results")
        command = [
            sys.executable,
            "-m",
            "vastflow.flows.cli",
            "run",
            self.campaign,
            "--workers",
            "2",
            "--runs",
            str(runs),
        ]
        command += ["--results", self.place / "results", "--store", self.place / "store"]
        self._start(command)

    def begin_one(self, proof):
        self._start(
            [sys.executable, proof, "--environment", Path(self.python).parents[1], "--only", "one", "--mode", self.mode]
        )

    def _start(self, command):
        environment = {**os.environ, VARIABLE: self.mark, "TMPDIR": str(self.place / "tmp")}
        with (self.place / "log").open("a") as log:
            self.flow = subprocess.Popen(list(map(str, command)), stdout=log, stderr=log, env=environment)

    def finished(self):
        return self.flow.poll() is not None

    def in_flight(self):
        """Mark of each run in flight, to its processes with their command lines."""
        runs = {}
        for pid in marked(self.mark):
            with contextlib.suppress(psutil.Error, OSError, IndexError):
                own = Path(f"/proc/{pid}/environ").read_bytes().split(f"{VARIABLE}={self.mark}".encode(), 1)[1]
                run = own.split(b"\0")[0].split(b".")[0].decode()
                if run:
                    process = psutil.Process(pid)
                    runs.setdefault(run, {})[process] = process.cmdline()
        return runs

    def strike(self, whom):
        """Kill one of a run in flight whose nodes have been started; whether there was one to be killed."""
        ready = []
        for run, processes in self.in_flight().items():
            texts = [" ".join(line) for line in processes.values()]
            if all(any(script in text for text in texts) for script in ("bridge.py", "follower.py", "stopper.py")):
                ready.append(run)
        if not ready:
            return False
        run = self.rng.choice(ready)
        time.sleep(self.rng.uniform(0.0, 1.0))
        processes = self.in_flight().get(run, {})
        guards = [
            each for each in psutil.process_iter(["cmdline"]) if f"{self.mark}{run}." in (each.info["cmdline"] or ())
        ]
        if not processes or not guards:
            return False
        folder = Path(guards[0].info["cmdline"][-1])
        inner = {
            each: line for each, line in processes.items() if line and Path(line[0]).name == Path(self.python).name
        }
        victims = {
            "flow": [psutil.Process(self.flow.pid)] if not self.finished() else [],
            "worker": [guards[0].parent()],
            "runtime": [each for each, line in processes.items() if line and Path(line[0]).name in CLIENTS],
            "bridge": [each for each, line in inner.items() if "bridge.py" in " ".join(line)],
            "node": [each for each, line in inner.items() if line[-1] in ("follower.py", "stopper.py")],
        }[whom]
        if not victims or not folder.is_dir():
            return False
        victim = self.rng.choice(sorted(victims, key=lambda each: each.pid))
        try:
            victim.send_signal(signal.SIGKILL)
        except psutil.NoSuchProcess:
            return False
        self.struck.append(whom)
        left = self._left(run, folder)
        self.left += left
        print(f"{self.mode}: {whom} {victim.pid} killed, left {left or 'nothing'}", flush=True)
        if whom == "flow":
            self.flow.wait()
            self.end()
        return True

    def _guards(self, run):
        """Guards of a run, or of any, which hold domains as long as they live."""
        lines = ((each.pid, each.info["cmdline"] or ()) for each in psutil.process_iter(["cmdline"]))
        return [f"guard {pid}" for pid, words in lines if any(word.startswith(f"{self.mark}{run}") for word in words)]

    def _left(self, run, folder):
        """Wait until nothing of a run is left, and return what is after half a minute."""
        until_s = time.monotonic() + 30.0
        while True:
            left = [f"process {pid}" for pid in marked(f"{self.mark}{run}.")]
            left += [str(folder)] if folder.exists() else []
            left += self._guards(run)
            left += containers_left("docker" if self.mode == "docker" else "", run)
            if not left or time.monotonic() > until_s:
                return left
            time.sleep(0.1)

    def end(self):
        """Note what is left after the flow's end: processes, run folders, and guards, which hold domains."""
        until_s = time.monotonic() + 60.0
        while True:
            left = [f"process {pid}" for pid in marked(self.mark)]
            left += map(str, (self.place / "tmp").glob("vastflow-run-*"))
            left += self._guards("")
            if not left or time.monotonic() > until_s:
                self.left += left
                return
            time.sleep(0.1)


def undisturbed(place, text, python, runs):
    """Digests of the tables of a campaign that nobody strikes at."""
    quiet = Striker(place, text, "plain", python, random.Random(0))
    quiet.begin(runs)
    quiet.flow.wait()
    return tables(place)


def tables(place):
    """Digests of the tables of the last call's results, without that of what runs are given: their containers differ."""
    results = max((place / "results").iterdir(), key=lambda each: each.stat().st_mtime)
    return {
        name: digest
        for name, digest in digests(results).items()
        if name.endswith(".parquet") and name != "configurations.parquet"
    }


def strikes(check, proof, text, python, points, seed, only):
    """Strike at `points` points; each mode's campaign is then resumed, and its tables compared with those of a quiet one."""
    rng, runs, total = random.Random(seed), 3, 0
    with tempfile.TemporaryDirectory(prefix="proof-") as folder, contextlib.ExitStack() as stack:
        if shutil.which("dockerd"):
            stack.enter_context(docker())
        modes = [mode for mode in MODES if (mode != "docker" or shutil.which("dockerd")) and only in ("", mode)]
        wanted = undisturbed(Path(folder) / "quiet", text, python, runs)
        for number, mode in enumerate(modes):
            share = points // len(modes) + (number < points % len(modes))
            striker = Striker(Path(folder) / mode, text, mode, python, rng)
            whoms = [
                whom for whom in ("worker", "bridge", "flow", "runtime", "node") if mode != "plain" or whom != "runtime"
            ]
            plan = [whoms[k % len(whoms)] for k in range(share)]
            for whom in [each for each in plan if each != "node"]:  # whose death is its run's failure, and not a fault
                hit = False
                while not hit:
                    if striker.flow is None or striker.finished():
                        striker.begin(runs)
                    hit = striker.strike(whom)
                    time.sleep(0.2)
            if not striker.finished():
                striker.flow.wait()
            striker.end()
            striker.in_need = False  # no more of it: what is whole stays
            striker.begin(runs)
            check(striker.flow.wait() == 0, f"{mode}: resumed with exit code {striker.flow.returncode}")
            striker.end()
            found = tables(striker.place)
            check(found == wanted, f"{mode}: {len(wanted)} tables as in the quiet campaign {differing(wanted, found)}")
            one = Striker(Path(folder) / f"{mode}-one", text, mode, python, rng)
            for whom in [each for each in plan if each == "node"]:
                hit = False
                while not hit:
                    if one.flow is None or one.finished():
                        one.begin_one(proof)
                    hit = one.strike(whom)
                    time.sleep(0.1)
                one.flow.wait(120)
                one.end()
            struck, left = [*striker.struck, *one.struck], [*striker.left, *one.left]
            total += len(struck)
            check(
                not left and len(struck) == share,
                f"{mode}: {len(struck)} of {share} struck in flight, left {left or 'nothing'}",
            )
    check(total == points, f"{total} of {points} strikes at runs in flight")
