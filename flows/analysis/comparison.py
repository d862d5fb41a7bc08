"""A comparison of two campaign directories: verdicts, parameters, code, and the gate on a loss of passed runs."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Literal, TypeAlias

from vastflow.flows.request.campaign_file import recorded_keys
from vastflow.flows.results.provenance import campaign_changes
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.evidence.evidence import headline_of
from vastflow.oracles.evidence.paired_metrics import MetricDifference, explanations, metric_differences, paired_values
from vastflow.oracles.evidence.pairing import Pairing, pairing_of
from vastflow.oracles.evidence.varied import varied_rows
from vastflow.oracles.results.executed import KeptFiles, environment_names
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.results.tables import Tables
from vastflow.oracles.results.units import Units
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
from vastflow.oracles.statistics.measured import MetricEffect
from vastflow.producers.campaign_file.document import Document, read_document
from vastflow.sim.model.faults import message_of
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.nodes import nodes_of
from vastflow.sim.system.keys import FILE_KEY
from vastflow.sim.system.system import system_kind

DRIVER, BUILT_IN = "driver", "the built-in stack"
"""The name under which configurations differ where nodes drive one of two, and its value where none do."""


@dataclass(frozen=True, slots=True)
class Given:
    """A value and its place, such as `campaign.vast:14`; both are empty for a parameter that is not given."""

    value: str = ""
    place: str = ""

    def __str__(self) -> str:
        return f"{self.value or 'not given'}{f' ({self.place})' if self.place else ''}"


@dataclass(frozen=True, slots=True)
class Difference:
    """A parameter with different values in a number of pairs of configurations."""

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
            names = [*dict.fromkeys((*old, *new))]
            drivers = {old[DRIVER].value, new[DRIVER].value}
            if len(drivers) == 2 and BUILT_IN in drivers:  # one line says it, in place of thirty
                names = [name for name in names if not name.startswith("programs.")]
            each = ((name, old.get(name, Given()), new.get(name, Given())) for name in names)
            counts.update(one for one in each if one[1].value != one[2].value)
    return [Difference(*each, n) for each, n in counts.items()]


class _Side:
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
        parts = {
            key: value for key, value in content.items() if key not in ("environment", "task")
        }  # equal in every pair
        system = parts.pop("system", None) or {}
        text = json.dumps([system, parts], sort_keys=True)
        if text not in self._known:
            of_file = dict(self._parameters(system.get(FILE_KEY)))
            found = of_file | {
                key: self._placed(key, value) for key, value in _flat({**system, **parts}) if key not in of_file
            }
            if of_file:
                del found[f"{FILE_KEY}.file"]  # its parameters say more than its digest
            nodes = (parts.get("programs") or {}).get("nodes")
            found[DRIVER] = Given(nodes_of(nodes).words if nodes else BUILT_IN)
            self._known[text] = found
        return self._known[text]

    def _parameters(self, file: Any) -> Iterator[tuple[str, Given]]:
        with suppress(ValueError, OSError, KeyError, TypeError):
            path = self._files.path(file["file"])
            for name, value, line in system_kind().file_parameters(path):
                yield name, Given(_text(value), f"{path.relative_to(self._tables.directory)}:{line}")

    def _placed(self, key: str, value: Any) -> Given:
        """Return a value with the first line of the campaign file that gives it, or else names its parameter."""
        name, file = key.rpartition(".")[2], self._file
        if file is None:
            return Given(_text(value))
        lines = [
            (file.value(location) != value, place)
            for location, place in file.values.items()
            if location and (location[-1] == name or file.value(location) == name)
        ]
        return Given(_text(value), f"campaign.vast:{min(lines)[1][0]}" if lines else "")


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
    "undecided",
    "loss shown",
    "too few paths",
    "unequal",
    "not judged",
    "new faults",
]


@dataclass(frozen=True, eq=False)
class Gate:
    """The gate of a comparison.

    Faults, configurations that the candidate lacks, other seeds, and runs that were not judged are checked first, since each
    could hide a loss. Runs that one campaign has beyond the last of the other are left out: its configuration's class was decided.

    Attributes:
        whole: The difference over all judged pairs.
        target: The population of its claim, others of these `units`.
        margin: Accepted loss, as a share of the runs.
        new_faults: Faults of the candidate in configurations without a fault in the baseline.
        same_keys: Whether both campaigns were computed from equal scenarios by equal code.
        until_decided: Whether the runs ended by what they showed; the interval then holds at every look.
    """

    pairing: Pairing = field(repr=False)
    whole: RateDifference
    target: Target
    units: Units
    margin: float
    oracle: str | None
    new_faults: int
    same_keys: bool
    until_decided: bool = False

    @property
    def needed(self) -> int | None:
        """Unchanged pairs, or units for others, that rule out the margin; None if no fixed number does."""
        return None if self.until_decided else needed(self.margin)

    @property
    def holds(self) -> bool:
        """Whether a loss of the margin or more is ruled out."""
        return self.status in ("nothing changed", "ruled out")

    @property
    def exit_code(self) -> int:
        """0 if the gate holds, 4 if it can't be claimed, and 1 if it does not hold."""
        return 0 if self.holds else 4 if self.status in ("too few paths", "undecided") else 1

    @cached_property
    def status(self) -> Status:
        """The gate holds for `nothing changed` and `ruled out`, and can't be claimed for `too few paths` and `undecided`."""
        if self.new_faults:
            return "new faults"
        if self.pairing.refused:
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
        if self.whole.interval[1] < 0.0:
            return "loss shown"
        return "undecided" if self.until_decided else "not ruled out"

    @property
    def text(self) -> str:
        """The gate as a sentence."""
        about = "these scenarios" if self.target == "these" else f"other {self.units.others}"
        loss = f"a loss of {100 * self.margin:g} points"
        end = f"(lower end of the interval {100 * self.whole.interval[0]:+.2f})"
        match self.status:
            case "nothing changed":
                return "gate holds: nothing changed, both campaigns have the same scenarios, code, and seeds"
            case "ruled out":
                return f"gate holds: {loss} or more in {about} is ruled out {end}"
            case "too few paths":
                noun, least = self.units.noun, self.needed
                few = f"{count_text(self.whole.paths, noun)} can't rule out {loss} in {about}"
                enough = (
                    f"no number of {noun}s is enough" if least is None else f"it takes {least:,}, even without a change"
                )
                return f"gate can't be claimed: {few}, {enough}"
            case "new faults":
                why = f"{count_text(self.new_faults, 'new fault')} in B, whose runs could not be judged"
            case "unequal":
                why = f"could not pair {self.pairing.refused}"
            case "not judged":
                pairs = count_text(len(self.pairing.configuration), "pair")
                why = (
                    f"of {pairs}, {self.whole.pairs:,} were judged both times and {self._no_longer_judged:,} only in A"
                )
            case "loss shown":
                low, high = (f"{-100 * end:.3g}" for end in reversed(self.whole.interval))
                why = f"a loss of {low} to {high} points in {about} is shown, the margin is {100 * self.margin:g}"
            case "not ruled out" | "undecided":
                why = f"{loss} in {about} is not ruled out{', nor is a loss shown' * self.until_decided} {end}"
                if self.target == "these" and self.needed is not None and self.whole.pairs < self.needed:
                    why += f", and it takes {self.needed:,} pairs without a change"
        return f"gate {'is undecided' if self.status == 'undecided' else 'does not hold'}: {why}"

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
        metrics: What oracles measure, where both runs reached their goals; `explained` has the factors that change its difference.
        headlines: Headlines of the baseline and of the candidate, each of all its runs.
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
    headlines: tuple[str, str]
    metrics: Sequence[MetricDifference]
    explained: Sequence[MetricEffect]

    def shown(self, *, worse: bool) -> list[Change]:
        """Return the configurations that newly fail, or newly pass."""
        return [change for change in self.changes if change.shown and change.worse == worse]


def compared(
    before: Tables,
    after: Tables,
    oracle: str | None = None,
    margin: float = 0.02,
    target: Target = "these",
    until_decided: bool = False,
) -> Compared:
    """Compare two campaigns, see `Gate` for `margin`, `target`, and `until_decided`.

    Raises:
        UnusableDirectory: an unknown oracle, or no pair of runs that was judged both times.
    """
    pairing = pairing_of(before, after)
    if oracle is not None and oracle not in pairing.oracles:
        hint = did_you_mean(oracle, pairing.oracles, "both have none")
        raise UnusableDirectory(f"--oracle: {message_of(f'no oracle {oracle!r} judged both campaigns', hint)}")
    pairs = pairing.pairs(oracle)
    differ = partial(difference, target=target, at_any_look=until_decided)
    whole = differ(pairs)
    if whole is None:
        raise UnusableDirectory(f"{before.directory} and {after.directory}: nothing to compare: {_why(pairing)}")
    each = {name: found for name in pairing.oracles if (found := differ(pairing.pairs(name))) is not None}
    table = after.configurations
    maps = environment_names(after.directory, table.environments)
    places = {name: k for k, name in enumerate(table.names)}
    chosen = [places[match.after] for match in pairing.matches]
    varied = zip(chosen, varied_rows(table, chosen, maps), strict=True)
    factors, _ = factors_of([{"family": table.families[k], **row} for k, row in varied])
    faulty = [Counter(fault["configuration"] for fault in each.metadata.get("faults", [])) for each in (before, after)]
    new_faults = sum(faulty[1][match.after] for match in pairing.matches if not faulty[0][match.before])
    rows = [each.configurations for each in (before, after)]
    checked = [dict(zip(each.names, each.table["checked_digest"].to_pylist(), strict=True)) for each in rows]
    same_keys = recorded_keys(before.metadata) == recorded_keys(after.metadata) and all(
        checked[0][match.before] == checked[1][match.after] for match in pairing.matches
    )
    values = paired_values(before, after, pairing)
    return Compared(
        before=before,
        after=after,
        pairing=pairing,
        oracle=oracle,
        whole=whole,
        oracles=each,
        changes=changes(pairs, 0.0 if until_decided else 0.05),
        levels=by_level(factors, pairs, target, at_any_look=until_decided),
        gate=Gate(pairing, whole, target, after.units, margin, oracle, new_faults, same_keys, until_decided),
        differences=differences(before, after, pairing),
        campaign_differences=campaign_changes(before.metadata, after.metadata, before.directory),
        headlines=(headline_of(before).text, headline_of(after).text),
        metrics=metric_differences(values, pairing, target),
        explained=explanations(values, after, pairing, maps),
    )


def _why(pairing: Pairing) -> str:
    if not pairing.matches and pairing.ambiguous:
        return (
            f"{len(pairing.ambiguous)} configurations of B, such as {pairing.ambiguous[0]}, have several counterparts in A or share "
            "one; expected the names of A, which a value under `parameters` keeps and a new variation does not. The report of one "
            "campaign compares the levels of a variation"
        )
    if not pairing.matches:
        return "no configuration of one has the environment, task, and scenario of one of the other"
    if not pairing.oracles:
        return "no oracle judged both"
    if not len(pairing.configuration):
        return (
            f"the {len(pairing.matches)} common configurations have no common seed. Give both campaigns the same "
            "`execution.seed`."
        )
    return f"no run of {len(pairing.configuration)} pairs was judged both times"
