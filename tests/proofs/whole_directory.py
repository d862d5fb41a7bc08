"""Write a whole campaign directory from artifacts, for tests."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from vastflow.flows.request.campaign_file import campaign_name
from vastflow.flows.results import results
from vastflow.flows.results.directory import new_directory
from vastflow.flows.results.summary import Results
from vastflow.oracles.judgement.verdict import Verdict
from vastflow.producers.campaign import Campaign
from vastflow.tasks.engine.engine import RunFault


@dataclass(frozen=True, slots=True)
class ConfigurationResult:
    """A `vastflow.flows.results.tables.StoredResult` of values."""

    recordings: Sequence[bytes] = ()
    traces: Sequence[bytes] = ()
    verdicts: Sequence[Verdict] = ()
    faults: Sequence[RunFault] = ()
    behaviors: Sequence[bytes] = ()
    outputs: Sequence[bytes] = ()
    logs: Sequence[bytes] = ()
    exact: bool = False
    causes: Mapping[int, str] = field(default_factory=dict)


def write_results(root: Path, campaign: Campaign, *values: Any, created: datetime, **named: Any) -> Results:
    """Write `root/<name>-<time>/`, report included; it appears whole or not at all.

    Args:
        values, named: What `results.write_results` is given beside directory and campaign.
    """
    with new_directory(root, campaign_name(campaign), created) as directory:
        return results.write_results(directory, campaign, *values, created=created, **{"record": {}, **named})
