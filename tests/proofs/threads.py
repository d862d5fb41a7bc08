"""Check that concurrent calls in one process give the results of a single call.

Each round writes two campaign files anew that share a producer, its helper, an oracle, a notebook and a scenario file, so that nothing
of them is loaded yet, and begins several calls together. A call reads one of the files and instantiates it. Those of `--api` are
`instantiate` and `run_campaign` of the Python API. Prints a line for each way, and one for each kind of failure; exit code 1 with any.

    python tests/proofs/threads.py [--calls N] [--api N]
"""

import argparse
import asyncio
import json
import tempfile
import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

AT_ONCE = 4
NOISE = "laserscan_gaussian_noise_std_deviation"
SLOW = "import time; time.sleep(0.02)  # as a plug-in that imports large libraries\n"
CELL = "from helper import NUMBER\nverdicts = [{'run_index': i, 'judgement': 'pass'} for i in runs['run_index'].to_pylist()]"
FILES = {
    "room.pgm": "P2 60 60 255\n" + "\n".join("0" if {x, y} & {0, 59} else "254" for x in range(60) for y in range(60)),
    "room.yaml": "{image: room.pgm, resolution: 0.05, origin: [0.0, 0.0, 0.0]}",
    "noise.txt": "0.1 0.2",
    "helper.py": f"{SLOW}NUMBER = NUMBER_HERE\n",
    "own.py": f"""{SLOW}
from helper import NUMBER
from pathlib import Path
from vastflow.oracles.judgement import oracle
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Parameters, Producer

class Own(Producer[Parameters]):
    Parameters = Parameters
    reads = ()
    writes = {{"{NOISE}": "system"}}
    files = ["noise.txt"]

    def produce(self, inputs, draws):
        for line in (Path(__file__).parent / "noise.txt").read_text().split():
            time.sleep(0.01)
            yield Fragment({{"{NOISE}": float(line) + NUMBER / 1e6}})

class Judge(oracle.Oracle[oracle.Parameters]):
    Parameters = oracle.Parameters

    def judge(self, trace, situation):
        return self.passed(trace)
""",
    "own.ipynb": json.dumps(
        {
            "cells": [{"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": CELL}],
            "metadata": {"number": "NUMBER_HERE"},
            "nbformat": 4,
            "nbformat_minor": 5,
        }
    ),
    "own.osc": """
import osc.nav2
import osc.ros

scenario number_NUMBER_HERE:
    start_pose: pose_3d
    goal_pose: pose_3d
    robot: differential_drive_robot
    do serial:
        robot.init_nav2(start_pose)
        robot.nav_to_pose(goal_pose)
""",
}
CAMPAIGN = """
version: 1
configuration:
  - name: room
    parameters:
      - map_file: room.yaml
      - start_pose: {x: 1.0, y: 1.0, yaw: 0.0}
      - goal_pose: {x: 1.5, y: 1.0, yaw: 0.0}
    variations: [own.py:Own: {}]
execution: {scenario_file: own.osc, runs: 1}
evaluation: {oracles: [own.py:Judge, own.ipynb]}
"""


def read(file, number):
    """Read a campaign and instantiate it in this thread."""
    from vastflow.flows.request.campaign_file import read_campaign
    from vastflow.producers.instantiation.instantiate import instantiate

    campaign, oracles = read_campaign(file)
    assert len(oracles) == 3
    found = [each.scenario.system[NOISE] for each in instantiate(campaign).configurations]
    assert found == [0.1 + number / 1e6, 0.2 + number / 1e6]


def instantiated(file, number):
    """Instantiate by the Python API, with a store of its own."""
    from vastflow.flows import instantiate

    found = instantiate(file, store=file.parent / f"store-{threading.get_ident()}", workers=1)
    assert len(found.names) == 2 and not found.faults, repr(found)


def run(file, number):
    """Run by the Python API, with a store of its own."""
    from vastflow.flows import run_campaign

    own = file.parent / f"own-{threading.get_ident()}"
    found = run_campaign(file, store=own / "store", results=own / "results", workers=1)
    assert found.summary.passed == 2, found.summary


def raised(call):
    """Return the error that a call raises."""
    try:
        call()
    except BaseException as error:  # noqa: BLE001 - it is what is looked for
        return error
    return None


def in_threads(calls):
    with ThreadPoolExecutor(len(calls)) as pool:
        return list(pool.map(raised, calls))


def by_to_thread(calls):
    async def gathered():
        return await asyncio.gather(*(asyncio.to_thread(raised, call) for call in calls))

    return asyncio.run(gathered())


def in_prefect_tasks(calls):
    from prefect import flow, task
    from prefect.cache_policies import NO_CACHE

    @flow(name="calls")
    def several():
        one = task(raised, name="call", cache_policy=NO_CACHE)
        return [each.result() for each in [one.submit(call) for call in calls]]

    return several()


WAYS = {"threads": in_threads, "asyncio.to_thread": by_to_thread, "Prefect tasks": in_prefect_tasks}


def failures(place, call, way, rounds):
    """Count each failure."""
    met = Counter()
    for number in range(rounds):
        folder = place / str(number)
        folder.mkdir()
        for name, text in {**FILES, "first.vast": CAMPAIGN, "second.vast": CAMPAIGN}.items():
            (folder / name).write_text(text.replace("NUMBER_HERE", str(number)))
        calls = [partial(call, folder / ("first.vast", "second.vast")[i % 2], number) for i in range(AT_ONCE)]
        for error in filter(None, way(calls)):
            met[f"{type(error).__name__}: {' '.join(str(error).replace(str(folder), '').split())[:300]}"] += 1
    return met


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", type=int, default=200, help="Of each way.")
    parser.add_argument("--api", type=int, default=0, help="Of each way, and of each function of the Python API.")
    asked = parser.parse_args()
    wrong = 0
    for call, wanted in ((read, asked.calls), (instantiated, asked.api), (run, asked.api)):
        for name, way in WAYS.items() if wanted else ():
            with tempfile.TemporaryDirectory(prefix="vastflow-threads-") as folder:
                met = failures(Path(folder), call, way, rounds := -(-wanted // AT_ONCE))
            print(f"{call.__name__:12} {name:18} {met.total()} of {rounds * AT_ONCE} calls failed", flush=True)
            for said, count in met.most_common():
                print(f"    {count} × {said}", flush=True)
            wrong += met.total()
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
