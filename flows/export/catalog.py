"""The export formats of vastflow itself."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Any, Final

import yaml

from vastflow.flows.export.format import ExportedCampaign, ExportedConfiguration, ExportedFile, Format
from vastflow.flows.export.junit import Case, Suite, campaign_report
from vastflow.flows.export.run import case_of, files_of

SHARED: Final = "_config"
"""Folder of files that all configurations share; no configuration has this name."""
BRIEFLY: Final = ("simulated_time_s", "wall_time_s", "outcome")
"""Properties that a case keeps in a report of many."""


class JUnit(Format):
    """All runs as one JUnit report, a suite for each configuration."""

    def files(self, campaign: ExportedCampaign) -> Iterator[ExportedFile]:
        """Yield the report."""
        suites = [
            Suite(each.name, [_brief(case_of(run)) for run in each.runs])
            for each in campaign.configurations
            if each.duplicate_of is None
        ]
        yield "test.xml", campaign_report(campaign.name, suites, campaign.headline)


class Csv(Format):
    """The tables of each run as CSV."""

    def files(self, campaign: ExportedCampaign) -> Iterator[ExportedFile]:
        """Yield them in a folder for each run."""
        for each in campaign.configurations:
            for run in each.runs:
                for name, content in (*files_of(run, case_of(run)), *run.outputs.items()):
                    if name.endswith(".csv"):
                        yield f"{each.name}/{run.run_index}/{name}", content


class Vast(Format):
    """A folder for each configuration and run, as RoboVAST lays it out, with JUnit reports, tables, and logs.

    Args:
        outputs: Folder of a run's output files, with `/`; empty for the run's own folder, as in RoboVAST.
    """

    def __init__(self, outputs: str = "outputs/") -> None:
        self._outputs = outputs

    def files(self, campaign: ExportedCampaign) -> Iterator[ExportedFile]:
        """Yield the campaign's own files, the folders of its configurations, and the report of all runs."""
        yield from ((f"{SHARED}/{name}", path) for name, path in campaign.files.items())
        suites = []
        for each in campaign.configurations:
            values = yaml.safe_dump({each.scenario: _with_file_paths(each.values)}, sort_keys=False, allow_unicode=True)
            yield f"{each.name}/scenario.config", values.encode()
            if each.duplicate_of is not None:
                yield f"{each.name}/duplicate_of", f"{each.duplicate_of}\n".encode()
                continue
            cases: list[Case] = []
            yield from self._runs(each, cases)
            suites.append(Suite(each.name, cases))
        yield "test.xml", campaign_report(campaign.name, suites, campaign.headline)

    def _runs(self, configuration: ExportedConfiguration, cases: list[Case]) -> Iterator[ExportedFile]:
        for run in configuration.runs:
            case, place = case_of(run), f"{configuration.name}/{run.run_index}"
            yield from ((f"{place}/{name}", content) for name, content in files_of(run, case))
            yield from ((f"{place}/{self._outputs}{name}", content) for name, content in run.outputs.items())
            cases.append(_brief(case))


def _brief(case: Case) -> Case:
    # a report of many runs with all properties would take hundreds of megabytes
    return replace(case, properties={name: case.properties[name] for name in BRIEFLY if name in case.properties})


def _with_file_paths(value: Any) -> Any:
    """`value` with files as paths from the folder of a configuration."""
    if isinstance(value, PurePosixPath):
        return f"../{SHARED}/{value}"
    if isinstance(value, dict):
        return {key: _with_file_paths(item) for key, item in value.items()}
    return [_with_file_paths(item) for item in value] if isinstance(value, list) else value
