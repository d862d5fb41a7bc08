"""A campaign's members: what of an instantiation is executed."""

from pathlib import Path

from vastflow.flows.selection import Selection, sampled
from vastflow.producers.faults import CampaignError, Fault, did_you_mean
from vastflow.producers.instantiate import Instantiation
from vastflow.tasks.instantiation import UnknownName, selected
from vastflow.tasks.shelf import Member


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
