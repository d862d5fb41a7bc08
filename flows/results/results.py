"""Results: the campaign directory, complete on its own: its rows, the files of its configurations, and its environments."""

import importlib.metadata
import io
import json
import logging
import os
import platform
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil
import yaml
from PIL import Image

from vastflow.flows.request.campaign_file import campaign_name, terminal_lines
from vastflow.flows.results.directory import NewDirectory
from vastflow.flows.results.inputs import Inputs
from vastflow.flows.results.provenance import DEFAULTS_KEY, origin_row
from vastflow.flows.results.rows import KeptRows, StoredResult, one_block, parts, rows_of
from vastflow.flows.results.summary import Results, Summary, Work
from vastflow.flows.results.tables import KeptLogs, RunTables, health_text, write_instantiation
from vastflow.oracles.results.executed import NAMED_FILES
from vastflow.oracles.results.former import VERSION
from vastflow.producers.campaign import Campaign
from vastflow.producers.floorplan.environment import MESH, PLAN, PROVENANCE
from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.producers.instantiation.robots import robots_json
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.archive import one_archive
from vastflow.sim.model.digest import FileContent, file_digest
from vastflow.sim.model.files import copy_file, replace_file
from vastflow.sim.world.environment import ground_file
from vastflow.sim.world.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from vastflow.sim.world.world import World, read_grid
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.keys.keys import Keys

LOGGER: Final = logging.getLogger("vastflow.results")

_GRAY: Final = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}
"""The gray values of ROS' map_saver."""
_LIBRARIES: Final = ("llvmlite", "numba", "numpy", "prefect", "pyarrow", "pymunk", "scipy", "shapely")


def write_results(
    directory: NewDirectory,
    campaign: Campaign,
    inputs: Inputs,
    instantiation: Instantiation,
    found: Callable[[Configuration], StoredResult],
    *,
    runs: Mapping[str, int],
    oracles: Sequence[str],
    keys: Keys,
    record: Mapping[str, Any],
    faults: Iterable[RunFault] = (),
    created: datetime,
    work: Callable[[], Work],
    report: Callable[[Path], Mapping[str, Any] | None],
    threads: int = 1,
    kept: KeptRows | None = None,
) -> Results:
    """Write a campaign directory: inputs, recordings, traces, tables, and the report.

    Args:
        inputs: The campaign's files as they were when it was loaded.
        instantiation: The instantiation in the directory, that is, after `only` has been applied.
        found: Reads the artifacts of a configuration that is no duplicate, in one of `threads` threads.
        oracles: Names of the requested oracles, `success` first. A run without a verdict of one of them
            gets `not judged` with the fault as the reason.
        keys: Keys of the artifacts that `found` reads; they name the code and the numeric class of these.
        record: Further entries of `metadata.json`, from the beginning on: the request, and the code in detail.
        faults: Faults that concern no single configuration.
        work: Returns the work of the call so far.
        report: Writes evidence, figures and report into the directory it is given, and returns its headline as JSON, if any. What it raises
            is a fault of the campaign, but no reason to lose the tables.
        kept: Rows of earlier calls, and where new ones are kept; None to make all.

    Raises:
        Lost: an artifact is damaged or gone.
    """
    place = directory.partial
    inputs.write(place)
    metadata = {**metadata_of(campaign, keys, created), **record}
    write_json(place / "metadata.json", metadata)  # for another run, should this process be killed
    _write_environments(place / "environments", inputs.worlds, instantiation.configurations)
    write_json(place / "coverage.json", instantiation.coverage)
    write_instantiation(place, instantiation)
    for folder in ("recordings", "traces"):
        (place / folder).mkdir()
    distinct = [each for each in instantiation.configurations if each.duplicate_of is None]
    with RunTables(place) as tables, _readers(threads) as each_of:
        for part in parts(distinct):
            key = kept.key((each, found(each), runs[each.name]) for each in part) if kept else None
            rows = kept.find(key) if kept and key else None
            written = each_of(partial(_write_configuration, place, found, runs), part)
            if rows is None:
                rows = rows_of(written, runs, oracles)
                if kept and key:
                    kept.put(key, rows)
            else:
                deque(written, maxlen=0)
            tables.add(rows)
    excluded_by: dict[str, Counter[str]] = {}
    for instance in instantiation.excluded:
        excluded_by.setdefault(instance.family, Counter())[instance.constraint] += 1
    summary = Summary(
        configurations=len(distinct),
        rejected=len(instantiation.rejections),
        excluded=len(instantiation.excluded),
        duplicates=len(instantiation.configurations) - len(distinct),
        runs=sum(runs[each.name] for each in distinct),
        **asdict(tables.counts()),
        **asdict(work()),
        results=str(directory.final),
        oracles={name: tables.counts(name) for name in oracles},
        excluded_by={family: dict(counts) for family, counts in excluded_by.items()},
        sampled_from=instantiation.sampled_from,
        stood_still=tables.stood_still,
    )
    all_faults = [*faults, *tables.faults]
    if campaign.nodes is not None and campaign.nodes.time == "paced":
        asked = {each.name: runs[each.name] for each in distinct}
        metadata["health"] = health_text(KeptLogs(place), asked, campaign.nodes, all_faults)
    _write_outcome(place, metadata, summary, all_faults)  # the report reads it
    try:
        if headline := report(place):
            summary = replace(summary, headline=headline)
    except Exception as error:
        LOGGER.exception("the report could not be made")
        all_faults.append(RunFault("", None, "report", f"{type(error).__name__}: {error}"))
    done = work()
    summary = replace(summary, cpu_s=done.cpu_s, wall_s=done.wall_s)
    _write_outcome(place, metadata, summary, all_faults)
    return Results(directory.final, summary, tuple(all_faults), tuple(terminal_lines(campaign.notes)))


def metadata_of(campaign: Campaign, keys: Keys, created: datetime) -> dict[str, Any]:
    """Return the part of `metadata.json` that every campaign has, without outcome and work."""
    versions = {name: importlib.metadata.version(name) for name in _LIBRARIES}
    return {
        "schema": VERSION,
        "name": campaign_name(campaign),
        "created": created.isoformat(timespec="seconds"),
        "vastflow": importlib.metadata.version("vastflow"),
        "versions": {"python": platform.python_version(), **versions},
        **origin_row(keys),
        "host": {
            "name": platform.node(),
            "system": platform.platform(),
            "machine": platform.machine(),
            "cpus": os.cpu_count(),
            "memory_bytes": psutil.virtual_memory().total,
        },
        "notes": [str(note) for note in campaign.notes],
        "robots": robots_json(campaign.families, campaign.nodes),
        **({} if campaign.nav2_defaults is None else {DEFAULTS_KEY: campaign.nav2_defaults}),
    }


def write_json(path: Path, content: Any) -> None:
    """Write JSON for people; what UTF-8 does not have becomes an escape."""
    text = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
    replace_file(path, text.encode(errors="backslashreplace"))


def _write_outcome(place: Path, metadata: Mapping[str, Any], summary: Summary, faults: Sequence[RunFault]) -> None:
    whole = {**metadata, "counts": summary.as_json(), "faults": [asdict(fault) for fault in faults]}
    if "code" in whole:  # long, and for no reader: at the end
        whole["code"] = whole.pop("code")
    write_json(place / "metadata.json", whole)


@contextmanager
def _readers(threads: int) -> Iterator[Callable[..., Iterator[Any]]]:
    """Yield `map`, in threads where there is more than one."""
    if threads == 1:
        yield map
        return
    with ThreadPoolExecutor(threads) as pool:
        yield pool.map


def _write_configuration(
    place: Path, found: Callable[[Configuration], StoredResult], runs: Mapping[str, int], configuration: Configuration
) -> tuple[Configuration, StoredResult]:
    result, name = found(configuration), configuration.name
    for folder, suffix, blocks, join in (
        ("recordings", "parquet", result.recordings, one_block),
        ("traces", "parquet", result.traces, one_block),
        ("outputs", "zip", result.outputs, one_archive),
    ):
        whole = result.exact and len(blocks) == 1
        if content := blocks[0] if whole else join(blocks, runs[name]):
            if folder == "outputs":
                os.makedirs(f"{place}/{folder}", exist_ok=True)
            # pathlib and a buffer take as long as the file system
            with open(f"{place}/{folder}/{name}.{suffix}", "wb", buffering=0) as file:
                file.write(content)
    return configuration, result


def _write_environments(directory: Path, worlds: Mapping[str, World], configurations: Iterable[Configuration]) -> None:
    """Write each map into a folder of its digest, with its floor plan's files; without a map the world's walls.

    Args:
        worlds: Digest to the worlds that the campaign file names; any other is a producer's own.
    """
    named: dict[str, str] = {}
    for configuration in configurations:
        map_file = ground_file(configuration.scenario.environment)
        if map_file is None:
            continue
        folder = directory / map_file.digest
        if not folder.exists():
            own = worlds.get(map_file.digest)
            write_map(folder, read_grid(map_file) if own is None else own.ground)
            for beside in (Path(map_file.path).with_name(name) for name in (MESH, PLAN, PROVENANCE) if own is None):
                if beside.is_file():
                    copy_file(beside, folder / beside.name)
        for value in configuration.scenario.environment.values():
            if value is not map_file and isinstance(value, FileContent) and value.digest not in named:
                place = folder / Path(value.path).name
                if place.is_file() and file_digest(place) != value.digest:
                    named[value.digest] = place.relative_to(directory).as_posix()
    if named:
        write_json(directory / NAMED_FILES, named)


def write_map(directory: Path, occupancy: OccupancyMap) -> None:
    """Write `map.yaml` and `map.pgm` into `directory`; the same map is read from them, digest included."""
    directory.mkdir(parents=True, exist_ok=True)
    for name, content in map_files(occupancy).items():
        (directory / name).write_bytes(content)


def map_files(occupancy: OccupancyMap) -> dict[str, bytes]:
    """Return `map.yaml` and `map.pgm` of a map.

    A map with cells between free and occupied is written in mode `raw`, others in mode `trinary`.
    """
    cells = occupancy.cells[::-1]  # a picture's first row is at the top
    trinary = bool(np.isin(cells, list(_GRAY)).all())
    if trinary:
        gray = np.select([cells == value for value in _GRAY], list(_GRAY.values()))
    else:
        gray = np.where(cells == UNKNOWN, 255, cells.astype(np.int16))
    picture = io.BytesIO()
    Image.fromarray(gray.astype(np.uint8)).save(picture, "PPM")
    header = {
        "image": "map.pgm",
        "mode": "trinary" if trinary else "raw",
        "resolution": float(occupancy.resolution_m),
        "origin": [*(float(meters) for meters in occupancy.origin_xy_m), float(occupancy.yaw_rad)],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,  # just below the gray of unknown cells, which Nav2's 0.25 would read as free
    }
    return {"map.pgm": picture.getvalue(), "map.yaml": yaml.safe_dump(header, sort_keys=False).encode()}
