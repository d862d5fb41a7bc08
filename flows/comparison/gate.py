"""The gate on a loss of success rate."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, Literal, TypeAlias

from vastflow.flows.terminal.words import count_text
from vastflow.oracles.evidence.pairing import Pairing
from vastflow.oracles.statistics.comparison import RateDifference, Target
from vastflow.oracles.statistics.intervals import needed

Status: TypeAlias = Literal[
    "nothing changed",
    "ruled out",
    "not ruled out",
    "loss shown",
    "too few paths",
    "unequal",
    "not judged",
    "new faults",
]

HOLDS: Final = 0
DOES_NOT_HOLD: Final = 1
CANT_BE_CLAIMED: Final = 4


@dataclass(frozen=True, eq=False)
class Gate:
    """The gate of a comparison.

    Faults, runs without a counterpart, and runs that were not judged are checked first, since each could hide a loss.

    Attributes:
        whole: The difference over all judged pairs.
        target: The population of its claim.
        margin: Accepted loss, as a share of the runs.
        new_faults: Faults of the candidate in configurations without a fault in the baseline.
        same_keys: Whether both campaigns were computed from equal scenarios by equal code.
    """

    pairing: Pairing = field(repr=False)
    whole: RateDifference
    target: Target
    margin: float
    oracle: str | None
    new_faults: int
    same_keys: bool

    @property
    def needed(self) -> int | None:
        """Unchanged pairs, or paths for other scenarios, that rule out the margin; None if no number does."""
        return needed(self.margin)

    @property
    def holds(self) -> bool:
        """Whether a loss of the margin or more is ruled out."""
        return self.status in ("nothing changed", "ruled out")

    @property
    def exit_code(self) -> int:
        """The exit code of the command."""
        return HOLDS if self.holds else CANT_BE_CLAIMED if self.status == "too few paths" else DOES_NOT_HOLD

    @cached_property
    def status(self) -> Status:
        """The gate holds for `nothing changed` and `ruled out`, and can't be claimed for `too few paths`."""
        if self.new_faults:
            return "new faults"
        if self.pairing.unpaired:
            return "unequal"
        runs = len(self.pairing.configuration)
        if 2 * self.whole.pairs <= runs or self._no_longer_judged > self.margin * runs:
            return "not judged"
        if self.same_keys and self.whole.lost == self.whole.gained == 0:
            return "nothing changed"
        few = self.needed is None or self.whole.paths < self.needed
        if self.target == "others" and self.whole.difference >= -self.margin and few:
            return "too few paths"
        if self.whole.non_inferior(self.margin):
            return "ruled out"
        return "loss shown" if self.whole.interval[1] < 0.0 else "not ruled out"

    @property
    def text(self) -> str:
        """The gate as a sentence."""
        about = "these scenarios" if self.target == "these" else "others of their kind"
        loss = f"a loss of {100 * self.margin:g} points"
        end = f"(lower end of the interval {100 * self.whole.interval[0]:+.2f})"
        match self.status:
            case "nothing changed":
                return "gate holds: nothing changed, both campaigns have the same scenarios, code, and seeds"
            case "ruled out":
                return f"gate holds: {loss} or more in {about} is ruled out {end}"
            case "too few paths":
                least = self.needed
                enough = (
                    "no number of paths is enough" if least is None else f"it takes {least:,}, even without a change"
                )
                return f"gate can't be claimed: {count_text(self.whole.paths, 'path')} can't rule out {loss} in {about}; {enough}"
            case "new faults":
                why = f"{count_text(self.new_faults, 'new fault')} in B, whose runs could not be judged"
            case "unequal":
                why = f"{self.pairing.unpaired}; both campaigns need the same configurations and runs"
            case "not judged":
                pairs = count_text(len(self.pairing.configuration), "pair")
                why = (
                    f"of {pairs}, {self.whole.pairs:,} were judged both times and {self._no_longer_judged:,} only in A"
                )
            case "loss shown":
                low, high = (f"{-100 * end:.3g}" for end in reversed(self.whole.interval))
                why = f"a loss of {low} to {high} points in {about} is shown, the margin is {100 * self.margin:g}"
            case "not ruled out":
                why = f"{loss} in {about} is not ruled out {end}"
                if self.target == "these" and self.needed is not None and self.whole.pairs < self.needed:
                    why += f"; it takes {self.needed:,} pairs without a change"
        return f"gate does not hold: {why}"

    @property
    def _no_longer_judged(self) -> int:
        return self.pairing.no_longer_judged(self.oracle)
