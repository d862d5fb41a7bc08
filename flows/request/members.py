"""A campaign's members: what of an instantiation is executed."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from typing import Final, TypeAlias

from vastflow.flows.request.selection import Selection, sampled
from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.producers.model.faults import CampaignError, Fault
from vastflow.sim.model.names import did_you_mean
from vastflow.tasks.index import Member
from vastflow.tasks.instantiation import Instantiated, UnknownName, selected

Runs: TypeAlias = int | Mapping[str, int]
"""Runs of each configuration that is no duplicate: indices 0 to this number - 1. The same of all, or by name."""


MOST_REASONS: Final = 3
"""Reasons that are said of one producer; more are counted."""


def runs_of(runs: Runs, name: str) -> int:
    """Those of one configuration."""
    return runs if isinstance(runs, int) else runs[name]


def narrowed(instantiated: Instantiated, selection: Selection, file: str) -> Instantiated:
    """What remains with the families and configurations that are selected by name, and then with the sample of these.

    Faults remain that may concern one of these.

    Args:
        file: The campaign file as the user named it, for the message.

    Raises:
        CampaignError: nothing is called so, or there is nothing to run.
    """
    found, faults = instantiated.instantiation, instantiated.faults
    if selection.only:
        try:
            found = selected(found, selection.only)
        except UnknownName as error:
            why = next((str(fault) for fault in faults if fault.concerns(error.name)), None)
            right = "a family that can be made" if why else did_you_mean(error.name, error.known)
            raise CampaignError([Fault(file, 1, 1, "only", why or str(error), right)]) from None
        faults = tuple(fault for fault in faults if any(map(fault.concerns, selection.only)))
    if selection.sample is not None:
        found = sampled(found, selection.sample, selection.seed)
    if not found.configurations and not faults:
        raise CampaignError(
            Fault(file, 1, 1, "configuration", f"nothing to run: {why}", "a requirement that can be met")
            for why in requirements(found)
        )
    return Instantiated(found, faults)


def requirements(found: Instantiation) -> Iterator[str]:
    """What leaves out configurations, and how many of each family, the most first."""
    reasons: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for rejected in found.rejections:
        reasons[rejected.family, f"{rejected.producer} rejects"][rejected.reason] += 1
    for excluded in found.excluded:
        reasons[excluded.family, "constraints exclude"][excluded.constraint] += 1
    for (family, which), counts in sorted(reasons.items(), key=lambda item: -item[1].total()):
        said = ", ".join(f"{count} × {reason}" for reason, count in counts.most_common(MOST_REASONS))
        more = f", and {len(counts) - MOST_REASONS} more reasons" if len(counts) > MOST_REASONS else ""
        yield f"{which} {counts.total()} of family {family!r}: {said}{more}"


def members_of(instantiation: Instantiation, runs: int) -> list[Member]:
    """A member for each configuration that is no duplicate, in order, with `runs` runs wanted of it."""
    members = []
    places: dict[str, int] = {}
    for configuration in instantiation.configurations:
        family = configuration.family
        places[family] = places.get(family, 0) + 1
        if configuration.duplicate_of is None:
            members.append(Member(configuration.name, family, places[family], configuration.scenario, runs))
    return members
