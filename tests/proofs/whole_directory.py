"""Write a whole campaign directory from artifacts, for tests."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from vastflow.flows.request.campaign_file import campaign_name
from vastflow.flows.results.directory import new_directory
from vastflow.flows.results.results import write_report, write_tables
from vastflow.flows.results.summary import Results, Work
from vastflow.oracles.judgement.verdict import Verdict
from vastflow.producers.campaign import Campaign
from vastflow.tasks.engine.engine import RunFault


@dataclass(frozen=True, slots=True)
class ConfigurationResult:
    """A `vastflow.flows.results.found.StoredResult` of values."""

    recordings: Sequence[bytes] = ()
    traces: Sequence[bytes] = ()
    verdicts: Sequence[Verdict] = ()
    faults: Sequence[RunFault] = ()
    behaviors: Sequence[bytes] = ()
    outputs: Sequence[bytes] = ()
    logs: Sequence[bytes] = ()
    exact: bool = False
    causes: Mapping[int, str] = field(default_factory=dict)


def write_results(
    root: Path,
    campaign: Campaign,
    *tabled: Any,
    created: datetime,
    work: Callable[[], Work],
    report: Callable[[Path], None],
    before_report: Callable[[Path], None] = lambda place: None,
    **named: Any,
) -> Results:
    """Write `root/<name>-<time>/`, report included; it appears whole or not at all.

    Args:
        tabled, named: What `write_tables` is given beside directory and campaign.
        before_report: Called with the directory when all is there but the report, which may be one that was kept.
    """
    with new_directory(root, campaign_name(campaign), created) as directory:
        assessed = write_tables(directory, campaign, *tabled, created=created, work=work, **named)
        before_report(directory.partial)
        return write_report(assessed, report, work)
