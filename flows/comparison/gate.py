"""The gate: whether a loss of success rate is ruled out, of what, and why not."""

from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from vastflow.oracles.evidence.pairing import Pairing
from vastflow.oracles.statistics.bounded_mean import needed
from vastflow.oracles.statistics.comparison import RateDifference, Target

Status: TypeAlias = Literal[
    "nothing changed", "ruled out", "not ruled out", "too few paths", "unequal", "not judged", "new faults"
]

HOLDS: Final = 0
DOES_NOT_HOLD: Final = 1
CANT_BE_CLAIMED: Final = 4


@dataclass(frozen=True, slots=True)
class Gate:
    """What the gate says.

    Attributes:
        target: What it speaks of.
        margin: Loss that it allows, a share of the runs.
        status: `nothing changed` and `ruled out` hold; `too few paths` can't be claimed; anything else does not hold.
        needed: Pairs, or paths where it is about others, without a change that rule out the margin; None where no number does.
        text: The same as a sentence.
    """

    target: Target
    margin: float
    status: Status
    needed: int | None
    text: str

    @property
    def holds(self) -> bool:
        """Whether a loss of the margin or more is ruled out."""
        return self.status in ("nothing changed", "ruled out")

    @property
    def exit_code(self) -> int:
        """Of the command."""
        return HOLDS if self.holds else CANT_BE_CLAIMED if self.status == "too few paths" else DOES_NOT_HOLD


def gate_of(
    pairing: Pairing,
    whole: RateDifference,
    target: Target,
    margin: float,
    *,
    oracle: str | None,
    new_faults: int,
    same_keys: bool,
) -> Gate:
    """Judge a comparison.

    What says nothing about a loss comes first: faults, runs without a counterpart and runs that were not judged could each be hiding one.

    Args:
        whole: Of all judged pairs, about `target`.
        oracle: That judges alone; None for all together.
        new_faults: Of the later campaign in configurations of which the earlier one has none.
        same_keys: Whether both campaigns were computed from equal scenarios by equal code.
    """
    status = _status(pairing, whole, target, margin, oracle, new_faults, same_keys)
    least = needed(margin)
    return Gate(target, margin, status, least, _text(pairing, whole, target, margin, status, least, oracle, new_faults))


def _status(
    pairing: Pairing,
    whole: RateDifference,
    target: Target,
    margin: float,
    oracle: str | None,
    new_faults: int,
    same_keys: bool,
) -> Status:
    if new_faults:
        return "new faults"
    if pairing.unpaired:
        return "unequal"
    runs = len(pairing.configuration)
    if 2 * whole.pairs <= runs or pairing.no_longer_judged(oracle) > margin * runs:
        return "not judged"
    if same_keys and whole.lost == whole.gained == 0:
        return "nothing changed"
    least = needed(margin)
    if target == "others" and whole.difference >= -margin and (least is None or whole.paths < least):
        return "too few paths"
    return "ruled out" if whole.non_inferior(margin) else "not ruled out"


def _text(
    pairing: Pairing,
    whole: RateDifference,
    target: Target,
    margin: float,
    status: Status,
    least: int | None,
    oracle: str | None,
    new_faults: int,
) -> str:
    loss, about = (
        f"a loss of {100 * margin:g} points",
        f"in {'these scenarios' if target == 'these' else 'others of their kind'}",
    )
    end = f"(lower end of the interval {100 * whole.interval[0]:+.2f})"
    if status == "nothing changed":
        return "gate holds: nothing changed, both campaigns have the same scenarios, code and seeds"
    if status == "ruled out":
        return f"gate holds: {loss} or more {about} is ruled out {end}"
    if status == "too few paths":
        enough = (
            "no number of paths is enough" if least is None else f"it takes {least:,}, even if nothing changes on any"
        )
        return f"gate can't be claimed: {_number(whole.paths, 'path')} can't rule out {loss} {about}; {enough}"
    if status == "new faults":
        why = f"{_number(new_faults, 'new fault')} in B, whose runs could not be judged"
    elif status == "unequal":
        why = f"{pairing.unpaired}; it takes the same configurations and runs in both campaigns"
    elif status == "not judged":
        gone = pairing.no_longer_judged(oracle)
        why = f"of {_number(len(pairing.configuration), 'pair')}, {whole.pairs:,} were judged both times and {gone:,} only in A"
    else:
        few = (
            ""
            if least is None or target == "others" or whole.pairs >= least
            else f"; it takes {least:,} pairs without a change"
        )
        why = f"{loss} {about} is not ruled out {end}{few}"
    return f"gate does not hold: {why}"


def _number(n: int, noun: str) -> str:
    return f"{n:,} {noun}{'' if n == 1 else 's'}"
