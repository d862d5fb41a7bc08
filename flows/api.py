"""The Python API: a campaign from its file to the campaign directory, in one call that blocks."""

import os
from contextlib import suppress
from inspect import signature
from typing import TYPE_CHECKING, Any, TypeAlias

from vastflow.flows.flow_runs.flow_call import FlowCall
from vastflow.flows.request.run_request import RunRequest, option_parameters, request_of
from vastflow.flows.results.directory import new_directory
from vastflow.flows.results.summary import Results
from vastflow.flows.run.campaign_run import CampaignRun, open_run
from vastflow.flows.run.reporting import assess, current, deliver, report
from vastflow.flows.terminal.notebook import notebook_display
from vastflow.tasks.engine.progress import Observer
from vastflow.tasks.store.store import Lost

if TYPE_CHECKING:
    from prefect.client.schemas.objects import State

CampaignResult: TypeAlias = Results


def run_campaign(
    campaign: "str | os.PathLike[str] | RunRequest", *, observer: Observer | None = None, **options: Any
) -> CampaignResult:
    """Run a campaign and write its report; what is in the store is not computed again.

    Works from a plain script (no `__main__` guard) and from a notebook. Prefect starts only if something is missing.
    Ctrl-C and SIGTERM raise `KeyboardInterrupt`, and end a process that does not end by itself within seconds.

    Args:
        campaign: The campaign file, or all that is asked as a `RunRequest`.
        observer: Is shown the progress, from one thread; by default the cell of a notebook that calls, if one does.
        options: Fields of `RunRequest`, such as `runs=5`; `only` may be one name. `pool` may be a `WorkPool`.

    Raises:
        FileError: faults of the file, or a name in `only` that nothing has.
        StoreError: the store can't be used.
        ResultsError: the campaign directory can't be written; nothing of it is left, and everything is in the store.
        MachineError: this machine lacks something that a computation needs, such as a home that can be written.
        PrefectUnavailable: Prefect's API can't be started, or stayed away.
        WorkPoolError: there is no such pool, or no API of Prefect is configured.
        WorkersFailed: the pool's workers can't compute the campaign.
        ValueError, TypeError: an option is out of its bounds, or there is none of that name.
    """
    with open_run(request_of(campaign, options), observer or notebook_display()) as run:
        with suppress(Lost):  # a damaged artifact is found when it is read; then there is something to compute
            if run.complete():
                return _found(run)
        return _computed(run)


_own = list(signature(run_campaign).parameters.values())[:-1]
setattr(run_campaign, "__signature__", signature(run_campaign).replace(parameters=[*_own, *option_parameters()]))  # noqa: B010


def _found(run: CampaignRun) -> Results:
    """All is in the store: what the flow would do then, without Prefect, unless the directory of an earlier run is the same."""
    if (results := current(run)) is not None:
        return results
    with new_directory(run.delivery.folder, run.name, run.created) as directory:
        written = report(run, assess(run, directory))
    return deliver(run, written)


def _computed(run: CampaignRun) -> Results:
    """Call the flow, and let the workers begin while Prefect starts."""
    if run.request.pool is not None:
        from vastflow.flows.request.work_pool import check_api

        check_api(run.log)
    call = FlowCall(run.engine, run.tally, run.log)
    if run.request.pool is None:
        run.begin()

    def flow() -> "State[Any]":
        from vastflow.flows.campaign import campaign

        return campaign(run.request, return_state=True)

    try:
        call.run(flow, done=lambda: run.results is not None)
    except Exception:
        if run.engine.store_error is not None:  # what else broke follows from it
            raise run.engine.store_error from None
        raise
    assert run.results is not None
    return run.results
