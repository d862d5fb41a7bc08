"""Recorded tables: the run tables of an executed campaign, for authors of notebooks."""

from pathlib import Path

from vastflow.oracles.judgement.notebook import RunTables, run_tables
from vastflow.oracles.observation.situation import situation_of
from vastflow.oracles.observation.trace import trace_of
from vastflow.oracles.results.executed import KeptFiles, scenario_of_row
from vastflow.oracles.results.schema import table_rows
from vastflow.sim.model.blocks import read_block, read_recordings


def recorded_tables(directory: Path | str, configuration: str) -> RunTables:
    """The tables of all recorded runs of a configuration.

    Raises:
        ValueError: the directory has no recordings of a configuration of this name.
    """
    directory = Path(directory)
    known = {row["name"]: row for row in table_rows(directory / "configurations.parquet")}
    files = [directory / folder / f"{configuration}.parquet" for folder in ("recordings", "traces")]
    if configuration not in known or not all(file.is_file() for file in files):
        recorded = ", ".join(sorted(file.stem for file in (directory / "recordings").glob("*.parquet"))) or "nothing"
        raise ValueError(f"{directory} has no recordings of {configuration!r}; it has those of {recorded}")
    scenario = scenario_of_row(known[configuration], KeptFiles(directory))
    recordings, observed = read_recordings(files[0]), read_block(files[1])
    traces = [trace_of(each, *derived) for each, derived in zip(recordings, observed, strict=True)]
    return run_tables(traces, situation_of(scenario))
