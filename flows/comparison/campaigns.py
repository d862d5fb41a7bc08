"""A comparison of two campaign directories: verdicts, parameters, code, and the gate on a loss of success rate."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, Literal, TypeAlias

from vastflow.flows.request.campaign_file import recorded_keys
from vastflow.flows.results.provenance import campaign_changes
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.evidence.pairing import Pairing, pairing_of
from vastflow.oracles.evidence.varied import varied_rows
from vastflow.oracles.results.executed import KeptFiles, environment_names
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.results.tables import Tables
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.oracles.statistics.comparison import (
    Change,
    LevelDifference,
    RateDifference,
    Target,
    by_level,
    changes,
    difference,
)
from vastflow.oracles.statistics.intervals import needed
from vastflow.producers.campaign_file.document import Document, read_document
from vastflow.sim.model.files import TextPlace
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.nav2.parameter_files.document import PARAMETERS
from vastflow.sim.nav2.parameter_files.document import read_document as read_parameters
from vastflow.sim.nav2.parameter_files.parameter_file import FILE_KEY

_PAIRED: Final = ("environment", "task")
"""Dimensions of a scenario that are equal in every pair."""


@dataclass(frozen=True, slots=True)
class Given:
    """A value and its place, such as `campaign.vast:14`; both are empty for a parameter that is not given."""

    value: str = ""
    place: str = ""

    def __str__(self) -> str:
        return f"{self.value or 'not given'}{f' ({self.place})' if self.place else ''}"


@dataclass(frozen=True, slots=True)
class Difference:
    """A parameter with different values in baseline and candidate.

    Attributes:
        configurations: Number of pairs of configurations.
    """

    parameter: str
    before: Given
    after: Given
    configurations: int


def differences(before: Tables, after: Tables, pairing: Pairing) -> list[Difference]:
    """Return the parameters that differ between paired configurations."""
    then, now = _Side(before), _Side(after)
    counts: Counter[tuple[str, Given, Given]] = Counter()
    for match in pairing.matches:
        if match.how == "other system":
            old, new = then.given(match.before), now.given(match.after)
            each = ((name, old.get(name, Given()), new.get(name, Given())) for name in dict.fromkeys((*old, *new)))
            counts.update(one for one in each if one[1].value != one[2].value)
    return [Difference(*each, n) for each, n in counts.items()]


class _Side:
    """One of the campaigns, with its files."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables
        self._files = KeptFiles(tables.directory)
        self._places = {name: k for k, name in enumerate(tables.configurations.names)}
        self._file: Document | None = None
        with suppress(ValueError, OSError):
            self._file = read_document(tables.directory / "campaign.vast")
        self._known: dict[str, dict[str, Given]] = {}

    def given(self, name: str) -> dict[str, Given]:
        """Return the system parameters of a configuration by name."""
        content = self._tables.configurations.contents[self._places[name]]
        parts = {key: value for key, value in content.items() if key not in _PAIRED}
        system = parts.pop("system", None) or {}
        text = json.dumps([system, parts], sort_keys=True)
        if text not in self._known:
            found = dict(self._parameters(system.get(FILE_KEY)))
            found |= {key: self._placed(key, value) for key, value in _flat({**system, **parts}) if key not in found}
            if any(PARAMETERS in key for key in found):
                del found[f"{FILE_KEY}.file"]  # its parameters say more than its digest
            self._known[text] = found
        return self._known[text]

    def _parameters(self, file: Any) -> Iterator[tuple[str, Given]]:
        with suppress(ValueError, OSError, KeyError, TypeError):
            path = self._files.path(file["file"])
            document = read_parameters(path)
            for location, value in document.values.items():
                line, _ = document.place(location)
                yield ".".join(location), Given(_text(value), f"{path.relative_to(self._tables.directory)}:{line}")

    def _placed(self, key: str, value: Any) -> Given:
        """Return a value with its line in the campaign file, or the line of its name."""
        lines = [] if self._file is None else list(_named(self._file, key, value))
        return Given(_text(value), f"campaign.vast:{min(lines)[1][0]}" if lines else "")


def _named(document: Document, key: str, value: Any) -> Iterator[tuple[bool, TextPlace]]:
    """Yield whether the value differs, and the place, for each mention of a parameter in a file."""
    *_, name = key.split(".")
    for location, place in document.values.items():
        if location and (location[-1] == name or document.value(location) == name):
            yield document.value(location) != value, place


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}" if name else str(key))
    elif name:
        yield name, value


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


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


@dataclass(frozen=True, eq=False)
class Compared:
    """The result of a comparison.

    Attributes:
        oracle: The compared oracle; None for all that judged both campaigns.
        whole: The difference over all pairs; `oracles` has it by oracle, `levels` by levels of the candidate's factors.
        changes: Configurations with changed outcomes, the most certain first.
        differences: Parameters that differ between paired configurations; `campaign_differences` are sentences on the rest.
    """

    before: Tables = field(repr=False)
    after: Tables = field(repr=False)
    pairing: Pairing
    oracle: str | None
    whole: RateDifference
    oracles: dict[str, RateDifference]
    changes: Sequence[Change]
    levels: Sequence[LevelDifference]
    gate: Gate
    differences: Sequence[Difference]
    campaign_differences: Sequence[str]

    def shown(self, *, worse: bool) -> list[Change]:
        """Return the configurations that newly fail, or newly pass."""
        return [change for change in self.changes if change.shown and change.worse == worse]


def compared(
    before: Tables, after: Tables, oracle: str | None = None, margin: float = 0.02, target: Target = "these"
) -> Compared:
    """Compare two campaigns, see `Gate` for `margin` and `target`.

    Raises:
        UnusableDirectory: an unknown oracle, or no pair of runs that was judged both times.
    """
    pairing = pairing_of(before, after)
    if oracle is not None and oracle not in pairing.oracles:
        hint = did_you_mean(oracle, pairing.oracles, "both have none", listed="both have")
        raise UnusableDirectory(f"--oracle: expected an oracle that judged both campaigns, got {oracle!r}; {hint}")
    pairs = pairing.pairs(oracle)
    whole = difference(pairs, target)
    if whole is None:
        raise UnusableDirectory(f"{before.directory} and {after.directory}: nothing to compare: {_why(pairing)}")
    each = {name: found for name in pairing.oracles if (found := difference(pairing.pairs(name), target)) is not None}
    factors, _ = factors_of(_rows(after, [match.after for match in pairing.matches]))
    faults = _new_faults(before, after, pairing)
    same = same_keys(before, after, pairing)
    gate = Gate(pairing, whole, target, margin, oracle, faults, same)
    levels = by_level(factors, pairs, target)
    return Compared(
        before,
        after,
        pairing,
        oracle,
        whole,
        each,
        changes(pairs),
        levels,
        gate,
        differences(before, after, pairing),
        campaign_changes(before.metadata, after.metadata),
    )


def same_keys(before: Tables, after: Tables, pairing: Pairing) -> bool:
    """Whether the runs of two campaigns have the same keys: equal scenarios, code, oracles, seed and kind of machine."""
    then, now = recorded_keys(before.metadata), recorded_keys(after.metadata)
    if then != now:
        return False
    scenarios = [_checked(tables) for tables in (before, after)]
    return all(scenarios[0][match.before] == scenarios[1][match.after] for match in pairing.matches)


def _checked(tables: Tables) -> dict[str, str]:
    found = tables.configurations.table.select(["name", "checked_digest"])
    return {row["name"]: row["checked_digest"] for row in found.to_pylist()}


def _new_faults(before: Tables, after: Tables, pairing: Pairing) -> int:
    then, now = (_faulty(tables) for tables in (before, after))
    return sum(now[match.after] for match in pairing.matches if not then[match.before])


def _faulty(tables: Tables) -> Counter[str]:
    return Counter(fault["configuration"] for fault in tables.metadata.get("faults", []))


def _rows(tables: Tables, names: Sequence[str]) -> list[dict[str, Any]]:
    """Return the family and the varied parameters of these configurations."""
    found = tables.configurations
    places = {name: k for k, name in enumerate(found.names)}
    maps = environment_names(tables.directory, found.environments)
    chosen = [places[name] for name in names]
    rows = varied_rows(found, chosen, maps)
    return [{"family": found.families[k], **row} for k, row in zip(chosen, rows, strict=True)]


def _why(pairing: Pairing) -> str:
    if not pairing.matches:
        return "no configuration of one has the environment, task, and scenario of one of the other"
    if not pairing.oracles:
        return "no oracle judged both"
    if not len(pairing.configuration):
        return (
            f"expected equal seeds, got {len(pairing.matches)} common configurations without a common seed; "
            "`execution.seed` must be the same"
        )
    return f"no run of {len(pairing.configuration)} pairs was judged both times"
