"""The Python API: a campaign from its file to the campaign directory, in one call that blocks."""

import os
from contextlib import suppress
from inspect import signature
from typing import TYPE_CHECKING, Any, TypeAlias

from vastflow.flows.request.run_request import RunRequest, option_parameters, request_of
from vastflow.flows.results.summary import Results
from vastflow.flows.run.computing import Computing
from vastflow.flows.run.event_log import EventLog, open_log
from vastflow.flows.run.judged import Judged, begin, read_store, run_batches
from vastflow.flows.run.prepared import PreparedCampaign, open_run
from vastflow.flows.run.reporting import find_current, write_campaign
from vastflow.flows.terminal.progress import LoggedNotices, notebook_display
from vastflow.tasks.engine.progress import Observer
from vastflow.tasks.store.store import Lost

if TYPE_CHECKING:
    from prefect.client.schemas.objects import State

CampaignResult: TypeAlias = Results


def run_campaign(
    campaign: "str | os.PathLike[str] | RunRequest", *, observer: Observer | None = None, **options: Any
) -> CampaignResult:
    """Run a campaign and write its report; stored results are not computed again.

    Works from a plain script (no `__main__` guard) and from a notebook. Prefect starts only if something is missing.
    Ctrl-C and SIGTERM raise `KeyboardInterrupt`, and end a process that does not end by itself within seconds.

    Args:
        campaign: The campaign file, or all that is asked as a `RunRequest`.
        observer: Is shown the progress, from one thread; by default the cell of a notebook that calls, if one does, else notices are
            logged as warnings of `vastflow.notices`.
        options: Fields of `RunRequest`, such as `runs=5`; `only` may be one name, `cluster` a `distributed.Client`.

    Raises:
        FileError: faults of the file, or a name in `only` that nothing has.
        StoreError: the store can't be used.
        ResultsError: the campaign directory can't be written; nothing of it is left, and everything is in the store.
        StoreError: this machine lacks something that a computation needs, such as a home that can be written.
        PrefectUnavailable: Prefect's API can't be started, or stayed away.
        CampaignStopped: a reader of the running campaign asked for it.
        ClusterError: the Dask cluster can't compute the campaign.
        ValueError, TypeError: an option is out of its bounds, or there is none of that name.
    """
    with open_run(request_of(campaign, options), observer or notebook_display() or LoggedNotices()) as (run, computing):
        if (results := find_current(run, computing)) is not None:
            return results
        with open_log(run, computing) as log:
            judged = None
            with suppress(Lost):  # a damaged artifact is found when it is read; then there is something to compute
                computing.tally.begin("scanning")
                run.store.refresh()
                judged = run_batches(run, computing, read_store(run, computing))
                if judged is not None and not judged.incomplete(computing.engine):
                    return write_campaign(run, computing, judged, log)
            return _computed(run, computing, judged, log)


_own = list(signature(run_campaign).parameters.values())[:-1]
setattr(run_campaign, "__signature__", signature(run_campaign).replace(parameters=[*_own, *option_parameters()]))  # noqa: B010


def _computed(run: PreparedCampaign, computing: Computing, judged: Judged | None, log: EventLog) -> Results:
    if run.store.unwritable is not None:
        raise run.store.unwritable
    begin(run, computing, judged)
    results: list[Results] = []
    known = [judged]  # for the flow's first call: another begins with what the store has by then

    def flow() -> "State[Any]":
        from vastflow.flows.campaign import flow_of

        known_now = known.pop() if known else None
        return flow_of(run, computing, known_now, log, results.append)(run.request.public(), return_state=True)

    computing.run(flow, done=lambda: bool(results))
    return results[-1]
