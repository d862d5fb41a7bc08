"""The Python API: a campaign from its file to the campaign directory, in one call that blocks."""

import os
import time
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from vastflow.flows.computing.computation import cores
from vastflow.flows.request.asked import SEQUENTIAL, Asked
from vastflow.flows.request.campaign_file import campaign_name, read_campaign
from vastflow.flows.request.campaign_keys import campaign_keys
from vastflow.flows.request.selection import Selection
from vastflow.flows.results.delivery import delivery_to
from vastflow.flows.results.directory import directory_name
from vastflow.flows.results.found import RunFault
from vastflow.flows.results.inputs import inputs_of
from vastflow.flows.results.kept_report import KeptReport
from vastflow.flows.results.origin_code import code_row
from vastflow.flows.results.report_key import report_key
from vastflow.flows.results.results import Results, write_results
from vastflow.flows.results.summary import Work
from vastflow.flows.session import Session
from vastflow.oracles.oracle import Oracle
from vastflow.producers.campaign import Campaign
from vastflow.producers.faults import CampaignError
from vastflow.producers.postprocessing import steps_of
from vastflow.tasks import chatter, ending
from vastflow.tasks.garbage import few_collections
from vastflow.tasks.index import Index
from vastflow.tasks.instantiation import Instantiator
from vastflow.tasks.keys import Keys
from vastflow.tasks.progress import Observer, Reporter, Tally
from vastflow.tasks.server import end_services
from vastflow.tasks.source import installed_tree
from vastflow.tasks.store import Lost, StoreError, open_store, store_address

if TYPE_CHECKING:
    from vastflow.flows.pool.spread import Spread
    from vastflow.flows.pool.work_pool import WorkPool
    from vastflow.flows.request.stopping import Stopping

CampaignResult: TypeAlias = Results


def run_campaign(
    path: str | os.PathLike[str],
    *,
    runs: int | None = None,
    results: str | os.PathLike[str] | None = None,
    store: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    only: str | Sequence[str] | None = None,
    sample: int | None = None,
    map_dir: str | os.PathLike[str] | None = None,
    as_v1: bool = False,
    observer: Observer | None = None,
    pool: "str | WorkPool | None" = None,
) -> CampaignResult:
    """Run a campaign and write its report; what is in the store is not computed again.

    Works from a plain script (no `__main__` guard) and from a notebook. Prefect starts only if something is missing.
    Ctrl-C and SIGTERM raise `KeyboardInterrupt`, and end a process that does not end by itself within seconds.

    Args:
        path: The campaign file.
        runs: Runs of each configuration, instead of the file's: so many of all, whatever the file's rule would have decided.
        results: Folder the campaign directory is made in, `results` if not given; or an address such as `s3://bucket/prefix`,
            to which it is uploaded when it is finished, while a copy stays on this machine for a day.
        store: Folder of the store or address such as `s3://bucket/prefix`, else the variable `VASTFLOW_STORE`, else a
            user cache folder.
        workers: Worker processes, else one a core.
        only: Names of families or configurations; nothing else is run.
        sample: How many distinct configurations of these are run, at most: a sample that follows from their content and
            the campaign's seed, spread over families, and contained in every larger one.
        map_dir: Folder in which maps are looked for that are not beside the campaign file, by the same relative path.
        as_v1: Whether every obstacle is placed as version 1 of RoboVAST does, whatever the file says.
        observer: Is shown the progress, from one thread.
        pool: A work pool of Prefect whose workers compute what is missing, else this process does. They must find the store.

    Raises:
        CampaignError: faults of the file, or a name in `only` that nothing has.
        StoreError: the store can't be used.
        ResultsError: the campaign directory can't be written; nothing of it is left, and everything is in the store.
        SurroundingsError: this machine lacks something that a computation needs, such as a home that can be written.
        PrefectUnavailable: Prefect's API can't be started, or stayed away.
        WorkPoolError: there is no such pool, or no API of Prefect is configured.
        WorkersFailed: the pool's workers can't compute the campaign.
    """
    if runs is not None and runs < 1:
        raise ValueError(f"runs is at least 1, got {runs}")
    if sample is not None and sample < 1:
        raise ValueError(f"sample is at least 1, got {sample}")
    clock = _Clock()
    created = datetime.now()
    tally = Tally()
    with ending.terminable(), few_collections(), Reporter(tally, observer):
        campaign, oracles = read_campaign(Path(path), None if map_dir is None else Path(map_dir), as_v1=as_v1)
        if campaign.unexecutable:
            raise CampaignError(campaign.unexecutable)
        inputs = inputs_of(campaign, oracles)
        kept = open_store(store)
        name = campaign_name(campaign)
        goes_to = delivery_to(results or "results", kept)
        log = chatter.new_log(kept.local / "logs", directory_name(name), created)
        with chatter.own_log(log):
            tree = installed_tree()
            keys = campaign_keys(tree, campaign.seed, oracles)
            names = (only,) if isinstance(only, str) else tuple(only or ())
            selection = Selection(names, sample, campaign.seed)
            maps = str(map_dir) if campaign.borrowed_maps else None
            asked = Asked(
                campaign.path.name, campaign.runs_asked(runs, sample), names, inputs.places, sample, maps, as_v1
            )
            stopping = _stopping(campaign) if runs is None and campaign.sequential is not None else None
            rule = {} if stopping is None else {SEQUENTIAL: stopping.as_json}
            record = {"asked": asked.as_json(), **rule, **code_row(tree, campaign.families, oracles)}
            session = Session(
                title=f"{name} {created:%Y-%m-%d %H:%M:%S}",
                instantiator=Instantiator(campaign, kept, keys, tree),
                index=Index(kept, keys),
                oracles=oracles,
                runs=asked.runs,
                only=selection,
                workers=workers or cores(),
                tally=tally,
                log=log,
                stopping=stopping,
                spread=_spread(pool, campaign, name, oracles, keys, workers, tally) if pool is not None else None,
            )

            def work() -> Work:
                counted = tally.progress()
                return Work(counted.executed, counted.reused, counted.simulated_s, clock.cpu_s(), clock.wall_s())

            def before_report(directory: Path) -> None:
                tally.begin("reporting")
                if log.exists():
                    (directory / "logs").mkdir(exist_ok=True)
                    (directory / "logs" / "campaign.log").write_bytes(log.read_bytes())

            def report(directory: Path) -> None:
                from vastflow.oracles.page.report import write_report

                write_report(directory)

            def kept_report(metadata: Mapping[str, Any]) -> KeptReport:
                found = report_key(
                    keys, tree, inputs.campaign, metadata, instantiation, session.contents(), session.runs, oracles
                )
                return KeptReport(kept, found, keys.sources)

            for _ in range(_TRIES):
                instantiation = session.complete()
                try:
                    written = write_results(
                        goes_to.folder,
                        campaign,
                        inputs,
                        instantiation,
                        session.found,
                        runs=session.runs,
                        oracles=[oracle.name for oracle in oracles],
                        keys=keys,
                        record=record,
                        faults=[RunFault("", None, fault.stage, fault.error) for fault in session.campaign_faults],
                        created=created,
                        work=work,
                        report=report,
                        before_report=before_report,
                        kept=kept_report if session.whole else None,
                        threads=_LOCAL_READERS if store_address(store) is None else _REMOTE_READERS,
                    )
                except Lost:  # found out when it was read: the damaged artifact is gone now, so it gets computed
                    continue
                if steps := steps_of(campaign.spec.results_processing.postprocessing):
                    from vastflow.flows.postprocessing.postprocess import postprocessed

                    tally.begin("postprocessing")
                    written = postprocessed(written, steps, campaign.path.parent)
                written = goes_to.delivered(written)
                if session.flow_run_id is not None:
                    with chatter.prefect_log(log):
                        from vastflow.flows.computing.artifacts import publish
                        from vastflow.tasks.patience import bounded

                        with bounded():
                            publish(written, name, flow_run_id=session.flow_run_id)
                        end_services()
                return written
            raise StoreError(f"store: {kept.place!r} loses what is written to it; is the disk full or broken?")


_TRIES = 3
_LOCAL_READERS, _REMOTE_READERS = 1, 16


def _spread(
    pool: "str | WorkPool",
    campaign: Campaign,
    name: str,
    oracles: Sequence[Oracle[Any]],
    keys: Keys,
    workers: int | None,
    tally: Tally,
) -> "Spread":
    from vastflow.flows.pool.spread import Spread
    from vastflow.flows.pool.work_pool import WorkPool

    chosen = WorkPool(pool) if isinstance(pool, str) else pool
    return Spread(chosen, campaign, name, oracles, keys, workers, tally.notice)


def _stopping(campaign: Campaign) -> "Stopping | None":
    from vastflow.flows.request.stopping import stopping_of  # imports statistics, which take a moment

    return stopping_of(campaign.sequential)


class _Clock:
    """Time since it was made: on the wall, and of the CPU for this process and its children that have ended."""

    def __init__(self) -> None:
        self._began_s = time.perf_counter()
        self._before_s = sum(os.times()[:4])

    def wall_s(self) -> float:
        return time.perf_counter() - self._began_s

    def cpu_s(self) -> float:
        return sum(os.times()[:4]) - self._before_s
