"""Does looking at a stranger's campaign execute anything of it?

    .venv/bin/python tests/proofs/strangers.py

Builds hostile campaign directories: plug-ins, modules that shadow Python's own, and events that name files, folders, and a store. Opens
every page of a real `vastflow ui` that was started among them, reads and executes them by commands without a terminal, and starts
Prefect's API there. Whatever is executed leaves a line. Prints how much was executed; exit code 1 if anything was.
"""

import http.client
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import urlencode

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from hostile import executed, shadowed, stranger, unfinished_stranger

COMMAND = str(Path(sys.executable).with_name("vastflow"))
TIMEOUT_S = 300
PAGES = ("/", "/campaign", "/configuration", "/run", "/compare", "/live", "/live-run", "/chosen", "/compare-picture")
VIEWS = ("frames", "layers", "summary", "facets", "rows", "points", "paths", "table", "configuration", "signals")
SERVER = """\
from pathlib import Path
from vastflow.tasks.prefect.server import ApiServer
server = ApiServer(Path({log!r}))
print(server.url(200))
server.stop()
"""
POOL = """\
from vastflow.tasks.engine.executor import Priority
from vastflow.tasks.engine.pool import Pool
pool = Pool(1)
print(pool.submit(abs, -1, priority=Priority.EXECUTE).result(200))
pool.close()
"""


class Explorer:
    """A real explorer of a folder, started in it."""

    def __init__(self, results, environment):
        command = [COMMAND, "ui", ".", "--no-browser"]
        self.process = subprocess.Popen(
            command, cwd=results, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        address = self.process.stdout.readline().strip()
        self.host, self.first = re.fullmatch(r"http://([^/]+)(/.*)", address).groups()
        self.cookie = ""
        _, headers = self.ask("GET", self.first)
        self.cookie = headers["set-cookie"].partition(";")[0]

    def ask(self, method, path, **query):
        """Return status and headers of a reply."""
        connection = http.client.HTTPConnection(self.host, timeout=TIMEOUT_S)
        headers = {"Cookie": self.cookie, **({"Origin": f"http://{self.host}"} if method == "POST" else {})}
        connection.request(method, f"{path}?{urlencode(query)}" if query else path, headers=headers)
        reply = connection.getresponse()
        if "event-stream" not in (reply.headers["content-type"] or ""):
            reply.read()
        connection.close()
        return reply.status, reply.headers

    def ids(self):
        """Return the ids of all campaigns in the list."""
        connection = http.client.HTTPConnection(self.host, timeout=TIMEOUT_S)
        connection.request("GET", "/", headers={"Cookie": self.cookie})
        return sorted({*re.findall(r"[?&]c=([\w.-]+)", connection.getresponse().read().decode())})


def run(command, folder, environment):
    """Run a command without a terminal and return its exit code."""
    done = subprocess.run(
        command,
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    return done.returncode


def main():
    """Make all attacks, and print what each executed."""
    total, began_s = 0, time.monotonic()
    with TemporaryDirectory(prefix="vastflow-strangers-") as scratch:
        folder, canary = Path(scratch), Path(scratch, "canary")
        results = shadowed(folder / "results", canary)
        environment = {**os.environ, "XDG_STATE_HOME": str(folder / "state"), "PREFECT_HOME": str(folder / "prefect")}
        first, _ = [stranger(results, canary, day=day) for day in (20, 22)]
        unfinished_stranger(results, canary)

        def tell(attack, outcome=""):
            nonlocal total
            found = executed(canary)
            total += len(found)
            print(f"{len(found):3} executed  {attack}{outcome and f': {outcome}'}", flush=True)

        explorer = Explorer(results, environment)
        try:
            tell("start of the explorer in the folder")
            ids = explorer.ids()
            tell("list of campaigns", f"{len(ids)} campaigns")
            a, b = [each for each in ids if each.startswith("stranger")][:2]
            (living,) = (each for each in ids if each.startswith("living"))
            for c in (a, living):
                asked = {"c": c, "a": a, "b": b, "configuration": "room", "name": "room", "run": 0}
                for path in (*PAGES, *(f"/api/{view}" for view in VIEWS), "/api/events"):
                    if (path, c) != ("/api/events", living):  # which ends when the campaign does
                        explorer.ask("GET", path, **asked)
                tell(f"all pages of {c}")
            tell("its runs from the store", f"POST {explorer.ask('POST', '/live-run', **asked)[0]}")
            for permit in ("", "0" * 64):
                query = {"c": a, "configuration": "room", "run": 0, "permit": permit}
                tell(f"execution, permit={permit[:4]!r}", f"POST {explorer.ask('POST', '/api/layers', **query)[0]}")
        finally:
            explorer.process.terminate()
            explorer.process.wait(30)
        tell("end of the explorer")
        for command in (
            ("show", first),
            ("show", first, "room/0", "--lineage"),
            ("compare", first, first, "--out", folder / "compared"),
            ("export", first, folder / "exported"),
            ("replay", first, "room", "0"),
            ("minimize", first, "room"),
            ("plan", first),
            ("run", first),
        ):
            tell(f"vastflow {command[0]}", f"exit code {run([COMMAND, *map(str, command)], results, environment)}")
        for name, script in (("Prefect's API", SERVER.format(log=str(folder / "log"))), ("worker pool", POOL)):
            command = [sys.executable, "-P", "-c", script]
            tell(f"{name} started in the folder", f"exit code {run(command, results, environment)}")
    print(f"{total} executed in all, {time.monotonic() - began_s:.0f} s")
    sys.exit(total > 0)


if __name__ == "__main__":
    main()
