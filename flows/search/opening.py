"""Beginning a search, or taking it up again: both are the same."""

import hashlib
from typing import TYPE_CHECKING

from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.search.clock import clock_of
from vastflow.flows.search.progress import SearchProgress
from vastflow.flows.search.repetition import PointRuns
from vastflow.producers.campaign import Campaign
from vastflow.producers.model.faults import CampaignError
from vastflow.tasks.progress import Tally
from vastflow.tasks.store import Store

if TYPE_CHECKING:
    from vastflow.flows.request.stopping import Stopping


def search_progress(
    campaign: Campaign,
    request: RunRequest,
    stopping: "Stopping | None",
    runs: int,
    store: Store,
    content: bytes,
    tally: Tally,
) -> SearchProgress | None:
    """The search of a campaign at its beginning; None where the file lists its configurations.

    Args:
        runs: Of each point, at most where `stopping` ends them.
        content: Of the campaign file.

    Raises:
        CampaignError: only a part of the configurations is asked for, which nobody knows before.
        MissingLibrary: its strategy needs a library that is not installed.
    """
    if (search := campaign.search) is None:
        return None
    if part := next((name for name in ("only", "sample") if getattr(request, name)), None):
        what = f"found --{part}, and a search proposes its configurations one after the other"
        raise CampaignError([campaign.fault(("search",), what, "a smaller budget", "key")])
    clock = clock_of(store, search.spec, hashlib.sha256(content).hexdigest(), runs)
    return SearchProgress(search, PointRuns(stopping, runs, search.spec.confirm), clock, tally)
