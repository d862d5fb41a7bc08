"""The campaign file as the flows need it: read and checked, its oracles too."""

from pathlib import Path
from typing import Any

from vastflow.oracles.oracle import Oracle, OracleError, oracle_of, oracles_of
from vastflow.producers.campaign import Campaign, load_campaign
from vastflow.producers.faults import CampaignError


def read_campaign(path: Path, map_dir: Path | None = None) -> tuple[Campaign, tuple[Oracle[Any], ...]]:
    """The campaign at `path` and the oracles that judge it, `success` first.

    Args:
        map_dir: Folder of maps that are not beside the file.

    Raises:
        CampaignError: every fault of the file.
    """
    campaign = load_campaign(path, map_dir)
    base = campaign.path.parent
    faults = []
    for request in campaign.oracles:
        try:
            oracle_of(request.name, request.parameters, base)
        except OracleError as error:
            for fault in error.faults:
                where = (*request.location, *fault.location)
                faults.append(campaign.fault(where, fault.what, fault.right, "value" if fault.location else "key"))
    if faults:
        raise CampaignError(faults)
    return campaign, oracles_of([(request.name, request.parameters) for request in campaign.oracles], base)


def campaign_name(campaign: Campaign) -> str:
    """`metadata.name`, else the file's stem."""
    return str(campaign.spec.metadata.get("name") or campaign.path.stem)
