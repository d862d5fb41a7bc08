"""Recorded tables: the run tables of a campaign that was executed, for whoever writes a notebook."""

import json
from pathlib import Path

from vastflow.oracles.judgement.notebook import RunTables, run_tables
from vastflow.oracles.observation.situation import situation_of
from vastflow.oracles.observation.trace import trace_of
from vastflow.oracles.results.column import table_rows
from vastflow.oracles.results.executed import KeptFiles, executed_scenario
from vastflow.sim.model.blocks import read_block, read_recordings


def recorded_tables(directory: Path | str, configuration: str) -> RunTables:
    """The tables of all runs of a configuration of a campaign directory: what a notebook's author looks at.

    Raises:
        ValueError: the directory has no recordings of a configuration of this name.
    """
    directory = Path(directory)
    known = {row["name"]: row for row in table_rows(directory / "configurations.parquet")}
    files = [directory / folder / f"{configuration}.parquet" for folder in ("recordings", "traces")]
    if configuration not in known or not all(file.is_file() for file in files):
        recorded = ", ".join(sorted(file.stem for file in (directory / "recordings").glob("*.parquet"))) or "nothing"
        raise ValueError(f"{directory} has no recordings of {configuration!r}; it has those of {recorded}")
    row = known[configuration]
    abstract = json.loads(row["abstract"]) if row["abstract"].startswith("{") else row["abstract"]
    scenario = executed_scenario(abstract, 0.0, json.loads(row["scenario"]), KeptFiles(directory))
    recordings, observed = read_recordings(files[0]), read_block(files[1])
    traces = [trace_of(each, *derived) for each, derived in zip(recordings, observed, strict=True)]
    return run_tables(traces, situation_of(scenario))
