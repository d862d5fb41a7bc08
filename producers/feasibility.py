"""Path lengths that no configuration can have, found before anything runs."""

from collections.abc import Iterator

from vastflow.producers.campaign import Campaign
from vastflow.producers.configuration import Rejection
from vastflow.producers.family import Family
from vastflow.producers.faults import CampaignError, Fault, Note
from vastflow.producers.path import UNPROVED, PathVariationRandom
from vastflow.producers.producer import evaluate


def infeasible_lengths(campaign: Campaign) -> list[Note]:
    """Path lengths that the maps of a campaign's families don't have.

    Where a map or poses follow from other producers, nothing is proved.

    Raises:
        CampaignError: no family has a path length that its map has.
    """
    families = campaign.families if campaign.spec.search is None else ()
    found = {family.name: list(_of_family(campaign, family)) for family in families}
    faults = [fault for family in found.values() for fault, _ in family]
    if found and all(any(is_all for _, is_all in family) for family in found.values()):
        raise CampaignError(faults)
    return [Note("warning", *(each.file, each.line, each.column, each.where, each.what, each.right)) for each in faults]


def _of_family(campaign: Campaign, family: Family) -> Iterator[tuple[Fault, bool]]:
    """A fault for each length that is proved infeasible, and whether its producer is left with no other."""
    entries = campaign.document.data["configuration"]
    i = next(i for i, entry in enumerate(entries) if entry["name"] == family.name)
    written: set[str] = set()
    for k, each in enumerate(family.producers):
        if isinstance(each, PathVariationRandom) and written.isdisjoint(each.reads):
            inputs = {key: family.values[key] for key in each.reads if key in family.values}
            one = PathVariationRandom(each.parameters.model_copy(update={"num_paths": 1}))
            results = evaluate(one, inputs)
            proved = [item for item in results if isinstance(item, Rejection) and UNPROVED not in item.reason]
            where = ("configuration", i, "variations", k, *entries[i]["variations"][k], "path_length")
            for item in proved:
                what = f"rejects {each.parameters.num_paths} of family {family.name!r}: {item.reason}"
                yield campaign.fault(where, what, "a length that the map has"), len(proved) == len(results)
        written |= each.writes.keys()
