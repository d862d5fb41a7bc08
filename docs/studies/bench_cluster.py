"""Measure how busy the workers of a Dask cluster are: units that sleep, through the executor of campaigns.

Four worker processes have all slots as threads, which a real cluster has not: a unit that sleeps needs no processor. Durations are
log-uniform from 1 to 20, with a mean of a second; a family has those of one size. Efficiency is the time that all units take on
that many slots without a gap, divided by the time that they took.
"""

import json
import random
import tempfile
import time
from concurrent.futures import Future
from contextlib import closing
from pathlib import Path
from typing import Any

import pandas as pd
from distributed.deploy.subprocess import SubprocessCluster
from missions import parser_of

from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.engine.dask_cluster import DaskCluster
from vastflow.tasks.engine.executor import Priority
from vastflow.tasks.engine.index import ConfigurationRuns
from vastflow.tasks.engine.pool import Pool
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.engine.units import Feeder
from vastflow.tasks.store.store import open_store

MOST_PROCESSES = 4
SPREAD = 20.0
SIZES = 10
START_S = 120.0


def durations_s(slots: int, ideal_s: float) -> list[float]:
    """Return durations that `slots` do in `ideal_s`."""
    rng = random.Random(slots)
    drawn = [SPREAD ** rng.random() for _ in range(int(slots * ideal_s))]
    return [each * ideal_s * slots / sum(drawn) for each in drawn]


def measured(slots: int, ideal_s: float, folder: Path) -> dict[str, Any]:
    """Return what a cluster of this many slots took for the units."""
    workers = next(each for each in range(MOST_PROCESSES, 0, -1) if slots % each == 0)
    threads = {"n_workers": workers, "threads_per_worker": slots // workers, "worker_kwargs": {"memory_limit": 0}}
    with (
        SubprocessCluster(**threads, dashboard_address=None) as processes,
        closing(DaskCluster(processes.scheduler_address, open_store(folder / "store"), Pool(1), Tally())) as cluster,
    ):
        cluster.submit(time.sleep, 0.0, priority=Priority.EXECUTE).result(START_S)
        sleeps_s = durations_s(slots, ideal_s)
        began_s, before_s = time.monotonic(), time.process_time()

        def submit(configuration: ConfigurationRuns, start: int, stop: int) -> "Future[Any]":
            sleep_s = float(configuration.name)
            done = cluster.submit(time.sleep, sleep_s, priority=Priority.EXECUTE)
            done.add_done_callback(lambda _: feeder.took(configuration.family, 1, sleep_s))
            return done

        feeder = Feeder(lambda: cluster.workers, submit)
        nothing = Scenario("builtin:navigate_to_pose", 1.0, {}, {}, {})
        wanted = [
            (ConfigurationRuns(repr(each), f"{SIZES * each / max(sleeps_s):.0f}", 1, nothing, 1), [0])
            for each in sleeps_s
        ]
        for units in feeder.add(wanted):
            for unit in units.wait():
                unit.future.result()
        wall_s, cpu_s = time.monotonic() - began_s, time.process_time() - before_s
    return {
        "slots": slots,
        "units": len(sleeps_s),
        "wall_s": round(wall_s, 2),
        "efficiency": round(sum(sleeps_s) / slots / wall_s, 3),
        "driver_cpu_ms_per_unit": round(1000 * cpu_s / len(sleeps_s), 2),
    }


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--slots", type=int, nargs="+", default=[10, 20, 50, 100])
    parser.add_argument("--seconds", type=float, default=30.0, help="time that all units take without a gap")
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="vastflow-cluster-") as folder:
        found = [measured(slots, asked.seconds, Path(folder)) for slots in asked.slots]
    print(json.dumps(found) if asked.json else pd.DataFrame(found).to_string(index=False))


if __name__ == "__main__":
    main()
