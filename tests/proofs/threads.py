"""Several calls at once in one process come to what one call alone comes to: in threads, by `asyncio.to_thread`, in Prefect tasks.

Each round writes two campaign files anew that share a producer, its helper, an oracle, a notebook and a scenario file, so that nothing
of them is loaded yet, and begins several calls together. A call reads one of the files and instantiates it. Those of `--api` are
`instantiate` and `run_campaign`, each with a store of its own and Prefect's API. Prints a line for each way, and one for each kind of
failure; exit code 1 where a call failed, or gave something else.

    python tests/proofs/threads.py [--calls N] [--api N]
"""

import argparse
import asyncio
import json
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image

AT_ONCE: Final = 4

LOADED: Final = """
import time
time.sleep(0.02)  # as a plug-in that imports large libraries
from helper import NUMBER
"""

FILES: Final = {
    "helper.py": "import time\ntime.sleep(0.02)\nNUMBER = {number}\n",
    "noise.txt": "0.1 0.2",
    "own.py": LOADED
    + """
from pathlib import Path
from vastflow.oracles.oracle import Oracle
from vastflow.oracles.oracle import Parameters as OracleParameters
from vastflow.producers.configuration import Fragment
from vastflow.producers.producer import Parameters, Producer

class Own(Producer[Parameters]):
    Parameters = Parameters
    reads = ()
    writes = {{"laserscan_gaussian_noise_std_deviation": "system"}}
    files = ["noise.txt"]

    def produce(self, inputs, draws):
        for line in (Path(__file__).parent / "noise.txt").read_text().split():
            time.sleep(0.01)
            yield Fragment({{"laserscan_gaussian_noise_std_deviation": float(line) + NUMBER / 1e6}})

class Judge(Oracle[OracleParameters]):
    Parameters = OracleParameters

    def judge(self, trace, situation):
        return self.passed(trace)
""",
    "own.osc": """
import osc.nav2
import osc.ros

scenario number_{number}:
    start_pose: pose_3d
    goal_pose: pose_3d
    robot: differential_drive_robot
    do serial:
        robot.init_nav2(start_pose)
        robot.nav_to_pose(goal_pose)
""",
    "room.yaml": "{{image: room.pgm, resolution: 0.05, origin: [0.0, 0.0, 0.0]}}",
}

CAMPAIGN: Final = """
version: 1
metadata: {{name: {name}-{number}}}
configuration:
  - name: room
    parameters:
      - map_file: room.yaml
      - start_pose: {{x: 1.0, y: 1.0, yaw: 0.0}}
      - goal_pose: {{x: 1.5, y: 1.0, yaw: 0.0}}
    variations:
      - own.py:Own: {{}}
execution:
  scenario_file: own.osc
  runs: 1
evaluation:
  oracles: [own.py:Judge, own.ipynb]
"""

CELL: Final = "from helper import NUMBER\nverdicts = [{'run_index': i, 'judgement': 'pass'} for i in runs['run_index'].to_pylist()]"


def written(folder: Path, number: int) -> list[Path]:
    """Two campaign files whose plug-ins no process has loaded."""
    folder.mkdir()
    cells = np.full((60, 60), 254, dtype=np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 0
    Image.fromarray(cells).save(folder / "room.pgm")
    cell = {"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": CELL}
    (folder / "own.ipynb").write_text(json.dumps({"cells": [cell], "metadata": {}, "nbformat": 4, "nbformat_minor": 5}))
    for name, text in FILES.items():
        (folder / name).write_text(text.format(number=number))
    files = [folder / "first.vast", folder / "second.vast"]
    for file in files:
        file.write_text(CAMPAIGN.format(name=file.stem, number=number))
    return files


def read(file: Path, number: int) -> None:
    """Read a campaign and instantiate it in this thread."""
    from vastflow.flows.request.campaign_file import read_campaign
    from vastflow.producers.instantiate import instantiate

    campaign, oracles = read_campaign(file)
    found = [
        each.scenario.system["laserscan_gaussian_noise_std_deviation"] for each in instantiate(campaign).configurations
    ]
    expected = [0.1 + number / 1e6, 0.2 + number / 1e6]
    if found != expected or len(oracles) != 3:
        raise AssertionError(f"expected {expected} and 3 oracles, got {found} and {len(oracles)}")


def instantiated(file: Path, number: int) -> None:
    """Instantiate by the Python API."""
    from vastflow.flows import instantiate

    found = instantiate(file, store=file.parent / f"store-{threading.get_ident()}", workers=1)
    if len(found.names) != 2 or found.faults:
        raise AssertionError(f"expected 2 configurations, got {found!r}")


def run(file: Path, number: int) -> None:
    """Run by the Python API."""
    from vastflow.flows import run_campaign

    own = file.parent / f"own-{threading.get_ident()}"
    found = run_campaign(file, store=own / "store", results=own / "results", workers=1)
    if found.summary.passed != 2:
        raise AssertionError(f"expected 2 passed runs, got {found.summary}")


def in_threads(calls: Sequence[Callable[[], None]]) -> list[BaseException | None]:
    """What each call raised, all begun together in threads."""
    together = threading.Barrier(len(calls))

    def begun(call: Callable[[], None]) -> BaseException | None:
        together.wait()
        return raised(call)

    with ThreadPoolExecutor(len(calls)) as pool:
        return list(pool.map(begun, calls))


def by_to_thread(calls: Sequence[Callable[[], None]]) -> list[BaseException | None]:
    """As `in_threads`, by an event loop."""

    async def gathered() -> list[BaseException | None]:
        return await asyncio.gather(*(asyncio.to_thread(raised, call) for call in calls))

    return asyncio.run(gathered())


def in_prefect_tasks(calls: Sequence[Callable[[], None]]) -> list[BaseException | None]:
    """As `in_threads`, by tasks of one flow run."""
    from prefect import flow, task
    from prefect.cache_policies import NO_CACHE

    one = task(raised, name="call", cache_policy=NO_CACHE)

    @flow(name="calls")
    def several() -> list[BaseException | None]:
        return [each.result() for each in [one.submit(call) for call in calls]]

    return several()


def raised(call: Callable[[], None]) -> BaseException | None:
    """What a call raised."""
    try:
        call()
    except BaseException as error:  # noqa: BLE001 - it is what is looked for
        return error
    return None


WAYS: Final = {"threads": in_threads, "asyncio.to_thread": by_to_thread, "Prefect tasks": in_prefect_tasks}


def failures(place: Path, call: Callable[[Path, int], None], way: Callable[[Any], Any], rounds: int) -> Counter[str]:
    """How often each failure was met."""
    met: Counter[str] = Counter()
    for number in range(rounds):
        files = written(place / str(number), number)
        calls = [partial(call, files[i % len(files)], number) for i in range(AT_ONCE)]
        for error in way(calls):
            if error is not None:
                met[
                    f"{type(error).__name__}: {' '.join(str(error).replace(str(files[0].parent), '').split())[:300]}"
                ] += 1
    return met


def main() -> int:
    """Print the proof."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", type=int, default=200, help="Of each way.")
    parser.add_argument("--api", type=int, default=0, help="Calls of each way and function of the Python API.")
    asked = parser.parse_args()
    wrong = 0
    for call, wanted in ((read, asked.calls), (instantiated, asked.api), (run, asked.api)):
        for name, way in WAYS.items():
            rounds = -(-wanted // AT_ONCE)
            if rounds:
                with tempfile.TemporaryDirectory(prefix="vastflow-threads-") as folder:
                    met = failures(Path(folder), call, way, rounds)
                print(f"{call.__name__:12} {name:18} {met.total()} of {rounds * AT_ONCE} calls failed", flush=True)
                for said, count in met.most_common():
                    print(f"    {count} × {said}", flush=True)
                wrong += met.total()
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
