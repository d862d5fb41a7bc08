"""A campaign's members: what of an instantiation is executed."""

from collections.abc import Mapping
from pathlib import Path
from typing import TypeAlias

from vastflow.flows.request.selection import Selection, sampled
from vastflow.producers.faults import CampaignError, Fault, did_you_mean
from vastflow.producers.instantiate import Instantiation
from vastflow.tasks.instantiation import UnknownName, selected
from vastflow.tasks.shelf import Member

Runs: TypeAlias = int | Mapping[str, int]
"""Runs of each configuration that is no duplicate: indices 0 to this number - 1. The same of all, or by name."""


def runs_of(runs: Runs, name: str) -> int:
    """Those of one configuration."""
    return runs if isinstance(runs, int) else runs[name]


def narrowed(instantiation: Instantiation, selection: Selection, file: Path) -> Instantiation:
    """What remains with the families and configurations that are selected by name, and then with the sample of these.

    Args:
        file: The campaign file, for the message.

    Raises:
        CampaignError: nothing is called so.
    """
    try:
        found = selected(instantiation, selection.only) if selection.only else instantiation
    except UnknownName as error:
        fault = Fault(str(file), 1, 1, "only", str(error), did_you_mean(error.name, error.known))
        raise CampaignError([fault]) from None
    return found if selection.sample is None else sampled(found, selection.sample, selection.seed)


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
