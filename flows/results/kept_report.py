"""A report that is kept in the store: what of a campaign directory follows from the campaign's content alone, as one artifact."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from vastflow.flows.results.campaign_tables import LOGS_FILE
from vastflow.flows.results.directory import WRITER
from vastflow.flows.results.kept_parts import KeptParts
from vastflow.flows.results.report_key import written_by
from vastflow.flows.results.summary import OutcomeTally
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.page.work_section import with_work
from vastflow.tasks.artifact import inside
from vastflow.tasks.source_files import SourceFiles
from vastflow.tasks.store import Lost, Store, StoreError

LOGGER: Final = logging.getLogger("vastflow.results")
REPORT: Final = "report.html"

_RUN_LOGS: Final = "runs.jsonl"
_OTHERS: Final = frozenset(
    {
        *("metadata.json", "campaign.vast", WRITER),
        *("inputs", "environments", "recordings", "traces", "outputs", "logs"),
    }
)
"""What of a campaign directory is a call's own, or a configuration's."""


@dataclass(frozen=True, slots=True)
class Restored:
    """What a kept report says of its campaign, and what it could not give back.

    Attributes:
        logs: Whether the run logs came with it.
    """

    tally: OutcomeTally
    logs: bool


@dataclass(frozen=True, slots=True)
class KeptReport:
    """The place of a campaign's report in the store.

    Attributes:
        key: See `vastflow.flows.results.report_key.report_key`.
        sources: The source files of which its source digest is.
        parts: Where parts of its tables are; None where none is kept.
    """

    store: Store
    key: str
    sources: SourceFiles | None = None
    parts: KeptParts | None = None

    def restore(self, place: Path) -> Restored | None:
        """Write everything into a campaign directory, the facts of an earlier call in the report; None if it is not kept."""
        artifact = self.store.find(self.key)
        if artifact is None:
            return None
        said = artifact.info
        try:
            contents = {str(file): self.store.load(artifact, name) for name, file in said["places"].items()}
            by_oracle = {name: Counts(**each) for name, each in said["by_oracle"].items()}
            tally = OutcomeTally(Counts(**said["counts"]), by_oracle, said["stood_still"])
        except Lost:  # it is gone now, and made again
            return None
        if not _OTHERS.isdisjoint(Path(file.casefold()).parts[0] for file in contents):
            self.store.discard(self.key, "it has files that no report has")
            return None
        for name, content in contents.items():
            file = inside(place, name)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        logs = self.store.beside(self.key, _RUN_LOGS)
        if logs is not None:
            (place / LOGS_FILE).parent.mkdir(exist_ok=True)
            (place / LOGS_FILE).write_bytes(logs)
        return Restored(tally, logs is not None)

    def keep(self, place: Path, tally: OutcomeTally, parts: Sequence[str]) -> None:
        """Keep what was written into a campaign directory. A store that does not take it costs the next call time, no more.

        Args:
            parts: Keys of the parts of its tables.
        """
        files = sorted(file for entry in place.iterdir() if entry.name not in _OTHERS for file in _files(entry))
        places = {file.relative_to(place).as_posix().replace("/", "-"): file for file in files}
        info: dict[str, Any] = {
            "places": {name: file.relative_to(place).as_posix() for name, file in places.items()},
            "parts": list(parts),
            **asdict(tally),
        }
        logs = place / LOGS_FILE
        sidecar = {_RUN_LOGS: logs.read_bytes()} if logs.is_file() else {}
        try:
            if self.sources is not None:
                self.sources.check_since_start(written_by())
            self.store.put(self.key, {name: file.read_bytes() for name, file in places.items()}, info, sidecar)
        except StoreError as error:
            LOGGER.warning("the report is not kept for the next time: %s", error)


def renew_work(place: Path, metadata: Mapping[str, Any]) -> None:
    """Let a report that was kept say the facts of this call.

    Args:
        metadata: `metadata.json` as it is by now.
    """
    report = place / REPORT
    if report.is_file():
        report.write_text(with_work(report.read_text(encoding="utf-8"), metadata), encoding="utf-8")


def _files(entry: Path) -> Iterable[Path]:
    return (file for file in entry.rglob("*") if file.is_file()) if entry.is_dir() else (entry,)
