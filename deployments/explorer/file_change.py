"""Changes of a campaign file since the previous campaign of the same name."""

import difflib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from vastflow.deployments.explorer.directories import CampaignDirectory
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.files import read_text

MOST_LINES: Final = 400
"""Lines of a difference that are shown."""
_MOST_COMPARED: Final = 20_000
"""Lines of both files; more would take seconds."""
_AROUND: Final = 2


@dataclass(frozen=True, slots=True)
class FileChange:
    """Differences between two campaigns of one name.

    Attributes:
        previous: The earlier campaign.
        lines: Lines of the unified difference, with a few equal ones around.
        left_out: Number of lines that are not among them.
        others: Sentences on what changed outside the file, such as versions and code.
        compared: False for a file that can't be read or is too long; then `others` says so.
    """

    previous: CampaignDirectory
    added: int = 0
    removed: int = 0
    lines: tuple[str, ...] = ()
    left_out: int = 0
    others: tuple[str, ...] = ()
    compared: bool = True

    @property
    def summary(self) -> str:
        """The change in a few words."""
        lines = f"+{self.added:,} −{self.removed:,} lines" if self.added or self.removed else "same file"
        if not self.compared:
            return "file not compared"
        return f"{lines}, {len(self.others)} more" if self.others else lines


def file_change(previous: CampaignDirectory, campaign: CampaignDirectory) -> FileChange:
    """Return what changed from one finished campaign to a later one."""
    try:
        then, now = (_file_lines(each.path / "campaign.vast") for each in (previous, campaign))
    except UnusableDirectory as error:
        return FileChange(previous, others=(str(error),), compared=False)
    others = _others(previous, campaign)
    if len(then) + len(now) > _MOST_COMPARED:
        words = "the same" if then == now else f"other text, {len(then):,} lines before"
        return FileChange(previous, others=(f"the file of {len(now):,} lines has {words}", *others), compared=False)
    lines = list(difflib.unified_diff(then, now, n=_AROUND, lineterm=""))[2:]  # without the files' names
    signs = [line[0] for line in lines]
    return FileChange(
        previous,
        added=signs.count("+"),
        removed=signs.count("-"),
        lines=tuple(lines[:MOST_LINES]),
        left_out=max(0, len(lines) - MOST_LINES),
        others=others,
    )


def _file_lines(file: Path) -> list[str]:
    with reading(file):
        return read_text(file).splitlines()


def _others(previous: CampaignDirectory, campaign: CampaignDirectory) -> tuple[str, ...]:
    from vastflow.flows.results.provenance import campaign_changes  # half a second of imports

    try:
        with reading(campaign.path):
            return tuple(campaign_changes(previous.metadata, campaign.metadata, previous.path))
    except UnusableDirectory:
        return ("versions and code can't be compared, as one of the campaigns has no record of them",)
