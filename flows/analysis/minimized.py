"""The result of a minimization: as text, as JSON, and as a comment of its campaign file."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from vastflow.flows.analysis.candidate_file import FILE
from vastflow.flows.analysis.failing import Failing
from vastflow.flows.results.inputs import write_files
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.statistics.classes import StoppingRule
from vastflow.oracles.statistics.intervals import clopper_pearson_intervals, interval
from vastflow.producers.minimization.circumstance import LEVELS, Circumstance
from vastflow.producers.minimization.minimize import Minimum

PICTURE: Final = "before-after.png"


@dataclass(frozen=True)
class Minimized:
    """The result of a minimization.

    Attributes:
        text, files: The minimal campaign file, and its other files by their path beside it.
        picture: PNG of the scenario before and after.
        runs, executed: Number of runs of trials and confirmations, and of those that were not cached.
    """

    failing: Failing
    rule: StoppingRule
    minimum: Minimum
    text: str = field(repr=False)
    files: Mapping[str, bytes] = field(repr=False)
    picture: bytes = field(repr=False)
    runs: int
    executed: int

    def write(self, folder: Path) -> list[Path]:
        """Write the campaign file with its files, and the picture; return the paths of file and picture."""
        write_files(folder, {**self.files, FILE: self.text.encode(), PICTURE: self.picture})
        return [folder / FILE, folder / PICTURE]


NOTHING = "nothing but the map and the path"


def comment_of(failing: Failing, minimum: Minimum) -> str:
    """Return the first lines of the written campaign file."""
    cause = ", ".join(f"{each.text}{_level(minimum, each)}" for each in minimum.cause) or NOTHING
    left = "".join(f"# Not tried without: {each.text}.\n" for each in minimum.not_tried)
    return (
        f"# {failing.name} of {failing.directory.resolve().name}, minimized: {_confirmed(minimum)}.\n"
        f"# Its failure needs {cause}.\n{left}\n"
    )


def minimized_text(found: Minimized, written: list[str]) -> Iterator[str]:
    """Yield lines for the terminal."""
    minimum, gone = found.minimum, taken_away(found)
    paths = [each for each in found.failing.subject.circumstances if not each.can_be_left_out]
    parts = {
        "can't be removed, thus the cause:": [
            f"{each.text}{_level(minimum, each)}; without it: {said.text}" for each, said in minimum.cause.items()
        ]
        or [NOTHING],
        "kept, since it could not be tried without:": [
            f"{each.text}; {said.reason}" for each, said in minimum.not_tried.items()
        ],
        f"removed: {count_text(len(gone), 'value')}": _in_file(found, gone),
        "shorter:": [f"{each.text}{level}" for each in paths if (level := _level(minimum, each))],
    }
    yield f"{found.failing.name} by {found.failing.oracle}, minimized: {_confirmed(minimum)}"
    yield ""
    for title, lines in parts.items():
        if lines:
            yield title
            yield from (f"  {line}" for line in lines)
    yield ""
    error = f"error of a trial at most {found.rule.error:.0%}"
    yield f"{found.runs} runs of {len(minimum.tried)} candidates, {found.executed} executed; {error}"
    yield from written


def minimized_json(found: Minimized, written: list[str]) -> dict[str, Any]:
    """Return the result as JSON values."""
    minimum, rule = found.minimum, found.rule
    confirmed = minimum.confirmation
    bounds = interval(clopper_pearson_intervals(confirmed.failed, confirmed.judged))
    levels = {each.text: level / LEVELS for each, level in minimum.candidate.levels}
    return {
        "configuration": found.failing.name,
        "oracle": found.failing.oracle,
        "rate": round(1 - rule.bounds.systematic, 6),
        "error": rule.error,
        "confirmed": {"failed": confirmed.failed, "runs": confirmed.judged, "interval": [bounds.low, bounds.high]},
        "cause": [
            {"what": each.text, "without": said.standing, "failed": said.failed, "runs": said.judged}
            for each, said in minimum.cause.items()
        ],
        "not_tried": [{"what": each.text, "reason": said.reason} for each, said in minimum.not_tried.items()],
        "taken_away": _in_file(found, taken_away(found)),
        "levels": dict(sorted(levels.items())),
        "candidates": len(minimum.tried),
        "runs": found.runs,
        "executed": found.executed,
        "files": written,
    }


def taken_away(found: Minimized) -> list[Circumstance]:
    """Return the circumstances that the failure does not need."""
    kept = found.minimum.candidate.kept
    return [each for each in found.failing.subject.circumstances if each.can_be_left_out and each not in kept]


def _in_file(found: Minimized, circumstances: list[Circumstance]) -> list[str]:
    """Return the texts of the circumstances that the user's files contain."""
    return [each.text for each in circumstances if each.key not in found.failing.assumed]


def _confirmed(minimum: Minimum) -> str:
    said = minimum.confirmation
    bounds = interval(clopper_pearson_intervals(said.failed, said.judged))
    rate = f"{100 * said.failed / said.judged:.0f} % [{100 * bounds.low:.0f}, {100 * bounds.high:.0f}]"
    return f"fails {rate} of {said.judged} fresh runs"


def _level(minimum: Minimum, circumstance: Circumstance) -> str:
    level = dict(minimum.candidate.levels).get(circumstance)
    if level is None:
        return ""
    if not circumstance.can_be_left_out:
        return f", {level}/{LEVELS} of it"
    return f" at {level}/{LEVELS} of the distance from its default {circumstance.default:g}"
