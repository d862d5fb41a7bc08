"""kill -9 at random points of a campaign: nothing is lost, nothing is other, and only what was in flight is executed twice.

A campaign without a robot is run once undisturbed. Then, for each point, it is run anew with an empty store, one of its
processes is killed at a random time, and it is run or resumed to its end. Victims: the flow's process, a worker process of its
pool, the embedded API server; with `--server` the campaign has an API configured, and the server is a real `prefect server
start`, which comes back at once, after 5 s, or when the campaign has ended; with `--pool` workers of a work pool execute the
runs, and victims are they (`crew`), the processes of their flow runs (`shard`), and both of one at once (`pair`) too. Points
are spread over the whole time a victim is there.

At each point, afterwards:

- every run is in `runs.parquet` exactly once, and every file of the campaign directory is byte by byte that of the undisturbed
  campaign, but for what says when and how it was computed (`logs/`, `metadata.json`, one section of the report);
- every artifact in the store is sound, and equal to that of the undisturbed campaign under the same key;
- what was executed twice had begun and not ended when its process died, and is not more than there are workers;
- no process of the campaign is left after 10 s, no half directory is taken for a whole one, no flow run is left `Running`
  in Prefect's database but those that the ledger has for the next call; what killed writers leave is swept after a day.

Executions are counted from outside: `sitecustomize` wraps the function that workers call, and writes a line to a file when a
block begins, for each run, and when the block is stored. The code under test is a copy made at the start, so that an edit of
the checkout does not change it meanwhile.

Prints a line for each point and the figures; exit code 1 when something is violated.

    python tests/proofs/killed.py [--seed N] [--points N] [--victim KIND] [--server | --pool] [--json]
"""

import argparse
import contextlib
import functools
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import psutil
import pyarrow.parquet as pq
from killed_life import CONFIGURATIONS, ENDS_S, RUNS, WORKERS, Api, Crew, Lab, Life, Place
from killed_outcome import Whole, differing, digests, open_flow_runs, stored

from vastflow.flows.results.directory import ABANDONED_S, sweep
from vastflow.tasks.local_store import open_local_store
from vastflow.tasks.store import WRITING_S

AGAIN = 3
ORPHANS_S = 10.0
STARTING, REPORTING = 0.2, 0.8
"""Shares of the points that are before execution, and that are not after it."""
REPORT = CONFIGURATIONS + 1
REPORTING_S = 0.5
"""So long the campaign directory is written."""
BACK_S = (0.0, 5.0, ENDS_S)
"""A configured API that was killed comes back after so long, by the number of the point; the last is never."""
VICTIMS = ("flow", "worker", "server")
OF_A_POOL = ("flow", "server", "crew", "shard", "pair")
OF_A_CREW = ("crew", "shard", "pair")


@dataclass
class Point:
    """What one kill came to.

    Attributes:
        at_s: Not before this time after the start.
        blocks: Nor before so many blocks are executed; `REPORT`: before the campaign directory is begun.
        aimed_s: And so long after that.
        cut: Runs that had begun and not ended, by scenario digest and run index.
        load: Of the machine, in the minute before the kill.
        back_s: How long (s) a configured API was away; -1 until the campaign had ended.
    """

    victim: str
    number: int
    at_s: float
    blocks: int = 0
    aimed_s: float = 0.0
    phase: str = ""
    load: float = 0.0
    exit_code: int | None = None
    back_s: float = 0.0
    after_s: float = 0.0
    how: str = ""
    resumed: int = 0
    cut: set[tuple[str, int]] = field(default_factory=set)
    executed_twice: int = 0
    violations: list[str] = field(default_factory=list)


def undisturbed(lab: Lab, twice: bool = True) -> tuple[Whole, dict[str, tuple[float, float]]]:
    """The campaign alone: what it comes to, and when each victim was there before anything was executed (s).

    Args:
        twice: The first life makes Prefect's database and compiles kernels, which is not what is to be measured.
    """
    place = Place(lab, "first")
    there = _watched(place)
    shutil.copytree(place.folder / "prefect", lab.home, ignore=shutil.ignore_patterns("storage"))
    whole = Whole(digests(place.directories()[0]), stored(open_local_store(place.store)))
    if twice:
        place = Place(lab, "second")
        there = _watched(place)
        if difference := differing(whole.files, digests(place.directories()[0])):
            raise RuntimeError(f"two undisturbed campaigns differ: {difference}")
    return whole, there


def _watched(place: Place) -> dict[str, tuple[float, float]]:
    life = place.begin()
    there: dict[str, tuple[float, float]] = {}
    while life.process.poll() is None:
        for kind in VICTIMS:
            if life.phase() == "starting" and life.victims(kind):
                now_s = life.elapsed_s
                there[kind] = (there.get(kind, (now_s,))[0], now_s)
        time.sleep(0.05)
    if (code := life.end()) != 0:
        raise RuntimeError(f"the undisturbed campaign ended with {code}: {life.words()[-2000:]}")
    return there


def killed(
    lab: Lab, point: Point, rng: random.Random, whole: Whole, api: Api | None = None, with_pool: bool = False
) -> None:
    """Run the campaign, kill one process of it, go on to the end, and look at everything."""
    with contextlib.ExitStack() as crews:
        place = _died_and_gone_on(lab, point, rng, api, with_pool, crews)
    _left(place, point)
    _check(place, point, whole)
    running = open_flow_runs(api.database if api else place.database, place.ledger if api is None else None)
    if running:
        point.violations.append(f"flow runs in Prefect's database: {', '.join(running)}")


def _died_and_gone_on(
    lab: Lab, point: Point, rng: random.Random, api: Api | None, with_pool: bool, crews: contextlib.ExitStack
) -> Place:
    """All of a point but the looking; gives where it happened.

    Args:
        crews: Gets what ends the workers of a pool.
    """
    for again in range(AGAIN):
        place = Place(lab, f"{point.victim}-{point.number}-{again}", api.url if api else None, with_pool)
        crew = Crew(place) if with_pool else None
        if crew:
            crews.callback(crew.stop)
        life = place.begin()
        if struck := _struck(life, point, rng, api, crew):
            break
        point.at_s, point.aimed_s = (
            0.5 * point.at_s,
            0.3 * point.aimed_s,
        )  # the machine is faster now than when the time was chosen
        crews.close()
    if not struck:
        point.violations.append("the campaign ended before each time")
    else:
        killed_s, point.load = time.monotonic(), os.getloadavg()[0]
        back_s = BACK_S[point.number % len(BACK_S)] if api and point.victim == "server" else 0.0
        point.back_s = back_s if back_s < ENDS_S else -1.0
        if api and point.victim == "server" and back_s < ENDS_S:
            time.sleep(back_s)
            api.start()
        if crew:
            crew.complete()
        point.exit_code = life.end()
        point.after_s = time.monotonic() - killed_s
        if back_s == ENDS_S and api:
            api.start()
        _judge_end(life, point)
    if crew is None:
        _left(place, point)
    point.cut = interrupted(place.trace())
    halves = list(place.results.glob(".*.partial"))
    if point.exit_code != 0:
        _go_on(place, point, halves, rng)
    elif api:  # Prefect hears of what it missed at the next call
        _go_on(place, point, (), rng)
    return place


def _struck(life: Life, point: Point, rng: random.Random, api: Api | None, crew: Crew | None) -> bool:
    """Kill a process once the time has come, or as soon as there is one after that; False if the campaign ended before."""
    struck = False
    while life.process.poll() is None:
        if life.elapsed_s >= point.at_s:
            if not life.has_executed(point.blocks) or (point.blocks == REPORT and life.phase() != "reporting"):
                time.sleep(0.002)
                continue
            time.sleep(point.aimed_s)
            point.phase = life.phase()
            if api and point.victim == "server":
                api.kill()
                return True
            if point.victim in OF_A_CREW:
                there = crew.victims(point.victim) if crew else []
            else:
                there = [[each] for each in life.victims(point.victim)]
            with contextlib.suppress(psutil.NoSuchProcess):  # it ended just now: another, if there still is one
                for process in rng.choice(there) if there else ():
                    process.kill()
                    struck = True
            if struck:
                return True
        time.sleep(0.005)
    return False


def _judge_end(life: Life, point: Point) -> None:
    """What may happen to the flow: it dies with its own death, and outlives that of a worker or of its server."""
    if point.exit_code is None:
        point.violations.append(f"hangs: {life.words()[-300:]}")
        life.process.kill()
        life.end()
    elif point.victim == "flow":
        if point.exit_code not in (-signal.SIGKILL, 0):
            point.violations.append(f"the killed flow ended with {point.exit_code}")
    elif point.exit_code not in (0, 3):
        point.violations.append(f"ended with {point.exit_code}: {life.words()[-300:]}")
    elif point.exit_code == 3 and "again computes only what is missing" not in life.words():
        point.violations.append(f"does not say how to go on: {life.words()[-300:]}")
    if "Traceback" in life.words():
        point.violations.append("a traceback on the terminal")
    point.how = {None: "hung", 0: "completed", 3: "gave up", -signal.SIGKILL: "died"}.get(point.exit_code, "ended")


def _left(place: Place, point: Point) -> None:
    """Look for processes that are still there some time after the end."""
    deadline = time.monotonic() + ORPHANS_S
    while (there := place.marked()) and time.monotonic() < deadline:
        time.sleep(0.1)
    names = []
    for process in there:
        with contextlib.suppress(psutil.Error):
            names.append(" ".join(process.cmdline())[:80])
            process.kill()
    if names:
        point.violations.append(f"left running: {', '.join(names)}")


def _go_on(place: Place, point: Point, halves: Sequence[Path], rng: random.Random) -> None:
    """Run the campaign again, or resume a half written directory where there is one, until it ends."""
    arguments: tuple[str, ...] = ()
    if halves and (halves[0] / "metadata.json").is_file() and rng.random() < 0.5:
        arguments = ("resume", str(halves[0]))
        point.resumed = 1
    life = place.begin(*arguments)
    if (code := life.end()) != 0:
        life.process.kill()
        point.violations.append(f"going on ended with {code}: {life.words()[-300:]}")


def interrupted(trace: Sequence[Mapping[str, Any]]) -> set[tuple[str, int]]:
    """Scenario digest and run index of all runs whose block began and never ended: they were in flight."""
    begun = [row for row in trace if row["what"] == "begin"]
    ended = {(row["pid"], row["key"], row["start"]) for row in trace if row["what"] == "end"}
    return {
        (row["key"], run_index)
        for row in begun
        if (row["pid"], row["key"], row["start"]) not in ended
        for run_index in range(row["start"], row["stop"])
    }


def _check(place: Place, point: Point, whole: Whole) -> None:
    say = point.violations.append
    directories = place.directories()
    if not directories:
        say("no campaign directory")
    for directory in directories:
        if difference := differing(whole.files, digests(directory)):
            say(f"{directory.name}: {difference}")
        rows = pq.read_table(directory / "runs.parquet", columns=["configuration", "run_index"]).to_pylist()
        runs = Counter((row["configuration"], row["run_index"]) for row in rows)
        if len(runs) != CONFIGURATIONS * RUNS or set(runs.values()) != {1}:
            say(
                f"{directory.name}: {len(runs)} of {CONFIGURATIONS * RUNS} runs, at most {max(runs.values(), default=0)} times"
            )

    executed = Counter((row["key"], row["start"]) for row in place.trace() if row["what"] == "run")
    twice = {run for run, times in executed.items() if times > 1}
    point.executed_twice = len(twice)
    if len(executed) != CONFIGURATIONS * RUNS:
        say(f"{len(executed)} of {CONFIGURATIONS * RUNS} runs were executed")
    if not twice <= point.cut:
        say(f"{len(twice - point.cut)} runs were executed twice that were not in flight")
    if len({scenario for scenario, _ in twice}) > WORKERS:
        say(f"runs of {len({scenario for scenario, _ in twice})} configurations were executed twice")

    store = open_local_store(place.store)
    faults = {holding.key: store.fault(holding.key) for holding in store.holdings()}
    if damaged := [f"{key}: {fault}" for key, fault in faults.items() if fault]:
        say(f"{len(damaged)} artifacts are damaged, {damaged[0]}")
    other = [key for key, content in stored(store).items() if whole.artifacts.get(key, content) != content]
    if other:
        say(f"{len(other)} artifacts differ, {other[0]}")

    _age(place.store / "temporary", WRITING_S)
    _age(place.results, ABANDONED_S)
    open_local_store(place.store)
    sweep(place.results)
    if rest := [*(place.store / "temporary").iterdir(), *place.results.glob(".*")]:
        say(f"not swept: {rest[0]}")


def _age(folder: Path, by_s: float) -> None:
    then = time.time() - by_s - 60
    for path in [*folder.rglob("*"), folder]:
        os.utime(path, (then, then))


def points(seed: int, number: int, victims: Sequence[str], there: Mapping[str, tuple[float, float]]) -> Iterator[Point]:
    """Points spread over what a campaign does, one in each of as many equal parts, in random order.

    A fifth while it starts, by the clock; three fifths while it executes, by how much is executed; and a fifth after that.
    """
    rngs = {victim: random.Random(f"{seed} {victim}") for victim in victims}
    parts = {victim: rngs[victim].sample(range(number), number) for victim in victims}
    for k in range(number):
        for victim in victims:
            rng, (first_s, last_s) = rngs[victim], there[victim]
            share = (parts[victim][k] + rng.random()) / number
            if share < STARTING:
                yield Point(victim, k, first_s + share / STARTING * (last_s - first_s))
            elif share < REPORTING or victim in ("shard", "pair"):
                share = min(share, REPORTING - 0.05)
                blocks = int((share - STARTING) / (REPORTING - STARTING) * CONFIGURATIONS)
                yield Point(victim, k, 0.0, blocks, rng.uniform(0.0, 0.2))
            elif victim == "flow":
                yield Point(victim, k, 0.0, REPORT, rng.uniform(0.0, REPORTING_S))
            else:
                yield Point(victim, k, 0.0, CONFIGURATIONS, rng.uniform(0.0, 1.0))


HEADER = (
    f"{'victim':7} {'no':>3} {'at (s)':>6} {'blocks':>6} {'phase':13} {'then':12} {'for (s)':>7} {'':6} {'twice':>5}"
)


def line(point: Point) -> str:
    """A point in a line of the table."""
    judged = "; ".join(point.violations) or "ok"
    return (
        f"{point.victim:7} {point.number:3} {point.at_s:6.1f} {point.blocks:6} {point.phase:13} {point.how:12} {point.after_s:7.1f} "
        f"{'resume' if point.resumed else '':6} {point.executed_twice:5}  {judged}"
    )


def as_json(seed: int, done: Sequence[Point]) -> str:
    """All that is known of points."""
    told = [{**asdict(point), "cut": len(point.cut)} for point in done]
    return json.dumps({"seed": seed, "violated": sum(bool(point.violations) for point in done), "points": told})


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--points", type=int, default=30, help="of each victim")
    parser.add_argument(
        "--victim", action="append", choices=sorted({*VICTIMS, *OF_A_POOL}), help="this one alone; may be repeated"
    )
    parser.add_argument("--server", action="store_true", help="with a configured API, a real Prefect server")
    parser.add_argument("--pool", action="store_true", help="runs by workers of a work pool, at a real Prefect server")
    parser.add_argument(
        "--folder", type=Path, help="where all is made and kept, `points.json` too; else a temporary folder"
    )
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))  # so that servers and workers are ended
    folder = options.folder or Path(tempfile.mkdtemp(prefix="vastflow-killed-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        show = (lambda text: None) if options.json else functools.partial(print, flush=True)
        victims = options.victim or (OF_A_POOL if options.pool else VICTIMS)
        done = proven(folder, options.seed, options.points, victims, options.server or options.pool, options.pool, show)
    finally:
        if options.folder is None:
            shutil.rmtree(folder, ignore_errors=True)
    bad = sum(bool(point.violations) for point in done)
    twice = sum(point.executed_twice for point in done)
    if options.json:
        print(as_json(options.seed, done))
    else:
        print(f"{len(done)} points, {bad} with a violation; {twice} runs executed twice")
    return 1 if bad else 0


def proven(
    folder: Path,
    seed: int,
    number: int,
    victims: Sequence[str],
    with_server: bool,
    with_pool: bool,
    show: Callable[[str], None],
) -> list[Point]:
    """All points, in order."""
    lab = Lab.made(folder)
    whole, there = undisturbed(lab, twice=not with_pool)
    show("; ".join(f"{victim} from {first:.1f} to {last:.1f} s" for victim, (first, last) in there.items()))
    show(HEADER)
    api = Api(folder / "api", lab.home) if with_server else None
    done = []
    try:
        if api:
            api.start()
        if api and with_pool:
            api.make_pool()
            place = Place(lab, "pooled", api.url, pool=True)
            crew = Crew(place)
            there = dict.fromkeys(OF_A_POOL, _watched(place)["flow"])
            crew.stop()
        for point in points(seed, number, victims, there):
            killed(lab, point, random.Random(f"{seed} {point.victim} {point.number}"), whole, api, with_pool)
            show(line(point))
            done.append(point)
            (folder / "points.json").write_text(as_json(seed, done))
            if not point.violations:
                for again in range(AGAIN):
                    shutil.rmtree(folder / f"{point.victim}-{point.number}-{again}", ignore_errors=True)
    finally:
        if api:
            api.kill()
    return done


if __name__ == "__main__":
    raise SystemExit(main())
