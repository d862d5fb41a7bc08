"""A campaign that was opened: its file read and checked, and the store that keeps its results."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.oracles.oracle import Oracle
from vastflow.producers.campaign import Campaign
from vastflow.producers.model.faults import CampaignError
from vastflow.tasks.store import Store, open_store


@dataclass(frozen=True)
class OpenCampaign:
    """A campaign as its file was when it was read, and where its results are.

    Attributes:
        oracles: Those the file asks for, `success` first.
    """

    campaign: Campaign = field(repr=False)
    oracles: tuple[Oracle[Any], ...] = field(repr=False)
    store: Store = field(repr=False)

    @property
    def path(self) -> Path:
        """The campaign file."""
        return self.campaign.path

    @property
    def file(self) -> str:
        """The campaign file as it was named, for messages."""
        return self.campaign.document.file

    @property
    def name(self) -> str:
        """`metadata.name`, else the file's stem."""
        return str(self.campaign.spec.metadata.get("name") or self.path.stem)


def open_campaign(
    path: str | os.PathLike[str], store: str | os.PathLike[str] | None, *, as_v1: bool = False
) -> OpenCampaign:
    """Read a campaign file and open the store.

    Args:
        as_v1: Whether obstacles are placed as version 1 of RoboVAST does, whatever the file says.

    Raises:
        CampaignError: every fault of the file, or why this version can't run it.
        StoreError: the store can't be used.
    """
    campaign, oracles = read_campaign(Path(path), as_v1=as_v1)
    if campaign.unexecutable:
        raise CampaignError(campaign.unexecutable)
    if campaign.search is not None:
        what = "a search proposes its configurations by what their runs come to"
        raise CampaignError([campaign.fault(("search",), what, "vastflow run, which has all stages", "key")])
    return OpenCampaign(campaign, oracles, open_store(store))
