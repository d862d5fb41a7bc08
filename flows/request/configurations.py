"""Configurations of a call: the selected ones, and the distinct ones among them."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.digest import digest
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.system.keys import RECORDING_KEY
from vastflow.tasks.engine.index import ConfigurationRuns
from vastflow.tasks.engine.instantiation import Instantiated, UnknownName, selected


def sampled(instantiation: Instantiation, size: int, seed: int) -> Instantiation:
    """Return a sample of `size` distinct configurations with their duplicates, in order; all, if fewer.

    In each family configurations have an order that follows from the seed and the digest of their content, without programs so that
    nodes get the sample of the built-in robot; the k-th of n, from 0, has the place (k + 1/2) / n. The sample is the `size` least places:
    a larger one contains a smaller one, and families have their share as by Webster's method of apportionment. Nothing else in the
    campaign moves a configuration in its family.
    """
    distinct = [each for each in instantiation.configurations if each.duplicate_of is None]
    bare = (
        each.scenario if each.scenario.programs is None else replace(each.scenario, programs=None) for each in distinct
    )
    drawn = [(digest("sample", seed, scenario.digest), each) for scenario, each in zip(bare, distinct, strict=True)]
    order = sorted(drawn, key=lambda one: one[0])
    sizes = Counter(each.family for each in distinct)
    seen: Counter[str] = Counter()
    places: list[tuple[float, str, Configuration]] = []
    for drawn_as, each in order:
        places.append(((seen[each.family] + 0.5) / sizes[each.family], drawn_as, each))
        seen[each.family] += 1
    chosen = {each.name for _, _, each in sorted(places, key=lambda place: place[:2])[:size]}
    return replace(
        instantiation,
        configurations=tuple(c for c in instantiation.configurations if (c.duplicate_of or c.name) in chosen),
        sampled_from=len(distinct),
    )


MOST_REASONS: Final = 3
"""Reasons that are said of one producer; more are counted."""


def narrowed(
    instantiated: Instantiated, file: str, only: Sequence[str] = (), sample: int | None = None, seed: int = 0
) -> Instantiated:
    """Select named families and configurations of a file, then a sample; keep the faults that may concern them.

    Raises:
        FileError: nothing is called so, or there is nothing to run.
    """
    found, faults = instantiated.instantiation, instantiated.faults
    if only:
        try:
            found = selected(found, only)
        except UnknownName as error:
            why = next((str(fault) for fault in faults if fault.concerns(error.name)), None)
            right = "" if why else did_you_mean(error.name, error.known)
            raise FileError([Fault(Place(file, 1, 1, "only"), why or str(error), right)]) from None
        faults = tuple(fault for fault in faults if any(map(fault.concerns, only)))
    if sample is not None:
        found = sampled(found, sample, seed)
    if not found.configurations and not faults:
        raise FileError(
            Fault(Place(file, where="configuration"), "there is nothing to run", why) for why in requirements(found)
        )
    return Instantiated(found, faults)


def requirements(found: Instantiation) -> Iterator[str]:
    """Describe why configurations are left out, with counts by family, largest first."""
    reasons: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for rejected in found.rejections:
        reasons[rejected.family, f"{rejected.producer} rejects"][rejected.reason] += 1
    for excluded in found.excluded:
        reasons[excluded.family, "constraints exclude"][excluded.constraint] += 1
    for (family, which), counts in sorted(reasons.items(), key=lambda item: -item[1].total()):
        said = ", ".join(f"{count} × {reason}" for reason, count in counts.most_common(MOST_REASONS))
        more = f", and {len(counts) - MOST_REASONS} more reasons" if len(counts) > MOST_REASONS else ""
        yield f"{which} {counts.total()} of family {family!r}: {said}{more}"


def distinct_configurations(instantiation: Instantiation, runs: int) -> list[ConfigurationRuns]:
    """One for each distinct configuration, in order, with `runs` runs wanted, or the only recorded one."""
    configurations = []
    places: Counter[str] = Counter()
    for each in instantiation.configurations:
        places[each.family] += 1
        if each.duplicate_of is None:
            wanted = 1 if RECORDING_KEY in each.scenario.system else runs
            configurations.append(ConfigurationRuns(each.name, each.family, places[each.family], each.scenario, wanted))
    return configurations
