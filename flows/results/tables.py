"""Rows of the campaign directory's tables: of configurations, of runs, and of verdicts."""

from collections.abc import Sequence
from operator import itemgetter
from typing import Final

from vastflow.oracles.judgement.verdict import Verdict, metrics_text
from vastflow.oracles.results.schema import RUNS, Columns, Row, json_text
from vastflow.producers.model.configuration import Configuration, ExcludedInstance, RejectedInstance
from vastflow.sim.loop.standstill import STOOD_STILL
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.reading.checked import checked_digest


def configuration_row(configuration: Configuration) -> Row:
    """A row of `configurations.parquet`."""
    scenario = configuration.scenario
    content: dict[str, Value] = {
        "environment": scenario.environment,
        "task": scenario.task,
        "system": scenario.system,
    }
    if scenario.programs is not None:
        content["programs"] = scenario.programs.content
    return {
        "name": configuration.name,
        "family": configuration.family,
        "scenario_digest": scenario.digest,
        "checked_digest": checked_digest(scenario),
        "duplicate_of": configuration.duplicate_of,
        "environment": environment_digest(configuration),
        "abstract": scenario.abstract if isinstance(scenario.abstract, str) else json_text(scenario.abstract),
        "timeout_s": scenario.timeout_s,
        "scenario": json_text(content),
        "factors": json_text(configuration.factors),
        "provenance": json_text(configuration.provenance),
        "steps": json_text(
            [{"producer": step.producer, "keys": step.keys, "choice": step.choice} for step in configuration.steps]
        ),
    }


def environment_digest(configuration: Configuration) -> str | None:
    """Digest of the configuration's map, None for a scenario without one."""
    map_file = configuration.scenario.environment.get("map_file")
    return map_file.digest if isinstance(map_file, FileContent) else None


def rejection_row(rejected: RejectedInstance) -> Row:
    """A row of `rejections.parquet`."""
    return {
        "family": rejected.family,
        "parent": rejected.parent,
        "producer": rejected.producer,
        "reason": rejected.reason,
        "requested": json_text(rejected.requested),
        "inputs": json_text(rejected.inputs),
    }


def exclusion_row(excluded: ExcludedInstance) -> Row:
    """A row of `exclusions.parquet`."""
    return {
        "family": excluded.family,
        "name": excluded.name,
        "constraint": excluded.constraint,
        "values": json_text(excluded.values),
    }


def run_columns(configuration: Configuration, runs: Sequence[Row]) -> Columns:
    """Columns of `runs.parquet`, from rows of a configuration's runs in a block."""
    copied = zip(*map(_COPIED_OF, runs), strict=True) if runs else ((),) * len(_COPIED)
    return {
        "configuration": [configuration.name] * len(runs),
        "family": [configuration.family] * len(runs),
        **dict(zip(_COPIED, copied, strict=True)),
        "contacts": [sum(event["kind"] == "contact" for event in run["events"]) for run in runs],
        "stood_still": [
            next((event["what"] for event in run["events"] if event["kind"] == STOOD_STILL), None) for run in runs
        ],
    }


_COPIED: Final = tuple(
    name for name in RUNS.names if name not in ("configuration", "family", "contacts", "stood_still")
)
_COPIED_OF: Final = itemgetter(*_COPIED)


def verdict_columns(configuration: Configuration, verdicts: Sequence[Verdict]) -> Columns:
    """Columns of `verdicts.parquet`."""
    return {
        "configuration": [configuration.name] * len(verdicts),
        "family": [configuration.family] * len(verdicts),
        "run_index": [verdict.run_index for verdict in verdicts],
        "oracle": [verdict.oracle for verdict in verdicts],
        "judgement": [verdict.judgement for verdict in verdicts],
        "reason": [verdict.reason for verdict in verdicts],
        "metrics": [metrics_text(verdict.metrics) for verdict in verdicts],
    }
