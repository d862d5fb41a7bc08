"""Does a hostile cluster, or another user of this machine, run code as the one who runs a campaign?

Dask's processes load this module, too (`--preload`): then they answer pickles that would execute code where they are loaded.
"""

import os
import pickle
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

WAYS = ("result", "error", "traceback", "type", "warning", "code", "code's error", "scheduler")
"""Parts of messages that are pickled: a unit's result, its error, the traceback, the result's type, a warning,
what a worker says of its code and how that fails, and a part of a message of the scheduler."""

_FOLDER = "HOSTILE_FOLDER"

OTHER_USER = 1001
_INTRUDER = """
import asyncio, os, pickle, sys
import distributed
from distributed.core import rpc
from distributed.security import Security

async def intrude(address, security):
    remote = rpc(address, connection_args=security.get_connection_args("client"), timeout=5)
    function = pickle.dumps(os.getuid)
    print((await remote.run_function(function=function, args=pickle.dumps(()), kwargs=pickle.dumps({}))))

security, (_, place) = Security.temporary(), sys.argv[1].split("://")
os.setuid(int(sys.argv[2]))
for scheme, own in (("tcp", Security()), ("tls", security)):
    try:
        asyncio.run(asyncio.wait_for(intrude(f"{scheme}://{place}", own), 20))
    except BaseException as error:
        print(type(error).__name__, file=sys.stderr)
"""


class Bomb:
    """Notes the process that unpickles it."""

    def __reduce__(self):
        return exec, (f"open({str(_folder() / 'executed')!r}, 'a').write(str(__import__('os').getpid()) + ' ')",)


def _folder():
    return Path(os.environ[_FOLDER])


def _way():
    return (_folder() / "way").read_text()


def _armed(answer):
    """Return `answer` as an attacker would change it."""

    def attack(*arguments):
        from distributed import get_worker

        way = _way()
        if answer.__name__ == "identity":
            way = {"code": "result", "code's error": "error"}.get(way, "none")
        if way == "result":
            return Bomb()
        if way in ("error", "traceback"):
            raise RuntimeError("as usual")
        if way == "warning":
            get_worker().log_event("warn", {"message": pickle.dumps(Bomb()), "category": pickle.dumps(Bomb())})
            time.sleep(1.0)
        return answer(*arguments)

    return attack


def _patch_worker():
    from distributed import worker, worker_state_machine
    from distributed.protocol import to_serialize

    from vastflow.tasks.engine import dask_worker

    dask_worker.run_unit, dask_worker.identity = map(_armed, (dask_worker.run_unit, dask_worker.identity))
    say, finish = worker.error_message, worker_state_machine.TaskFinishedMsg

    def message(error, *arguments):
        armed = {"error": "exception", "code's error": "exception", "traceback": "traceback"}.get(_way())
        return say(error, *arguments) | ({armed: to_serialize(pickle.dumps(Bomb()))} if armed else {})

    def finished(**fields):
        return finish(**(fields | {"type": pickle.dumps(Bomb())} if _way() == "type" else fields))

    worker.error_message, worker_state_machine.TaskFinishedMsg = message, finished


def _patch_scheduler(scheduler):
    from distributed.protocol.serialize import ToPickle

    usual = scheduler.handlers["identity"]
    scheduler.handlers["identity"] = lambda **asked: {
        **usual(**asked),
        **({"more": ToPickle(Bomb())} if _way() == "scheduler" else {}),
    }


def dask_setup(server):
    """Called by Dask in its processes."""
    if type(server).__name__ == "Scheduler":
        _patch_scheduler(server)
    else:
        _patch_worker()


class HostileCluster:
    """A scheduler and a worker that attack whoever uses them."""

    def __init__(self, folder):
        os.environ[_FOLDER] = str(folder)
        self.folder, self.file, self._processes = folder, folder / "scheduler.json", []
        (folder / "way").write_text("none")
        for kind, more in (("scheduler", ("--port", "0")), ("worker", ("--nthreads", "1", "--no-nanny"))):
            command = [
                sys.executable,
                "-m",
                "dask",
                kind,
                *more,
                "--host",
                "127.0.0.1",
                "--dashboard-address",
                "127.0.0.1:0",
            ]
            command += ["--scheduler-file", str(self.file), "--preload", __file__]
            with open(folder / kind, "wb") as log:
                self._processes.append(subprocess.Popen(command, stdout=log, stderr=log, cwd=folder))
            while not self.file.exists() or (kind == "worker" and "Registered to" not in (folder / kind).read_text()):
                time.sleep(0.1)

    def attack(self, way):
        """Use the cluster; return whether code was executed here, and the outcome."""
        from vastflow.tasks.engine.dask_cluster import DaskCluster
        from vastflow.tasks.engine.executor import Priority
        from vastflow.tasks.engine.progress import Tally
        from vastflow.tasks.store.store import open_store

        (self.folder / "way").write_text(way)
        (self.folder / "executed").write_text("")
        executor = DaskCluster(str(self.file), open_store(self.folder / "store"), _Nothing(), Tally())
        outcome = executor.submit(len, "ab", priority=Priority.EXECUTE)
        try:
            outcome = outcome.exception(120) or outcome.result()
        except TimeoutError as error:
            outcome = error
        time.sleep(1.0)  # what comes beside the result
        executor.close()
        return str(os.getpid()) in (self.folder / "executed").read_text().split(), outcome

    def close(self):
        """End both processes."""
        for process in reversed(self._processes):
            process.kill()
            process.wait()
        del os.environ[_FOLDER]


class _Nothing:
    def close(self):
        pass


def intrude(address):
    """Let another user of this machine ask a scheduler to execute something; return what they got, empty for nothing."""
    command = [sys.executable, "-c", _INTRUDER, address, str(OTHER_USER)]
    asked = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    return asked.stdout.strip()


def local_cluster(folder):
    """Return an executor of `local:1` that has connected."""
    from vastflow.tasks.engine.dask_cluster import DaskCluster
    from vastflow.tasks.engine.executor import Priority
    from vastflow.tasks.engine.progress import Tally
    from vastflow.tasks.store.store import open_store

    executor = DaskCluster("local:1", open_store(folder / "store"), _Nothing(), Tally(), folder / "log")
    executor.submit(len, "ab", priority=Priority.EXECUTE).result(120)
    return executor


def exposed():
    """Return what other users see of this process's descendants: addresses on other interfaces, and keys in arguments."""
    children = psutil.Process().children(recursive=True)
    sockets = [
        each.laddr for child in children for each in child.net_connections() if each.status == psutil.CONN_LISTEN
    ]
    assert sockets, "expected a cluster that listens"
    return [each for each in sockets if each.ip != "127.0.0.1"] + [
        child.cmdline() for child in children if "PRIVATE KEY" in " ".join(child.cmdline())
    ]


def main():
    """Try all attacks, and end with code 1 if one succeeds."""
    succeeded = 0
    with tempfile.TemporaryDirectory() as folder:
        cluster = HostileCluster(Path(folder))
        for way in WAYS:
            executed, outcome = cluster.attack(way)
            succeeded += executed
            print(f"{way:15} {'EXECUTED' if executed else 'refused':8} {outcome!r}"[:150], flush=True)
        cluster.close()
        executor = local_cluster(Path(folder))
        got, seen = intrude(executor._address), exposed()
        executor.close()
        succeeded += bool(got) + bool(seen)
        print(f"user {OTHER_USER} got {got or 'nothing'} of local:1 and sees {seen or 'nothing'}")
    print(f"{succeeded} of {len(WAYS) + 2} attacks succeeded")
    return succeeded > 0


if __name__ == "__main__":
    if os.getuid():
        sys.exit("hostile_cluster: expected to run as root, which can become another user")
    sys.exit(main())
