"""The headline of a campaign: the one sentence on its rate that every page, command, and file has."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from vastflow.oracles.statistics.intervals import Interval

_NARROW: Final = 50
"""Width in thousandths of intervals that are shown with a decimal."""


@dataclass(frozen=True, slots=True)
class Headline:
    """A campaign's rate with what follows for these configurations, and for others.

    Attributes:
        rate: Mean of the configurations' rates; None where nothing was judged and for a search.
        these: Interval if these same configurations were run again; None like `rate`.
        others: Interval for others, as named by `kind`; None where nothing follows for them.
        configurations: Number of those with judged runs.
        left_out: Number of configurations without any, which are in no rate.
        finding: Finding of a search, in place of a rate.
    """

    rate: float | None
    these: Interval | None = None
    others: Interval | None = None
    configurations: int = 0
    left_out: int = 0
    kind: str = "others of their kind"
    finding: str = ""

    @property
    def text(self) -> str:
        """`76 % passed; 69–81 % for these configurations, 37–94 % for others of their kind`."""
        if self.finding:
            return self.finding
        if self.rate is None:
            return "nothing was judged" if self.left_out else "nothing was run"
        these = "these configurations" if self.configurations > 1 else "this configuration"
        said = f"{percent_text(self.rate)} passed"
        said += f"; {span_text(*self.these.thousandths)} for {these}" if self.these else ""
        said += f", {span_text(*self.others.thousandths)} for {self.kind}" if self.others else ""
        number = f"{self.left_out:,} {'configuration has' if self.left_out == 1 else 'configurations have'}"
        return f"{said}; {number} no judged run" if self.left_out else said

    @property
    def as_json(self) -> dict[str, Any]:
        """The sentence, and its numbers."""
        ends = {name: each and asdict(each) for name, each in (("these", self.these), ("others", self.others))}
        return {"text": self.text, "rate": self.rate, **ends}


def robot_text(metadata: Mapping[str, Any]) -> str:
    """Return the summary of the robot in the content of `metadata.json`; empty where it has none."""
    robots = metadata.get("robots")
    found = [each.get("summary") for each in robots if isinstance(each, dict)] if isinstance(robots, list) else []
    said = [*dict.fromkeys(each for each in found if isinstance(each, str))]
    return f"{said[0]} (the first of {len(said)} robots)" if said[1:] else "".join(said)


def percent_text(rate: float) -> str:
    """A rate in percent with as many digits as tell it from 0 and 1: `76 %`, `99.97 %`."""
    for digits in (0, 1, 2, 3):
        text = f"{100 * rate:.{digits}f}"
        if rate in (0.0, 1.0) or float(text) not in (0.0, 100.0):
            break
    return f"{text} %"


def span_text(low: int, high: int) -> str:
    """An interval, from ends in thousandths: `52–71 %`, rounded outwards, with a digit more if narrow."""
    ends = (low / 10, high / 10) if high - low < _NARROW else (low // 10, -(-high // 10))
    return f"{ends[0]}–{ends[1]} %"
