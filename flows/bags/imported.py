"""Import of bags: a campaign of recorded runs beside simulated ones, and the rank of real values."""

import json
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from vastflow.flows.bags.bag import BagError, read_bag
from vastflow.flows.bags.drive import Drive, clock_of, drive_of
from vastflow.flows.bags.recorded import recording_of, wall_contacts
from vastflow.oracles.results.executed import KeptFiles, configuration_row, recordings_of, scenario_of_row
from vastflow.oracles.results.schema import read_columns
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.files import copy_file
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import si
from vastflow.sim.system.system import system_kind, system_of
from vastflow.sim.world.readers.registry import files_of_world
from vastflow.sim.world.world import map_content, read_grid

ORACLES: Final = ("performance", {"safety": {"fail_on_contact": "any"}}, "robustness", "navigation")
LEAST_TIMEOUT_S: Final = 120.0
LEAST_RUNS: Final = 19
"""Simulated runs whose range one more is beyond with at most 10 %, 2 / (n + 1)."""
_CONSTANT: Final = ("threshold", "reference_length")

Signals = Mapping[str, float | None]
"""Name of a signal, with its unit, to its value."""


@dataclass(frozen=True)
class ImportedBag:
    """A bag as a configuration: `real`, or `bag2-real` of several."""

    real: str
    simulated: str
    drive: Drive
    notes: tuple[str, ...]


def write_import(
    folder: Path,
    bags: Sequence[Path],
    map_file: Path,
    params: Path | None,
    *,
    runs: int,
    namespace: str = "",
    start: Pose | None = None,
    goal: Pose | None = None,
) -> tuple[Path, list[ImportedBag]]:
    """Write a campaign file of bags with its inputs into a folder.

    Args:
        params: Nav2 parameters of the simulated robot; None for Nav2's defaults.
        runs: Simulated runs beside each recorded one.
        namespace, start, goal: See `read_bag` and `drive_of`.

    Raises:
        BagError: a bag that can't be read, or lacks what a run needs.
        WorldError: the map can't be read.
    """
    ground = read_grid(map_content(map_file))
    values = {} if params is None else system_kind().read_file(params, {}).values
    radius_m = system_of(values).inscribed_radius_m
    inputs = {} if params is None else {"nav2_params": params.name}
    for file in files_of_world(map_file):
        copy_file(file, folder / "map" / file.name)
    if params is not None:
        copy_file(params, folder / params.name)
    families: list[dict[str, Any]] = []
    imported: list[ImportedBag] = []
    for number, path in enumerate(bags, 1):
        bag = read_bag(path, namespace)
        clock, clock_notes = clock_of(bag)
        drive = drive_of(bag, clock, start, goal)
        hits = [] if drive.truth is None or bag.exported else wall_contacts(drive, ground, radius_m)
        recording = recording_of(bag, clock, drive, hits)
        stem = f"bag{number}-" if len(bags) > 1 else ""
        file = folder / "recordings" / f"{stem}{_plain(path.stem)}.parquet"
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(write_recordings([recording]))
        poses = {"start_pose": _written(*drive.poses[0].tolist()), "goal_pose": _written(*astuple(drive.goal))}
        own = [{"map_file": f"map/{map_file.name}"}, *({key: value} for key, value in poses.items())]
        one = ImportedBag(f"{stem}real", f"{stem}simulated", drive, (*clock_notes, *drive.notes))
        imported.append(one)
        recorded = [*own, {"recording": file.relative_to(folder).as_posix()}]
        for name, parameters in ((one.real, recorded), (one.simulated, own))[: 2 if runs else 1]:
            families.append({"name": name, "parameters": parameters, "start_check": "none"})
    longest_s = max(float(each.drive.t_s[-1] - each.drive.t_s[0]) for each in imported)
    names = ", ".join(path.name for path in bags)
    campaign = {
        "version": 1,
        "metadata": {"name": f"import_{_plain(bags[0].stem)}", "title": f"Imported from {names}"},
        "configuration": families,
        "execution": {"runs": max(1, runs), "timeout": max(LEAST_TIMEOUT_S, round(3.0 * longest_s)), **inputs},
        "evaluation": {"oracles": list(ORACLES)},
    }
    file = folder / "import.vast"
    file.write_text(yaml.safe_dump(campaign, sort_keys=False), encoding="utf-8")
    return file, imported


def _plain(text: str) -> str:
    return re.sub(r"\W+", "_", text)[:40].strip("_") or "bag"


def _written(x_m: float, y_m: float, yaw_rad: float) -> dict[str, float]:
    return {"x": round(x_m, 3), "y": round(y_m, 3), "yaw": round(yaw_rad, 4)}


@dataclass(frozen=True, slots=True)
class Place:
    """Rank of a real run's value among those of simulated ones.

    Attributes:
        signal: Its name, with the unit.
        real: None where the real run has no such value.
        least, median, most, n: Of the simulated runs; None without any.
        p: Two-sided p-value of the rank.
        outside: Whether the value is beyond the range of the simulated ones; None where fewer than `LEAST_RUNS` of them have one.
    """

    signal: str
    real: float | None
    least: float | None
    median: float | None
    most: float | None
    n: int
    p: float | None
    outside: bool | None


def place_of(signal: str, real: float | None, simulated: Sequence[float]) -> Place:
    """Rank a value among simulated ones.

    If all n + 1 are exchangeable, p = min(1, 2 min(1 + #{s <= r}, 1 + #{s >= r}) / (n + 1)) is up to a level with at most this
    probability; with exactly 2 k / (n + 1) up to it if none are equal.
    """
    if not simulated:
        return Place(signal, real, None, None, None, 0, None, None)
    values = np.sort(np.asarray(simulated, dtype=np.float64))
    n, p, outside = len(values), None, None
    if real is not None:
        p = min(1.0, 2.0 * (1 + min(int((values <= real).sum()), int((values >= real).sum()))) / (n + 1))
        outside = None if n < LEAST_RUNS else not values[0] <= real <= values[-1]
    return Place(signal, real, float(values[0]), float(np.median(values)), float(values[-1]), n, p, outside)


@dataclass(frozen=True, slots=True)
class Spread:
    """Places of a real run's signals among those of simulated runs, and of all signals together.

    Attributes:
        beyond: Number of signals that are beyond the range of the other runs, for the real run and then for each simulated one, among
            the signals that all have.
        p: Share of these runs that have as many as the real one; None without simulated runs. Up to a level with at most this
            probability if all runs are exchangeable, however much the signals depend on one another.
    """

    places: tuple[Place, ...]
    beyond: tuple[int, ...]
    p: float | None


def spread_of(runs: Sequence[Signals]) -> Spread:
    """Set the first of several runs beside the others."""
    names = dict.fromkeys(name for signals in runs for name in signals)
    values = {name: [signals.get(name) for signals in runs] for name in names}
    places = (
        place_of(name, own, [each for each in others if each is not None]) for name, (own, *others) in values.items()
    )
    told = tuple(place for place in places if place.real is not None or place.n)
    table = np.array([row for row in values.values() if None not in row], dtype=np.float64)
    if len(runs) < 3 or not len(table):
        return Spread(told, (), None)
    ordered = np.sort(table, axis=1)
    beyond = ((table < ordered[:, 1:2]) | (table > ordered[:, -2:-1])).sum(axis=0)
    return Spread(told, tuple(beyond.tolist()), float((beyond >= beyond[0]).mean()))


def spread_in(directory: Path, real: str, simulated: str) -> Spread:
    """Return the spread of the signals in a campaign directory."""
    own, theirs = ([*_signals(directory, name)] for name in (real, simulated))
    if not own:
        raise BagError(f"{directory}: expected a verdict on {real}, got none")
    return spread_of([*own, *theirs])


def _signals(directory: Path, configuration: str) -> Iterator[Signals]:
    """Yield the signals of each run."""
    found: dict[int, dict[str, float | None]] = defaultdict(dict)
    for row in read_columns(directory / "verdicts.parquet").to_pylist():
        if row["configuration"] == configuration:
            for name, metric in json.loads(row["metrics"]).items():
                if name not in _CONSTANT:
                    unit = "" if metric["unit"] == "1" else f" ({metric['unit']})"
                    found[row["run_index"]][f"{row['oracle']}: {name}{unit}"] = metric["value"]
    recordings = recordings_of(directory, configuration)
    for run_index, signals in sorted(found.items()):
        if run_index in recordings and len(speed_mps := np.abs(si(recordings[run_index].columns["speed_mmps"]))):
            signals |= {"speed: mean (m/s)": float(speed_mps.mean()), "speed: top (m/s)": float(speed_mps.max())}
        yield signals


def scenario_robot(directory: Path, configuration: str) -> Sequence[str]:
    """Return whose robot was simulated, one line each."""
    scenario = scenario_of_row(configuration_row(directory, configuration), KeptFiles(directory))
    return [system_of(scenario.system, is_drawn=True).whose]
