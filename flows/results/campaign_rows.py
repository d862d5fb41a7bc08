"""The rows of a campaign's runs: each part of its tables from the store, or of what was found of its configurations."""

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from vastflow.flows.request.members import Runs, runs_of
from vastflow.flows.results.campaign_tables import CampaignTables, RunLogs
from vastflow.flows.results.found import Found, RunFault
from vastflow.flows.results.kept_parts import LEAST, KeptParts, parts_of
from vastflow.flows.results.summary import OutcomeTally
from vastflow.flows.results.table_part import PartRows
from vastflow.producers.model.configuration import Configuration


@dataclass(frozen=True, slots=True)
class WrittenRows:
    """What the rows of a campaign come to.

    Attributes:
        kept: Keys of the parts that the store has, or was to have.
    """

    tally: OutcomeTally
    faults: tuple[RunFault, ...]
    kept: tuple[str, ...]


def write_rows(
    place: Path,
    configurations: Sequence[Configuration],
    files: Iterator[tuple[Configuration, Found]],
    runs: Runs,
    oracles: Sequence[str],
    parts: KeptParts | None,
) -> WrittenRows:
    """Write the tables of runs and the run logs into a campaign directory.

    Args:
        configurations: Those that are no duplicates.
        files: Gives each of them with what was found of it, in order.
        runs: Of each.
        oracles: Names of the oracles, in order.
        parts: Where the store has parts of the tables; None where it shall have none.
    """
    faults: list[RunFault] = []
    kept: list[str] = []
    with CampaignTables(place, oracles) as tables, closing(RunLogs(place)) as logs:
        for members in parts_of(configurations):
            wanted = [runs_of(runs, each.name) for each in members]
            key = parts.key(members, wanted, oracles) if parts is not None and len(members) >= LEAST else None
            restored = parts.restore(key) if parts is not None and key is not None else None
            part, known = restored or (None, frozenset())
            rows, sound = PartRows(oracles) if part is None else None, set[str]()
            for (configuration, found), count in zip(islice(files, len(members)), wanted, strict=True):
                if rows is not None:
                    rows.add(configuration, found, count)
                sound |= logs.add(configuration.name, found.logs, known)
                faults += found.faults
            if part is None and rows is not None:
                part = rows.part()
                if parts is not None and key is not None and not faults:
                    parts.keep(key, part, sound)
            if part is not None:
                tables.add(members, part)
            if key is not None:
                kept.append(key)
    return WrittenRows(tables.tally, tuple(faults), tuple(kept))
