"""Results: the campaign directory, complete on its own: its rows, the files of its configurations, and its environments."""

import importlib.metadata
import json
import logging
import os
import platform
import shutil
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil
import yaml
from PIL import Image

from vastflow.flows.request.campaign_file import campaign_name, terminal_lines
from vastflow.flows.request.configurations import Runs, runs_of
from vastflow.flows.results.campaign_tables import CampaignTables, RunLogs, write_instantiation
from vastflow.flows.results.directory import NewDirectory
from vastflow.flows.results.found import StoredResult, one_block
from vastflow.flows.results.inputs import Inputs
from vastflow.flows.results.provenance import origin_row
from vastflow.flows.results.summary import OutcomeTally, Results, Summary, Work
from vastflow.oracles.results.executed import NAMED_FILES
from vastflow.producers.campaign import Campaign
from vastflow.producers.floorplan.environment import MESH, PLAN, PROVENANCE
from vastflow.producers.instantiation.family import robots_json
from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.producers.model.configuration import Configuration
from vastflow.producers.places.ground import MAP_KEY
from vastflow.sim.model.archive import one_archive
from vastflow.sim.model.digest import FileContent, file_digest
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.keys.keys import Keys

_GRAY = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}
"""The gray values of ROS' map_saver."""


def write_environment(directory: Path, map_file: FileContent, maps: Mapping[str, OccupancyMap]) -> None:
    """Write a configuration's map into `directory`, with the files of its floor plan.

    Args:
        maps: Digest to the maps that the campaign file names; any other is a producer's own.
    """
    if map_file.digest in maps:
        write_map(directory, maps[map_file.digest])
        return
    write_map(directory, load_map(map_file.path))
    for name in (MESH, PLAN, PROVENANCE):
        beside = Path(map_file.path).with_name(name)
        if beside.is_file():
            shutil.copyfile(beside, directory / name)


def write_map(directory: Path, occupancy: OccupancyMap) -> None:
    """Write `map.yaml` and `map.pgm` into `directory`; `load_map` gives the same map, digest included.

    A map with cells between free and occupied is written in mode `raw`, others in mode `trinary`.
    """
    directory.mkdir(parents=True, exist_ok=True)
    cells = occupancy.cells[::-1]  # a picture's first row is at the top
    trinary = bool(np.isin(cells, list(_GRAY)).all())
    if trinary:
        gray = np.select([cells == value for value in _GRAY], list(_GRAY.values()))
    else:
        gray = np.where(cells == UNKNOWN, 255, cells.astype(np.int16))
    Image.fromarray(gray.astype(np.uint8)).save(directory / "map.pgm")
    header = {
        "image": "map.pgm",
        "mode": "trinary" if trinary else "raw",
        "resolution": float(occupancy.resolution_m),
        "origin": [*(float(meters) for meters in occupancy.origin_xy_m), float(occupancy.yaw_rad)],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,  # just below the gray of unknown cells, which Nav2's 0.25 would read as free
    }
    (directory / "map.yaml").write_text(yaml.safe_dump(header, sort_keys=False), encoding="utf-8")


FOLDERS: Final = ("recordings", "traces")

_AHEAD: Final = 4
"""How many configurations a thread may be ahead: so many are in memory at a time."""


def written(
    place: Path,
    configurations: Iterable[Configuration],
    found: Callable[[Configuration], StoredResult],
    runs: Runs,
    threads: int,
) -> Iterator[tuple[Configuration, StoredResult]]:
    """Write the files of configurations into a campaign directory; yield each configuration afterwards.

    Args:
        found: What was found of a configuration; called from any thread.
        runs: Of each.
        threads: How many read at a time.
    """
    for folder in FOLDERS:
        (place / folder).mkdir()

    def write(configuration: Configuration) -> tuple[Configuration, StoredResult]:
        result = found(configuration)
        _write(place, configuration.name, result, runs_of(runs, configuration.name))
        return configuration, result

    if threads == 1:
        yield from map(write, configurations)
        return
    waiting: deque[Future[tuple[Configuration, StoredResult]]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        try:
            for configuration in configurations:
                waiting.append(pool.submit(write, configuration))
                if len(waiting) > threads * _AHEAD:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for each in waiting:
                each.cancel()


def _write(place: Path, name: str, found: StoredResult, runs: int) -> None:
    _write_file(f"{place}/recordings/{name}.parquet", _one(found, found.recordings, one_block, runs))
    _write_file(f"{place}/traces/{name}.parquet", _one(found, found.traces, one_block, runs))
    if outputs := _one(found, found.outputs, one_archive, runs):
        (place / "outputs").mkdir(exist_ok=True)
        _write_file(f"{place}/outputs/{name}.zip", outputs)


def _one(
    found: StoredResult, blocks: Sequence[bytes], join: Callable[[Sequence[bytes], int], bytes], runs: int
) -> bytes:
    return blocks[0] if found.exact and len(blocks) == 1 else join(blocks, runs)


def _write_file(path: str, content: bytes) -> None:
    if content:
        with open(path, "wb", buffering=0) as file:  # pathlib and a buffer take as long as the file system
            file.write(content)


def write_rows(
    place: Path,
    files: Iterable[tuple[Configuration, StoredResult]],
    runs: Runs,
    oracles: Sequence[str],
) -> tuple[OutcomeTally, list[RunFault]]:
    """Write the tables of runs and the run logs into a campaign directory; return counts and faults.

    Args:
        files: Each configuration that is no duplicate, in order, with what was found of it.
        runs: Of each.
        oracles: Names of the oracles, in order.
    """
    faults: list[RunFault] = []
    with CampaignTables(place, oracles) as tables, closing(RunLogs(place)) as logs:
        for configuration, found in files:
            tables.add(configuration, found, runs_of(runs, configuration.name))
            logs.add(configuration.name, found.logs)
            faults += found.faults
    return tables.tally, faults


LOGGER: Final = logging.getLogger("vastflow.results")


@dataclass(frozen=True, slots=True)
class Assessed:
    """A campaign directory with all tables, before its report.

    Attributes:
        metadata: What `metadata.json` says beside outcome and work.
    """

    directory: NewDirectory
    metadata: Mapping[str, Any]
    summary: Summary
    faults: tuple[RunFault, ...]
    notes: tuple[str, ...]


def write_tables(
    directory: NewDirectory,
    campaign: Campaign,
    inputs: Inputs,
    instantiation: Instantiation,
    found: Callable[[Configuration], StoredResult],
    *,
    runs: Runs,
    oracles: Sequence[str],
    keys: Keys,
    record: Mapping[str, Any] | None = None,
    faults: Iterable[RunFault] = (),
    created: datetime,
    work: Callable[[], Work],
    threads: int = 1,
) -> Assessed:
    """Write all of a campaign directory but its report.

    Args:
        inputs: The campaign's files as they were when it was loaded.
        instantiation: What is in the directory, that is, after `only` has been applied.
        found: Reads one configuration's artifacts; called once for each that is no duplicate, from `threads` threads and few ahead,
            so that only a few configurations' recordings are in memory.
        runs: Of each configuration.
        oracles: Names of the requested oracles, `success` first. A run without a verdict of one of them
            gets `not judged` with the fault as the reason.
        keys: Of the artifacts that `found` reads; name the code and the numeric class they follow from.
        record: What more `metadata.json` says, from the beginning on: what was asked, and the code in detail.
        faults: Those of no single configuration.
        work: What the call has done so far.
        threads: How many read configurations at a time.

    Raises:
        Lost: an artifact is damaged or gone.
    """
    place = directory.partial
    inputs.write(place)
    metadata = {**metadata_of(campaign, keys, created), **(record or {})}
    _write_json(place / "metadata.json", metadata)  # for another run, should this process be killed
    _write_environments(place / "environments", inputs.maps, instantiation.configurations)
    distinct = [each for each in instantiation.configurations if each.duplicate_of is None]
    _write_json(place / "coverage.json", instantiation.coverage)
    write_instantiation(place, instantiation)
    tally, run_faults = write_rows(place, written(place, distinct, found, runs, threads), runs, oracles)
    all_faults = [*faults, *run_faults]
    summary = summary_of(instantiation, tally, runs, work(), directory.final)
    _write_outcome(place, metadata, summary, all_faults)
    notes = tuple(terminal_lines(campaign.notes))
    return Assessed(directory, metadata, summary, tuple(all_faults), notes)


def write_report(assessed: Assessed, report: Callable[[Path], None], work: Callable[[], Work]) -> Results:
    """Write a campaign's report.

    Args:
        report: Writes evidence, figures and report into the directory it is given. What it raises
            is a fault of the campaign, but no reason to lose the tables.
        work: What the call has done so far.
    """
    place, metadata, faults = assessed.directory.partial, assessed.metadata, list(assessed.faults)
    try:
        report(place)
    except Exception as error:
        LOGGER.exception("the report could not be made")
        faults.append(RunFault("", None, "report", f"{type(error).__name__}: {error}"))
    done = work()
    summary = replace(assessed.summary, cpu_s=done.cpu_s, wall_s=done.wall_s)
    _write_outcome(place, metadata, summary, faults)
    return Results(assessed.directory.final, summary, tuple(faults), assessed.notes)


def summary_of(instantiation: Instantiation, tally: OutcomeTally, runs: Runs, work: Work, results: Path) -> Summary:
    """A campaign in numbers.

    Args:
        runs: Of each configuration.
    """
    distinct = [c.name for c in instantiation.configurations if c.duplicate_of is None]
    return Summary(
        configurations=len(distinct),
        rejected=len(instantiation.rejections),
        excluded=len(instantiation.excluded),
        duplicates=len(instantiation.configurations) - len(distinct),
        runs=sum(runs_of(runs, name) for name in distinct),
        **asdict(tally.counts),
        **asdict(work),
        results=str(results),
        oracles=tally.by_oracle,
        excluded_by=_excluded_by(instantiation),
        sampled_from=instantiation.sampled_from,
        stood_still=tally.stood_still,
    )


def _excluded_by(instantiation: Instantiation) -> dict[str, dict[str, int]]:
    counts: dict[str, dict[str, int]] = {}
    for instance in instantiation.excluded:
        family = counts.setdefault(instance.family, {})
        family[instance.constraint] = family.get(instance.constraint, 0) + 1
    return counts


def _write_environments(
    directory: Path, maps: Mapping[str, OccupancyMap], configurations: Iterable[Configuration]
) -> None:
    named: dict[str, str] = {}
    for configuration in configurations:
        map_file = configuration.scenario.environment.get(MAP_KEY)
        if not isinstance(map_file, FileContent):
            continue
        if not (directory / map_file.digest).exists():
            write_environment(directory / map_file.digest, map_file, maps)
        for key, value in configuration.scenario.environment.items():
            if key != MAP_KEY and isinstance(value, FileContent) and value.digest not in named:
                place = directory / map_file.digest / Path(value.path).name
                if place.is_file() and file_digest(place) != value.digest:
                    named[value.digest] = place.relative_to(directory).as_posix()
    if named:
        _write_json(directory / NAMED_FILES, named)


def metadata_of(campaign: Campaign, keys: Keys, created: datetime) -> dict[str, Any]:
    """Return the part of `metadata.json` that every campaign has, without outcome and work."""
    return {
        "name": campaign_name(campaign),
        "created": created.isoformat(timespec="seconds"),
        "vastflow": importlib.metadata.version("vastflow"),
        "versions": _versions(),
        **origin_row(keys),
        "host": {
            "name": platform.node(),
            "system": platform.platform(),
            "machine": platform.machine(),
            "cpus": os.cpu_count(),
            "memory_bytes": psutil.virtual_memory().total,
        },
        "notes": [str(note) for note in campaign.notes],
        "robots": robots_json(campaign.families),
    }


def _write_outcome(place: Path, metadata: Mapping[str, Any], summary: Summary, faults: Sequence[RunFault]) -> None:
    outcome = {"counts": summary.as_json(), "faults": [asdict(fault) for fault in faults]}
    code = {key: value for key, value in metadata.items() if key == "code"}  # long, and for no reader: at the end
    rest = {key: value for key, value in metadata.items() if key != "code"}
    _write_json(place / "metadata.json", {**rest, **outcome, **code})


def _versions() -> dict[str, str]:
    packages = ("llvmlite", "numba", "numpy", "prefect", "pyarrow", "pymunk", "scipy", "shapely")
    return {"python": platform.python_version(), **{name: importlib.metadata.version(name) for name in packages}}


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    # What UTF-8 does not have becomes an escape, which JSON reads.
    text = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
    path.write_text(text, encoding="utf-8", errors="backslashreplace")
