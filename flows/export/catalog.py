"""The export formats of vastflow itself."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Final

import yaml

from vastflow.flows.export.format import ExportedCampaign, ExportedConfiguration, ExportedFile, Format
from vastflow.flows.export.junit import Case, Suite, campaign_report
from vastflow.flows.export.robovast import campaign_files, configuration_files, plain, system_info
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

    Its library takes each folder with a `test.xml` for a run, so the report of all runs is `junit.xml`.

    Args:
        outputs: Second folder of a run's output files, with `/`; empty for none beside the run's own folder, where RoboVAST has them.
    """

    def __init__(self, outputs: str = "outputs/") -> None:
        self._outputs = outputs

    def files(self, campaign: ExportedCampaign) -> Iterator[ExportedFile]:
        """Yield the campaign's own files, the folders of its configurations, and the report of all runs."""
        yield from ((f"{SHARED}/{name}", path) for name, path in campaign.files.items())
        yield f"{SHARED}/.campaign", b"campaign.vast\n"  # RoboVAST's word for which .vast of several it is
        suites = []
        hosts: dict[str, list[str | None]] = {}
        for each in campaign.configurations:
            values = yaml.safe_dump(
                {each.scenario: plain(each.values, f"../{SHARED}/")}, sort_keys=False, allow_unicode=True
            )
            yield f"{each.name}/scenario.config", values.encode()
            yield from ((f"{each.name}/{name}", content) for name, content in configuration_files(each, campaign))
            if each.duplicate_of is not None:
                yield f"{each.name}/duplicate_of", f"{each.duplicate_of}\n".encode()
                continue
            cases: list[Case] = []
            yield from self._runs(each, cases, campaign)
            hosts[each.name] = [case.properties.get("host") for case in cases]
            suites.append(Suite(each.name, list(map(_brief, cases))))
        yield from campaign_files(campaign, hosts)
        yield "junit.xml", campaign_report(campaign.name, suites, campaign.headline)

    def _runs(
        self, configuration: ExportedConfiguration, cases: list[Case], campaign: ExportedCampaign
    ) -> Iterator[ExportedFile]:
        for run in configuration.runs:
            case, place = case_of(run), f"{configuration.name}/{run.run_index}"
            files = dict(files_of(run, case))
            if run.host:
                files["sysinfo.yaml"] = system_info(run.host["host"], campaign.metadata.get("host", {}))
            if self._outputs:
                files |= {f"{self._outputs}{name}": content for name, content in run.outputs.items()}
            folders = {str(folder) for name in files for folder in PurePosixPath(name).parents}
            for name, content in run.outputs.items():
                if name not in folders and not files.keys() & {
                    name,
                    name.partition("/")[0],
                }:  # or it is in outputs/ alone
                    files[name] = content
            yield from ((f"{place}/{name}", content) for name, content in files.items())
            kept = ("host", *BRIEFLY)
            cases.append(
                replace(case, properties={name: case.properties[name] for name in kept if name in case.properties})
            )


def _brief(case: Case) -> Case:
    # a report of many runs with all properties would take hundreds of megabytes
    return replace(case, properties={name: case.properties[name] for name in BRIEFLY if name in case.properties})
