"""Import of bags: a campaign of recorded runs beside simulated ones, and the rank of real values."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
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
from vastflow.sim.model.recording import Recording, si
from vastflow.sim.system.system import system_kind, system_of
from vastflow.sim.world.readers.registry import files_of_world
from vastflow.sim.world.world import map_content, read_grid

ORACLES: Final = ("performance", {"safety": {"fail_on_contact": "any"}}, "robustness", "navigation")
LEAST_TIMEOUT_S: Final = 120.0
_CONSTANT: Final = ("threshold", "reference_length")


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
        recording = recording_of(bag, clock, drive)
        if drive.truth is not None and "contact" not in bag.topics:
            hits = wall_contacts(drive, ground, radius_m)
            events = sorted((*hits, *recording.run.events), key=lambda event: event.t_s)
            run = replace(recording.run, events=tuple(events))
            recording = replace(recording, run=run)
        stem = f"bag{number}-" if len(bags) > 1 else ""
        file = folder / "recordings" / f"{stem}{_plain(path.stem)}.parquet"
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(write_recordings([recording]))
        places = {
            "map_file": f"map/{map_file.name}",
            "start_pose": _written(_first(drive)),
            "goal_pose": _written(drive.goal),
        }
        own = [{key: value} for key, value in places.items()]
        recorded = [*own, {"recording": file.relative_to(folder).as_posix()}]
        one = ImportedBag(f"{stem}real", f"{stem}simulated", drive, (*clock_notes, *drive.notes))
        families.append({"name": one.real, "parameters": recorded, "start_check": "none"})
        if runs:
            families.append({"name": one.simulated, "parameters": own, "start_check": "none"})
        imported.append(one)
    longest_s = max(float(each.drive.t_s[-1] - each.drive.t_s[0]) for each in imported)
    names = ", ".join(path.name for path in bags)
    campaign = {
        "version": 1,
        "metadata": {"name": f"import_{_plain(bags[0].stem)}", "title": f"Imported from {names}"},
        "configuration": families,
        "execution": {
            "runs": max(1, runs),
            "timeout": max(LEAST_TIMEOUT_S, round(3.0 * longest_s)),
            **({} if params is None else {"nav2_params": params.name}),
        },
        "evaluation": {"oracles": list(ORACLES)},
    }
    file = folder / "import.vast"
    file.write_text(yaml.safe_dump(campaign, sort_keys=False), encoding="utf-8")
    return file, imported


def _plain(text: str) -> str:
    return re.sub(r"\W+", "_", text)[:40].strip("_") or "bag"


def _first(drive: Drive) -> Pose:
    return Pose(*drive.poses[0].tolist())


def _written(pose: Pose) -> dict[str, float]:
    return {"x": round(pose.x_m, 3), "y": round(pose.y_m, 3), "yaw": round(pose.yaw_rad, 4)}


@dataclass(frozen=True, slots=True)
class Place:
    """Rank of a real run's value among those of simulated ones.

    Attributes:
        signal: Its name, with the unit.
        real: None where the real run has no such value.
        least, median, most, n: Of the simulated runs; None without any.
        p: Two-sided p-value of the rank, exact if the real run were one more simulated run.
    """

    signal: str
    real: float | None
    least: float | None
    median: float | None
    most: float | None
    n: int
    p: float | None

    @property
    def inside(self) -> bool | None:
        if self.real is None or self.least is None or self.most is None:
            return None
        return self.least <= self.real <= self.most


def coverage_of(n: int) -> float:
    """Probability (n - 1) / (n + 1) that the range of n values holds one more."""
    return max(0.0, (n - 1) / (n + 1))


def place_of(signal: str, real: float | None, simulated: Sequence[float]) -> Place:
    """Rank a value among simulated ones.

    If all n + 1 are exchangeable, the rank of the real one is uniform: p = min(1, 2 min(1 + #{s <= r}, 1 + #{s >= r}) / (n + 1)).
    """
    if not simulated:
        return Place(signal, real, None, None, None, 0, None)
    values = np.sort(np.asarray(simulated, dtype=np.float64))
    n, p = len(values), None
    if real is not None:
        tail = 1 + min(int((values <= real).sum()), int((values >= real).sum()))
        p = min(1.0, 2.0 * tail / (n + 1))
    return Place(signal, real, float(values[0]), float(np.median(values)), float(values[-1]), n, p)


def places_of(directory: Path, real: str, simulated: str) -> list[Place]:
    """Return the place of the real run for each signal of a campaign directory."""
    theirs, own = ([*_signals(directory, name)] for name in (simulated, real))
    if not own:
        raise BagError(f"{directory}: expected a verdict on {real}, got none")
    names = dict.fromkeys([*own[0], *(name for signals in theirs for name in signals)])
    found = []
    for name in names:
        values = [value for signals in theirs if (value := signals.get(name)) is not None]
        found.append(place_of(name, own[0].get(name), values))
    return [place for place in found if place.real is not None or place.n]


def _signals(directory: Path, configuration: str) -> Iterator[Mapping[str, float | None]]:
    """Yield name, with its unit, to value of each run's signals."""
    table = read_columns(directory / "verdicts.parquet")
    rows = [row for row in table.to_pylist() if row["configuration"] == configuration]
    recordings = recordings_of(directory, configuration)
    for run_index in sorted({row["run_index"] for row in rows}):
        found: dict[str, float | None] = {}
        for row in (row for row in rows if row["run_index"] == run_index):
            for name, metric in json.loads(row["metrics"]).items():
                if name not in _CONSTANT:
                    unit = "" if metric["unit"] == "1" else f" ({metric['unit']})"
                    found[f"{row['oracle']}: {name}{unit}"] = metric["value"]
        if run_index in recordings:
            found |= _speeds(recordings[run_index])
        yield found


def _speeds(recording: Recording) -> dict[str, float]:
    speed_mps = np.abs(si(recording.columns["speed_mmps"]))
    if not len(speed_mps):
        return {}
    return {"speed: mean (m/s)": float(speed_mps.mean()), "speed: top (m/s)": float(speed_mps.max())}


def scenario_robot(directory: Path, configuration: str) -> Sequence[str]:
    """Return whose robot was simulated, one line each."""
    scenario = scenario_of_row(configuration_row(directory, configuration), KeptFiles(directory))
    return [system_of(scenario.system, is_drawn=True).whose]
