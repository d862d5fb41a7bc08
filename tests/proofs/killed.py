"""Kill and pause processes at random points of a campaign, and check that nothing is lost or changed.

A campaign, with `--robot` one in which a robot drives, is run once undisturbed. Then, for each point, it is run anew with an
empty store, one of its processes is killed at a random time, and it is run or resumed to its end. One call kills in four
settings, unless fewer are named: Prefect's API embedded; that with `--cluster local:2`; a real `prefect server start`, which comes
back at once, after 5 s, or when the campaign has ended; and with that server a Dask cluster, whose workers execute the runs.
`killed_points.py` has the victims, and how points are spread over the time that a victim is there.

At each point, afterwards:

- every run is in `runs.parquet` exactly once, and every file of the campaign directory is byte by byte that of the undisturbed
  campaign, but for what says when and how it was computed (`logs/`, `metadata.json`, one section of the report);
- every artifact in the store is sound, and equal to that of the undisturbed campaign under the same key;
- what was executed twice had begun and not ended when its process died, and is not more than there are workers;
- no process of the campaign is left after 10 s, no half directory is taken for a whole one, no flow run is left `Running`
  in Prefect's database but those that the next flow run will mark as crashed; what killed writers leave is swept after a day.

Executions are counted from outside: `sitecustomize` wraps the function that workers call, and writes a line to a file when a
block begins, for each run, and when the block is stored. The code under test is a copy made at the start, so that an edit of
the checkout does not change it meanwhile.

Prints a line for each point and the figures; exit code 1 when something is violated.

    python tests/proofs/killed.py [--seed N] [--points N] [--setting SETTING] [--victim KIND] [--robot] [--json]
"""

import argparse
import contextlib
import functools
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import psutil
import pyarrow.parquet as pq
from killed_life import CONFIGURATIONS, ENDS_S, RUNS, WORKERS, Api, Crew, Lab, Life, Place
from killed_outcome import Whole, differing, digests, open_flow_runs, stored
from killed_points import (
    BACK_S,
    HEADER,
    IN_FLIGHT,
    OF_A_CREW,
    PAUSE_S,
    REPORT,
    VICTIMS,
    Point,
    Setting,
    as_json,
    kinds_of,
    line,
    points,
    totals,
)

from vastflow.flows.results.directory import ABANDONED_S, sweep
from vastflow.tasks.store.store import WRITING_S, open_store

AGAIN = 3
ORPHANS_S = 10.0


def undisturbed(lab: Lab, twice: bool = True) -> tuple[Whole, dict[str, tuple[float, float]]]:
    """Run the campaign undisturbed; return its results, and when each victim was there before any execution (s).

    Args:
        twice: The first life makes Prefect's database and compiles kernels, which is not what is to be measured.
    """
    place = Place(lab, "first")
    there = watched(place)
    shutil.copytree(place.folder / "prefect", lab.home, ignore=shutil.ignore_patterns("storage"))
    whole = Whole(digests(place.directories()[0]), stored(open_store(place.store)))
    if twice:
        place = Place(lab, "second")
        there = watched(place)
        if difference := differing(whole.files, digests(place.directories()[0])):
            raise RuntimeError(f"two undisturbed campaigns differ: {difference}")
    return whole, there


def watched(place: Place) -> dict[str, tuple[float, float]]:
    """When each victim is there in a life that nothing happens to, before anything is executed (s)."""
    life = place.begin()
    there: dict[str, tuple[float, float]] = {}
    while life.goes_on:
        for kind in VICTIMS["embedded"]:
            if life.phase() == "starting" and life.victims(kind):
                now_s = life.elapsed_s
                there[kind] = (there.get(kind, (now_s,))[0], now_s)
        time.sleep(0.05)
    if (code := life.end()) != 0:
        raise RuntimeError(f"the undisturbed campaign ended with {code}: {life.words()[-2000:]}")
    return there


def killed(lab: Lab, point: Point, rng: random.Random, whole: Whole, api: Api | None = None) -> None:
    """Run the campaign, kill one process of it, go on to the end, and look at everything."""
    with contextlib.ExitStack() as crews:
        place = _died_and_gone_on(lab, point, rng, api, crews)
    _left(place, point)
    _check(place, point, whole)
    running = open_flow_runs(api.database if api else place.database, with_orphans=False)
    if running:
        point.violations.append(f"flow runs in Prefect's database: {', '.join(running)}")


def _died_and_gone_on(
    lab: Lab, point: Point, rng: random.Random, api: Api | None, crews: contextlib.ExitStack
) -> Place:
    """All of a point but the looking; gives where it happened.

    Args:
        crews: Gets what ends the cluster.
    """
    for again in range(AGAIN):
        name = f"{re.sub(r'[ /]', '-', point.kind)}-{point.number}-{again}"
        place = Place(lab, name, api.url if api else None, point.setting)
        crew = Crew(place) if point.setting == "cluster" else None
        if crew:
            crews.callback(crew.stop)
        life = place.begin()
        if struck := _struck(life, point, rng, api, crew):
            break
        point.earlier()
        crews.close()
    if not struck:
        point.violations.append("the campaign ended before each time")
    else:
        _outlived(life, point, api, crew)
    if crew is None:
        _left(place, point)
    halves = list(place.results.glob(".*.partial"))
    if point.exit_code != 0:
        _go_on(place, point, halves, rng)
    elif api:  # Prefect hears of what it missed at the next call
        _go_on(place, point, (), rng)
    return place


def _outlived(life: Life, point: Point, api: Api | None, crew: Crew | None) -> None:
    """Wait for the end of a life in which something was just killed, and bring back what watchers would."""
    killed_s, point.load = time.monotonic(), os.getloadavg()[0]
    of_server = api is not None and point.victim == "server"
    back_s = BACK_S[point.number % len(BACK_S)] if of_server else 0.0
    point.back_s = back_s if back_s < ENDS_S else -1.0
    if api and of_server and back_s < ENDS_S:
        time.sleep(back_s)
        api.start()
    if crew and not point.is_pause:
        crew.complete(point.victim)
    point.exit_code = life.end()
    point.after_s = time.monotonic() - killed_s
    if api and back_s == ENDS_S:
        api.start()
    _judge_end(life, point)


def _struck(life: Life, point: Point, rng: random.Random, api: Api | None, crew: Crew | None) -> bool:
    """Kill a process at the given time or soon after it; False if the campaign had ended."""
    while life.goes_on and not _has_come(life, point):
        time.sleep(0.002)
    time.sleep(point.aimed_s)
    while life.goes_on:
        point.phase = life.phase()
        if api and point.victim == "server":
            api.kill()
            return True
        there = _doomed(life, point, crew)
        struck = False
        with contextlib.suppress(psutil.NoSuchProcess):  # it ended just now: another, if there still is one
            for process in rng.choice(there) if there else ():
                if point.is_pause:
                    process.suspend()
                    threading.Timer(PAUSE_S, process.resume).start()
                else:
                    process.kill()
                struck = True
        if struck:
            return True
        time.sleep(0.005)
    return False


def _has_come(life: Life, point: Point) -> bool:
    if life.elapsed_s < point.at_s or not life.has_executed(point.blocks):
        return False
    return point.blocks != REPORT or life.phase() == "reporting"


def _doomed(life: Life, point: Point, crew: Crew | None) -> list[list[psutil.Process]]:
    """Groups of processes of which one is to be killed, if there are any now."""
    if crew is None or point.process_kind not in OF_A_CREW:
        return [[each] for each in life.victims(point.process_kind)]
    there = crew.victims(point.process_kind)
    if point.victim not in IN_FLIGHT:
        return there
    busy = {row["pid"] for row in life.place.begun()}
    return [group for group in there if busy & descendants(group[0])]


def descendants(process: psutil.Process) -> set[int]:
    """Process numbers of all that a process started, and what that started."""
    with contextlib.suppress(psutil.Error):
        return {child.pid for child in process.children(recursive=True)}
    return set()


_OF_THE_SERVER = {0: "pages do not show the end", 3: "start it (`prefect server start`)"}
"""Message about a server that stays away, by the campaign's exit code."""


def _judge_end(life: Life, point: Point) -> None:
    """Return the flow's allowed outcomes: it ends if it was killed itself, and else goes on."""
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
    elif point.back_s < 0 and point.phase == "executing" and _OF_THE_SERVER[point.exit_code] not in life.words():
        point.violations.append(f"does not say that Prefect's server was gone: {life.words()[-300:]}")
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
        arguments = ("run", str(halves[0]))
        point.resumed = 1
    life = place.begin(*arguments)
    if (code := life.end()) != 0:
        life.process.kill()
        point.violations.append(f"going on ended with {code}: {life.words()[-300:]}")


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
    point.cut = {(row["key"], k) for row in place.begun() for k in range(row["start"], row["stop"])}
    twice = {run for run, times in executed.items() if times > 1}
    point.executed_twice = len(twice)
    if len(executed) != CONFIGURATIONS * RUNS:
        say(f"{len(executed)} of {CONFIGURATIONS * RUNS} runs were executed")
    if not twice <= point.cut:
        say(f"{len(twice - point.cut)} runs were executed twice that were not in flight")
    if len({scenario for scenario, _ in twice}) > WORKERS:
        say(f"runs of {len({scenario for scenario, _ in twice})} configurations were executed twice")

    store = open_store(place.store)
    faults = {holding.key: store.fault(holding.key) for holding in store.holdings()}
    if damaged := [f"{key}: {fault}" for key, fault in faults.items() if fault]:
        say(f"{len(damaged)} artifacts are damaged, {damaged[0]}")
    other = [key for key, content in stored(store).items() if whole.artifacts.get(key, content) != content]
    if other:
        say(f"{len(other)} artifacts differ, {other[0]}")

    _age(place.store / "temporary", WRITING_S)
    _age(place.results, ABANDONED_S)
    open_store(place.store)
    sweep(place.results)
    if rest := [*(place.store / "temporary").iterdir(), *place.results.glob(".*")]:
        say(f"not swept: {rest[0]}")


def _age(folder: Path, by_s: float) -> None:
    then = time.time() - by_s - 60
    for path in [*folder.rglob("*"), folder]:
        os.utime(path, (then, then))


def proven(
    folder: Path,
    seed: int,
    total: int,
    kinds: Sequence[tuple[Setting, str]],
    show: Callable[[str], None],
    robot: bool = False,
) -> list[Point]:
    """All points, in order.

    Args:
        robot: Whether a robot drives in the campaign.
    """
    lab = Lab.made(folder, robot=robot)
    whole, alone = undisturbed(lab)
    there: dict[Setting, dict[str, tuple[float, float]]] = {"embedded": alone}
    settings = {setting for setting, _ in kinds}
    api = Api(folder / "api", lab.home) if settings & {"server", "cluster"} else None
    done = []
    try:
        if api:
            api.start()
        own = {setting: None if setting == "local" else api for setting in sorted(settings - {"embedded"})}
        there |= {setting: _there(lab, setting, of) for setting, of in own.items()}
        show("; ".join(f"{setting} starts for {times['flow'][1]:.1f} s" for setting, times in there.items()))
        show(HEADER)
        for point in points(seed, total, kinds, there):
            rng = random.Random(f"{seed} {point.kind} {point.number}")
            killed(lab, point, rng, whole, own.get(point.setting))
            show(line(point))
            done.append(point)
            (folder / "points.json").write_text(as_json(seed, done))
            if not point.violations:
                for gone in folder.glob(f"{re.sub(r'[ /]', '-', point.kind)}-{point.number}-*"):
                    shutil.rmtree(gone, ignore_errors=True)
    finally:
        if api:
            api.kill()
    return done


def _there(lab: Lab, setting: Setting, api: Api | None) -> dict[str, tuple[float, float]]:
    """Watch a campaign with a configured API or a cluster."""
    place = Place(lab, f"watched-{setting}", api.url if api else None, setting)
    crew = Crew(place) if setting == "cluster" else None
    try:
        return dict.fromkeys(VICTIMS[setting], watched(place)["flow"])
    finally:
        if crew:
            crew.stop()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--points", type=int, default=30, help="in all, dealt out evenly to settings and victims")
    parser.add_argument("--setting", action="append", choices=list(VICTIMS), help="this one alone; may be repeated")
    victims = sorted({victim for of_setting in VICTIMS.values() for victim in of_setting})
    parser.add_argument("--victim", action="append", choices=victims, help="this one alone; may be repeated")
    parser.add_argument("--robot", action="store_true", help="a campaign in which a robot drives")
    parser.add_argument(
        "--folder", type=Path, help="where all is made and kept, `points.json` too; else a temporary folder"
    )
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else")
    options = parser.parse_args()
    kinds = kinds_of(options.setting or list(VICTIMS), options.victim or ())
    if not kinds:
        parser.error(f"no --victim {', '.join(options.victim)} in the --setting {', '.join(options.setting)}")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))  # so that servers and workers are ended
    folder = options.folder or Path(tempfile.mkdtemp(prefix="vastflow-killed-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        show = (lambda text: None) if options.json else functools.partial(print, flush=True)
        done = proven(folder, options.seed, options.points, kinds, show, options.robot)
    finally:
        if options.folder is None:
            shutil.rmtree(folder, ignore_errors=True)
    print(as_json(options.seed, done) if options.json else "\n".join(totals(done)))
    return 1 if any(point.violations for point in done) else 0


if __name__ == "__main__":
    raise SystemExit(main())
