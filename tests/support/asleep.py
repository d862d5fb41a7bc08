"""A campaign whose runs sleep, run by a process of its own."""

import os
import subprocess
import sys
import time
from contextlib import contextmanager

CAMPAIGN = """\
version: 1
metadata: {name: asleep}
configuration:
- name: asleep
  variations:
  - ParameterVariationList: {name: command, values: COMMANDS}
execution: {scenario_file: asleep.osc, runs: RUNS, timeout: 300}
"""
SCENARIO = """\
import osc.helpers

scenario asleep:
    command: string
    do serial:
        run_process(command)
        emit end
"""
SLEEPING_SEARCH = """
version: 1
metadata: {name: asleep}
search:
  strategy: random
  search_space: {x: {type: float, low: 2, high: 3}}
  per_batch: 4
  budget: [{batches: 2}]
  confirm: 0
execution: {scenario_file: sleep.osc, runs: 1, timeout: 300}
"""
SLEEP_X = """
import osc.helpers

scenario sleep_x:
    x: string
    do serial:
        run_process('sleep ' + x)
"""
END_S = 240


def gated(folder, first=0):
    """A command that ends at once for the first calls, and later when the folder has a file `go`."""
    begun, go = folder / "begun", folder / "go"
    return f"sh -c 'echo >> {begun}; until test -e {go} || test $(wc -l < {begun}) -le {first}; do sleep 0.1; done'"


def wait_until(condition):
    """Return a true value once there is one; fail after `END_S`."""
    deadline_s = time.monotonic() + END_S
    while not (found := condition()):
        assert time.monotonic() < deadline_s
        time.sleep(0.3)
    return found


@contextmanager
def sleepers(folder, home, commands, runs, workers):
    """Yield a function that starts the campaign with its results in a folder; its processes are killed afterwards.

    Args:
        home: Prefect's home, which no other process uses.
        commands: One for each configuration.
    """
    (folder / "asleep.vast").write_text(CAMPAIGN.replace("COMMANDS", str(commands)).replace("RUNS", str(runs)))
    (folder / "asleep.osc").write_text(SCENARIO)
    environment = {**os.environ, "PREFECT_HOME": str(home)}
    environment.pop("PREFECT_API_URL", None)
    started = []

    def start(results):
        command = ["run", "asleep.vast", "--results", results, "--store", f"{results}-store", "--workers", str(workers)]
        process = subprocess.Popen(
            [sys.executable, "-m", "vastflow.flows.cli", *command],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        started.append(process)
        return process

    try:
        yield start
    finally:
        for process in started:
            process.kill()
            process.communicate()
