"""Do containers of runs stay apart, hold their limits, and leave nothing, whoever is killed, and what do they cost?

By each runtime that works here: runs of a server and a client side by side, whose workers are then killed at random points; a
disk that is full; with Docker, a daemon that is killed, one of the proof's own where this user may start it. Then the CPU time of
a run, the daemon's included, beside the same programs without containers.
"""

import argparse
import contextlib
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from container_runtimes import RUNTIMES, containers_left, made_root, missing

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.scenario.programs.guard import marked
from vastflow.sim.scenario.programs.run import process_run

SERVE = "mkdir -p /tmp/www; echo $WHO >/tmp/www/index.html; exec busybox httpd -f -p 8080 -h /tmp/www"
ASK = ["sh", "-c", "busybox wget -qO- http://127.0.0.1:8080 >answer"]


def life(runtime, root, who):
    """Execute a run of a server and a client, and return the answer."""
    server = {**root, "command": ["sh", "-c", SERVE], "health": {"port": 8080}, "memory": 64 << 20, "cpu": 0.5}
    containers = {"server": server, "main": root}
    with process_run(ProcessSetup(containers=containers, container_runtime=runtime, environment={"WHO": who})) as run:
        run.start(ASK).wait(60)
        return run.close().outputs.files["answer"].decode().strip()


def plain():
    """The same programs without containers."""
    with process_run(ProcessSetup(environment={"WHO": "me"})) as run:
        server = run.start(["sh", "-c", "echo $WHO >index.html; exec busybox httpd -f -p 18080 -h ."])
        group = run.start(["sh", "-c", "until busybox wget -qO- http://127.0.0.1:18080 >answer; do sleep 0.01; done"])
        group.wait(60)
        server.stop()
        run.close()


def begun(runtime, root, who, folder, mark=""):
    """A worker process with one run."""
    command = [sys.executable, __file__, "--life", runtime, repr(root), who]
    environment = {**os.environ, "TMPDIR": str(folder), "VASTFLOW_RUN": mark}
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)


def guard_of(mark):
    """The guard of a run begun with a mark, and the run's own name; None where there is none yet."""
    for each in psutil.process_iter(["cmdline"]):
        found = [word for word in each.info["cmdline"] or () if word.startswith(mark)]
        if found:
            return each, found[0].split(".")[-2]
    return None


def left_of(runtime, mark, run, folder, for_s=90):
    """Count the remains of a run that was begun with a mark."""
    until_s = time.monotonic() + for_s
    while True:
        found = {
            "processes": len(list(marked(mark))) + (guard_of(mark) is not None),
            "containers": len(containers_left(runtime, run)),
            "folders": len(list(folder.iterdir())),
        }
        if not any(found.values()) or time.monotonic() > until_s:
            return found
        time.sleep(0.2)


def side_by_side(runtime, root, runs, folder):
    workers = [begun(runtime, root, f"run-{k}", folder, "side-by-side.") for k in range(runs)]
    answers = [worker.communicate(timeout=500)[0].strip() for worker in workers]
    right = sum(answer == f"run-{k}" for k, answer in enumerate(answers))
    print(f"{runtime}: {right} of {runs} clients side by side were answered by their own run's server", flush=True)
    return right == runs


def killed(runtime, root, points, rng, folder):
    """Kill workers at random points of their runs, until so many were killed in one."""
    began_s = time.monotonic()
    begun(runtime, root, "x", folder).communicate(timeout=300)
    took_s = time.monotonic() - began_s
    ok, struck = True, 0
    for point in range(20 * points):
        mark = f"killed-{runtime}-{point}-{os.getpid()}."
        worker = begun(runtime, root, "x", folder, mark)
        while (guard := guard_of(mark)) is None and worker.poll() is None:
            time.sleep(0.01)
        time.sleep(after_s := rng.uniform(0.0, took_s))
        is_in_flight = guard is not None and guard[0].is_running()
        worker.send_signal(signal.SIGKILL)
        worker.communicate()
        struck += is_in_flight
        left = left_of(runtime, mark, guard[1] if guard else "none", folder)
        ok = ok and not any(left.values())
        if is_in_flight or any(left.values()):
            print(f"{runtime}: killed {after_s:.2f} s after the start of a run's guard, left {left}", flush=True)
        if struck == points:
            return ok
    print(f"{runtime}: only {struck} of {points} were killed in a run")
    return False


def full_disk(runtime, root, folder):
    """A run whose disk is full is a fault of the machine."""
    (small := folder / "small").mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", small], check=False).returncode:
        print(f"{runtime}: full disk skipped, as nothing can be mounted here")
        return True
    try:
        with process_run(ProcessSetup(containers={"main": root}, container_runtime=runtime), where=small) as run:
            run.start(["sh", "-c", "cat /dev/zero >/out/zeros"]).wait(60)
            run.close()
    except OSError as error:
        print(f"{runtime}: full disk: {error.strerror}")
        return error.strerror == "No space left on device"
    finally:
        subprocess.run(["umount", small], check=True)
        small.rmdir()
    return False


def cpu_of(daemons):
    times = [each.cpu_times() for each in daemons]
    return sum(each.user + each.system + each.children_user + each.children_system for each in times)


def overhead(runtime, root, runs, daemons):
    """CPU time of a run (s), with its runtime's processes."""

    def used():
        return sum(
            sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        ) + cpu_of(daemons)

    act = plain if runtime == "plain" else (lambda: life(runtime, root, "x"))
    act()
    before_s, began_s = used(), time.monotonic()
    for _ in range(runs):
        act()
    cpu_s, wall_s = (used() - before_s) / runs, (time.monotonic() - began_s) / runs
    print(f"{runtime}: {cpu_s:.3f} CPU-s and {wall_s:.2f} s wall a run", flush=True)


@contextlib.contextmanager
def own_daemon(folder):
    """Start a daemon of the proof's own, which is then Docker's; yield how to start and find it."""
    socket = f"unix://{folder}/docker.sock"
    options = [
        "--iptables=false",
        "--bridge=none",
        "--host",
        socket,
        "--data-root",
        folder / "data",
        "--exec-root",
        folder / "exec",
    ]
    os.environ["DOCKER_HOST"] = socket
    processes = []

    def start():
        (folder / "pid").unlink(missing_ok=True)
        with (folder / "log").open("a") as log:
            command = ["dockerd", *options, "--pidfile", folder / "pid"]
            processes.append(subprocess.Popen(list(map(str, command)), stdout=log, stderr=log, start_new_session=True))
        until_s = time.monotonic() + 60
        while missing("docker") and time.monotonic() < until_s:
            time.sleep(0.2)
        return processes[-1]

    start()
    try:
        yield start, processes
    finally:
        processes[-1].terminate()
        processes[-1].wait(60)


def daemon_goes_away(root, start, processes, folder):
    """A daemon that is killed is a fault of the run, in one sentence; after its return nothing is left."""
    containers = {"server": {**root, "command": ["sleep", "600"]}, "main": root}
    said = ""
    try:
        with process_run(ProcessSetup(containers=containers, container_runtime="docker"), where=folder) as run:
            mark, name = run._mark, run._mark.split(".")[-2]
            run.start(["sleep", "600"])
            time.sleep(1.0)
            processes[-1].kill()
            processes[-1].wait()
            for _ in range(100):
                run.wait(0.1)
    except ScenarioError as error:
        said = str(error)
    start()
    left = left_of("docker", mark, name, folder)
    print(f"docker: its daemon was killed: {said!r}; after its return left {left}")
    return "it no longer answers" in said and not any(left.values())


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--life", nargs=3, help=argparse.SUPPRESS)
    parser.add_argument("--only", choices=RUNTIMES, action="append")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--points", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    if asked.life:
        print(life(asked.life[0], eval(asked.life[1]), asked.life[2]))
        return 0
    ok, rng = True, random.Random(asked.seed)
    with contextlib.ExitStack() as stack:
        place = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="proof-")))
        overhead("plain", {}, 10, [])
        for runtime in asked.only or RUNTIMES:
            (folder := place / runtime).mkdir()
            daemons, daemon = [], None
            if runtime == "docker" and os.geteuid() == 0 and shutil.which("dockerd"):
                (place / "daemon").mkdir()
                daemon = stack.enter_context(own_daemon(place / "daemon"))
                own = psutil.Process(daemon[1][-1].pid)
                daemons = [own, *own.children()]
            if reason := missing(runtime):
                print(f"{runtime}: skipped, {reason}")
                continue
            root = made_root(runtime, place / f"{runtime}-root")
            overhead(runtime, root, 10, daemons)
            ok &= side_by_side(runtime, root, asked.runs, folder)
            ok &= full_disk(runtime, root, folder)
            ok &= killed(runtime, root, asked.points, rng, folder)
            if daemon:
                ok &= daemon_goes_away(root, *daemon, folder)
    print("nothing was left, and all was answered" if ok else "FAILED")
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
