"""Results: the campaign directory, complete on its own (design §7)."""

import importlib.metadata
import io
import json
import logging
import os
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import psutil
import pyarrow.parquet as pq

from vastflow.flows.directory import new_directory
from vastflow.flows.environment import write_environment
from vastflow.flows.inputs import Inputs
from vastflow.flows.notes import terminal_lines
from vastflow.flows.origin import origin_row
from vastflow.flows.summary import Summary, Work
from vastflow.flows.tables import (
    CONFIGURATIONS,
    EXCLUSIONS,
    REJECTIONS,
    RUNS,
    VERDICTS,
    Row,
    configuration_row,
    exclusion_row,
    rejection_row,
    run_table_row,
    verdict_row,
    write_table,
)
from vastflow.oracles.rates import counts_of
from vastflow.oracles.trace import levelled
from vastflow.oracles.verdict import Judgement, Verdict, run_judgement
from vastflow.producers.campaign import Campaign
from vastflow.producers.configuration import Configuration
from vastflow.producers.ground import MAP_KEY
from vastflow.producers.instantiate import Instantiation
from vastflow.sim.archive import one_archive, one_table
from vastflow.sim.blocks import ROWS_KEY, read_block, write_block
from vastflow.sim.digest import FileContent
from vastflow.sim.maps import OccupancyMap
from vastflow.tasks.keys import Keys

LOGGER: Final = logging.getLogger("vastflow.results")


@dataclass(frozen=True, slots=True)
class RunFault:
    """Something of ours that broke: the run is not judged, and never counted as a failure of the robot.

    Attributes:
        configuration: Its name; empty where the fault concerns the whole campaign.
        run_index: None for all runs of the configuration.
        stage: `execute`, `observe`, `judge` or `report`.
        error: What was raised, in one line.
    """

    configuration: str
    run_index: int | None
    stage: str
    error: str


@dataclass(frozen=True, slots=True)
class ConfigurationResult:
    """What was found for one configuration.

    Attributes:
        recordings, traces: Blocks of runs in any blocking; runs that were not asked for are left out.
        verdicts: Of any runs and oracles, in any order.
        faults: Why runs are missing.
        behaviors, outputs: Blocks of the scenarios' behaviours and of what programs wrote, as `vastflow.sim.archive` has them.
        logs: Run logs, as `vastflow.tasks.work` writes them.
    """

    recordings: Sequence[bytes] = ()
    traces: Sequence[bytes] = ()
    verdicts: Sequence[Verdict] = ()
    faults: Sequence[RunFault] = ()
    behaviors: Sequence[bytes] = ()
    outputs: Sequence[bytes] = ()
    logs: Sequence[bytes] = ()


@dataclass(frozen=True, slots=True)
class Results:
    """A campaign directory that has been written.

    Attributes:
        faults: What of ours broke; without any, every run was judged as far as the oracles could.
        notes: What a user should know of the campaign's files, line by line as `terminal_lines` has it; `metadata.json`
            has all.
    """

    directory: Path
    summary: Summary
    faults: tuple[RunFault, ...]
    notes: tuple[str, ...]


def write_results(
    root: Path,
    campaign: Campaign,
    inputs: Inputs,
    instantiation: Instantiation,
    found: Callable[[Configuration], ConfigurationResult],
    *,
    runs: int,
    oracles: Sequence[str],
    keys: Keys,
    record: Mapping[str, Any] | None = None,
    faults: Iterable[RunFault] = (),
    created: datetime,
    work: Callable[[], Work],
    report: Callable[[Path], None],
) -> Results:
    """Write `root/<name>-<time>/`, report included; it appears whole or not at all.

    Args:
        inputs: The campaign's files as they were when it was loaded.
        instantiation: What is in the directory, that is, after `only` has been applied.
        found: Reads one configuration's artifacts; called once for each that is no duplicate, in order,
            so that only one configuration's recordings are in memory.
        runs: Runs asked for of each configuration: indices 0 to runs - 1.
        oracles: Names of the requested oracles, `success` first. A run without a verdict of one of them
            gets `not judged` with the fault as the reason.
        keys: Of the artifacts that `found` reads; name the code and the numeric class they follow from.
        record: What more `metadata.json` says, from the beginning on: what was asked, and the code in detail.
        faults: Those of no single configuration.
        created: Time in the directory's name.
        work: What the call has done so far.
        report: Writes evidence, figures and report into the directory it is given. What it raises
            is a fault of the campaign, but no reason to lose the tables.
    """
    with new_directory(root, campaign_name(campaign), created) as directory:
        place = directory.partial
        inputs.write(place)
        metadata = {**_metadata(campaign, keys, created), **(record or {})}
        _write_json(place / "metadata.json", metadata)  # for `resume`, should this process be killed
        _write_environments(place / "environments", inputs.maps, instantiation.configurations)
        _write_json(place / "coverage.json", instantiation.coverage)
        write_table(
            place / "configurations.parquet", CONFIGURATIONS, [*map(configuration_row, instantiation.configurations)]
        )
        write_table(place / "rejections.parquet", REJECTIONS, [*map(rejection_row, instantiation.rejections)])
        write_table(place / "exclusions.parquet", EXCLUSIONS, [*map(exclusion_row, instantiation.excluded)])

        run_rows: list[Row] = []
        verdict_rows: list[Row] = []
        all_faults = list(faults)
        for folder in ("recordings", "traces", "behaviors", "logs"):
            (place / folder).mkdir()
        for configuration in instantiation.configurations:
            if configuration.duplicate_of is None:
                result = found(configuration)
                for file, content in _contents(configuration.name, result, runs):
                    if content:
                        (place / file).parent.mkdir(exist_ok=True)
                        (place / file).write_bytes(content)
                run_rows += _run_rows(configuration, result.recordings, runs)
                verdict_rows += [verdict_row(configuration, v) for v in complete(result, runs, oracles)]
                all_faults += result.faults
        write_table(place / "runs.parquet", RUNS, run_rows)
        write_table(place / "verdicts.parquet", VERDICTS, verdict_rows)

        summary = summary_of(instantiation, verdict_rows, runs, oracles, work(), directory.final)
        _write_outcome(place, metadata, summary, all_faults)
        try:
            report(place)
        except Exception as error:
            LOGGER.exception("the report could not be made")
            all_faults.append(RunFault("", None, "report", f"{type(error).__name__}: {error}"))
        done = work()
        summary = replace(summary, cpu_s=done.cpu_s, wall_s=done.wall_s)
        _write_outcome(place, metadata, summary, all_faults)
    return Results(directory.final, summary, tuple(all_faults), tuple(terminal_lines(campaign.notes)))


def _contents(name: str, result: ConfigurationResult, runs: int) -> Iterator[tuple[str, bytes]]:
    """Place below the campaign directory, and content of each of a configuration's files."""
    yield f"recordings/{name}.parquet", one_block(result.recordings, runs)
    yield f"traces/{name}.parquet", one_block(result.traces, runs)
    yield f"behaviors/{name}.parquet", one_table(result.behaviors, runs)
    yield f"outputs/{name}.zip", one_archive(result.outputs, runs)
    yield f"logs/{name}.json", one_log(result.logs, runs)


def one_log(logs: Sequence[bytes], runs: int) -> bytes:
    """The run logs of all blocks as a JSON list, a block's host and versions with each of its runs; empty without any."""
    rows = []
    for content in map(json.loads, logs):
        where = {key: value for key, value in content.items() if key != "runs"}
        rows += [{**row, **where} for row in content["runs"] if row["run_index"] < runs]
    rows.sort(key=lambda row: row["run_index"])
    return json.dumps(rows, indent=1, ensure_ascii=False).encode() if rows else b""


def one_block(blocks: Sequence[bytes], runs: int) -> bytes:
    """All runs below `runs` as one block in order: the same bytes however they were blocked; empty without any."""
    if len(blocks) == 1 and all(row["run_index"] < runs for row in block_rows(blocks[0])):
        return blocks[0]
    found = {row["run_index"]: (row, columns) for block in blocks for row, columns in read_block(block)}
    wanted = [found[index] for index in sorted(found) if index < runs]
    return write_block([row for row, _ in wanted], levelled([columns for _, columns in wanted])) if wanted else b""


def block_rows(block: bytes) -> list[dict[str, Any]]:
    """The rows of a block's runs, without decoding the columns."""
    rows: list[dict[str, Any]] = json.loads(pq.read_schema(io.BytesIO(block)).metadata[ROWS_KEY])
    return rows


def complete(result: ConfigurationResult, runs: int, oracles: Sequence[str]) -> list[Verdict]:
    """A verdict for each run and oracle: what was missing is `not judged`, with the fault as its reason."""
    said = {(verdict.run_index, verdict.oracle): verdict for verdict in result.verdicts}
    return [
        said.get((run, oracle)) or Verdict(oracle, run, "not judged", _reason(result.faults, run))
        for run in range(runs)
        for oracle in oracles
    ]


def summary_of(
    instantiation: Instantiation,
    verdicts: Iterable[Row],
    runs: int,
    oracles: Sequence[str],
    work: Work,
    results: Path,
) -> Summary:
    """Count configurations, rejections and the rows of `verdicts.parquet`."""
    by_oracle: dict[str, list[Judgement]] = {oracle: [] for oracle in oracles}
    by_run: dict[tuple[str, int], list[Judgement]] = {}
    for row in verdicts:
        by_oracle[row["oracle"]].append(row["judgement"])
        by_run.setdefault((row["configuration"], row["run_index"]), []).append(row["judgement"])
    whole = counts_of(map(run_judgement, by_run.values()))
    duplicates = sum(c.duplicate_of is not None for c in instantiation.configurations)
    configurations = len(instantiation.configurations) - duplicates
    return Summary(
        configurations=configurations,
        rejected=len(instantiation.rejections),
        excluded=len(instantiation.excluded),
        duplicates=duplicates,
        runs=configurations * runs,
        **asdict(whole),
        **asdict(work),
        results=str(results),
        oracles={oracle: counts_of(said) for oracle, said in by_oracle.items()},
        excluded_by=_excluded_by(instantiation),
    )


def _excluded_by(instantiation: Instantiation) -> dict[str, dict[str, int]]:
    counts: dict[str, dict[str, int]] = {}
    for instance in instantiation.excluded:
        family = counts.setdefault(instance.family, {})
        family[instance.constraint] = family.get(instance.constraint, 0) + 1
    return counts


def campaign_name(campaign: Campaign) -> str:
    """`metadata.name`, else the file's stem."""
    return str(campaign.spec.metadata.get("name") or campaign.path.stem)


def _reason(faults: Sequence[RunFault], run: int) -> str:
    for fault in faults:
        if fault.run_index in (None, run):
            return f"our own fault in {fault.stage}: {fault.error}"
    return "our own fault: there is no verdict"


def _run_rows(configuration: Configuration, blocks: Sequence[bytes], runs: int) -> list[Row]:
    rows = {row["run_index"]: row for block in blocks for row in block_rows(block) if row["run_index"] < runs}
    return [run_table_row(configuration, rows[index]) for index in sorted(rows)]


def _write_environments(
    directory: Path, maps: Mapping[str, OccupancyMap], configurations: Iterable[Configuration]
) -> None:
    for configuration in configurations:
        map_file = configuration.scenario.environment.get(MAP_KEY)
        if isinstance(map_file, FileContent) and not (directory / map_file.digest).exists():
            write_environment(directory / map_file.digest, map_file, maps)


def _metadata(campaign: Campaign, keys: Keys, created: datetime) -> dict[str, Any]:
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
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
