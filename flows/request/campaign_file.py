"""The campaign file as the flows need it: read and checked, its oracles too."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from vastflow.oracles.oracle import Oracle, OracleError, oracle_of, oracles_of
from vastflow.producers.campaign import Campaign, OracleRequest, load_campaign, oracle_requests
from vastflow.producers.faults import CampaignError, Fault
from vastflow.producers.vast.document import Document, read_document
from vastflow.producers.vast.spec import EvaluationSpec


def read_campaign(path: Path, map_dir: Path | None = None) -> tuple[Campaign, tuple[Oracle[Any], ...]]:
    """The campaign at `path` and the oracles that judge it, `success` first.

    Args:
        map_dir: Folder of maps that are not beside the file.

    Raises:
        CampaignError: every fault of the file.
    """
    try:
        campaign = load_campaign(path, map_dir)
    except CampaignError as error:
        raise CampaignError([*error.faults, *_faults_beside(path)]) from None
    if faults := list(_faults(campaign.oracles, campaign.document, campaign.path.parent)):
        raise CampaignError(faults)
    requests = [(request.name, request.parameters) for request in campaign.oracles]
    return campaign, oracles_of(requests, campaign.path.parent)


def _faults_beside(path: Path) -> list[Fault]:
    """The faults of the oracles in a file that has others."""
    try:
        document = read_document(path)
        evaluation = EvaluationSpec.model_validate(document.data.get("evaluation") or {})
    except (CampaignError, ValidationError):  # said already
        return []
    return list(_faults(oracle_requests(evaluation), document, path.parent))


def _faults(requests: Iterable[OracleRequest], document: Document, base: Path) -> Iterator[Fault]:
    for request in requests:
        try:
            oracle_of(request.name, request.parameters, base)
        except OracleError as error:
            for fault in error.faults:
                where = (*request.location, *fault.location)
                yield document.fault(where, fault.what, fault.right, "value" if fault.location else "key")


def campaign_name(campaign: Campaign) -> str:
    """`metadata.name`, else the file's stem."""
    return str(campaign.spec.metadata.get("name") or campaign.path.stem)
