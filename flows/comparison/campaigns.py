"""A comparison of two campaign directories."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from vastflow.flows.comparison.differences import Difference, differences
from vastflow.flows.comparison.gate import Gate
from vastflow.flows.request.campaign_keys import recorded_keys
from vastflow.flows.results.past import recorded_as
from vastflow.oracles.directory.environment_names import environment_names
from vastflow.oracles.directory.tables import Tables
from vastflow.oracles.directory.unusable import UnusableDirectory
from vastflow.oracles.evidence.pairing import Pairing, pairing_of
from vastflow.oracles.evidence.varied import varied_rows
from vastflow.oracles.statistics.comparison import (
    Change,
    LevelDifference,
    RateDifference,
    Target,
    by_level,
    changes,
    difference,
)
from vastflow.oracles.statistics.factors import factors_of
from vastflow.sim.model.names import did_you_mean


@dataclass(frozen=True, eq=False)
class Compared:
    """What has changed.

    Attributes:
        oracle: The one it is about; None for all that judged both campaigns.
        whole: All pairs together, by that.
        oracles: Each oracle by itself, where it judged a pair both times.
        changes: Configurations whose runs do not all end as before, the most certain first.
        levels: The difference at each level of each factor of the later campaign.
        gate: Whether a loss is ruled out.
        differences: The parameters, versions, and code that are not the same.
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

    def shown(self, *, worse: bool) -> list[Change]:
        """Configurations that are shown to fail newly, or to pass newly."""
        return [change for change in self.changes if change.shown and change.worse == worse]


def compared(
    before: Tables, after: Tables, oracle: str | None = None, margin: float = 0.02, target: Target = "these"
) -> Compared:
    """Compare two campaigns.

    Args:
        margin: Loss that the gate allows.
        target: What differences and the gate are about.

    Raises:
        UnusableDirectory: an unknown oracle, or no pair of runs that was judged both times.
    """
    pairing = pairing_of(before, after)
    if oracle is not None and oracle not in pairing.oracles:
        hint = did_you_mean(oracle, pairing.oracles, "both have none", listed="both have")
        raise UnusableDirectory(f"--oracle {oracle}: did not judge both campaigns; {hint}")
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
    different = differences(before, after, pairing)
    return Compared(before, after, pairing, oracle, whole, each, changes(pairs), levels, gate, different)


def same_keys(before: Tables, after: Tables, pairing: Pairing) -> bool:
    """Whether the runs of two campaigns have the same keys: equal scenarios, code, oracles, seed and kind of machine."""
    then, now = recorded_keys(before.metadata), recorded_keys(after.metadata)
    if then is None or then != now:
        return False
    scenarios = [_checked(tables) for tables in (before, after)]
    return all(scenarios[0][match.before] == scenarios[1][match.after] for match in pairing.matches)


def _checked(tables: Tables) -> dict[str, str]:
    found = tables.configurations.table.select(["name", "checked_digest", "scenario_digest"])
    return {row["name"]: recorded_as(row) for row in found.to_pylist()}


def _new_faults(before: Tables, after: Tables, pairing: Pairing) -> int:
    then, now = (_faulty(tables) for tables in (before, after))
    return sum(now[match.after] for match in pairing.matches if not then[match.before])


def _faulty(tables: Tables) -> Counter[str]:
    return Counter(fault["configuration"] for fault in tables.metadata.get("faults", []))


def _rows(tables: Tables, names: Sequence[str]) -> list[dict[str, Any]]:
    """What varies over these configurations, their family among it."""
    found = tables.configurations
    places = {name: k for k, name in enumerate(found.names)}
    maps = environment_names(tables.directory, dict.fromkeys(filter(None, found.environments)))
    chosen = [places[name] for name in names]
    rows = varied_rows(found, chosen, maps)
    return [{"family": found.families[k], **row} for k, row in zip(chosen, rows, strict=True)]


def _why(pairing: Pairing) -> str:
    if not pairing.matches:
        return "no configuration of one has the environment, the task and the scenario of one of the other"
    if not pairing.oracles:
        return "no oracle judged both"
    if not len(pairing.configuration):
        return (
            f"{len(pairing.matches)} configurations are in both, and none of their runs have a seed in common; "
            "`execution.seed` must be the same"
        )
    return f"no run of {len(pairing.configuration)} pairs was judged both times"
