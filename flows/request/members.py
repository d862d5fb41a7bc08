"""A campaign's members: what of an instantiation is executed."""

from collections.abc import Mapping
from typing import TypeAlias

from vastflow.flows.request.selection import Selection, sampled
from vastflow.producers.faults import CampaignError, Fault
from vastflow.producers.instantiate import Instantiation
from vastflow.sim.reading.names import did_you_mean
from vastflow.tasks.index import Member
from vastflow.tasks.instantiation import Instantiated, UnknownName, selected

Runs: TypeAlias = int | Mapping[str, int]
"""Runs of each configuration that is no duplicate: indices 0 to this number - 1. The same of all, or by name."""


def runs_of(runs: Runs, name: str) -> int:
    """Those of one configuration."""
    return runs if isinstance(runs, int) else runs[name]


def narrowed(instantiated: Instantiated, selection: Selection, file: str) -> Instantiated:
    """What remains with the families and configurations that are selected by name, and then with the sample of these.

    Faults remain that may concern one of these.

    Args:
        file: The campaign file as the user named it, for the message.

    Raises:
        CampaignError: nothing is called so, or nothing of what is called so could be made.
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
    return Instantiated(found, faults)


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
