"""The Prefect flow of a campaign whose shards a work pool computes. Importing it imports Prefect."""

from collections.abc import Sequence
from typing import Any

from prefect import flow, get_run_logger
from prefect.client.orchestration import get_client
from prefect.futures import PrefectFuture, wait
from prefect.runtime import flow_run

from vastflow.flows.computing.artifacts import ProgressBar, key_of, tag, tolerated
from vastflow.flows.computing.campaign import Job
from vastflow.flows.computing.task_log import quiet_task_runs
from vastflow.flows.computing.task_runs import entered, evaluator, settle
from vastflow.flows.pool.driver import TAKEN_S, Driver
from vastflow.flows.pool.service import Asking, PoolService, pool_type
from vastflow.flows.pool.spread import Spread
from vastflow.flows.pool.work_pool import WorkPoolError
from vastflow.tasks.bundle import BundleError, Packer
from vastflow.tasks.execution.job import PoolType
from vastflow.tasks.index import Member
from vastflow.tasks.progress import Tally


class PoolJob:
    """A campaign's flow and where its shards go. A plain object, as `Job` is."""

    __slots__ = ("job", "spread", "tally")

    def __init__(self, job: Job, spread: Spread, tally: Tally) -> None:
        self.job = job
        self.spread = spread
        self.tally = tally


@flow(name="campaign", flow_run_name="{title}", validate_parameters=False, persist_result=False)
def pool_campaign(title: str, job: PoolJob) -> None:
    """Instantiate a campaign here, and have it executed, observed and judged by the workers of a pool.

    Args:
        title: The flow run's name.

    Raises:
        WorkPoolError, WorkersFailed, StoreError, PrefectUnavailable: see `Driver.run` and `PoolService`.
    """
    spread = job.spread
    futures: list[PrefectFuture[Any]] = []
    with entered(), quiet_task_runs(), get_client(sync_client=True) as client:
        engine = job.job.engine
        store = engine.index.store
        asking = Asking(client, spread.say, lambda: engine.closed)
        kind = pool_type(asking, spread.pool.name)
        job_variables, workers = spread.asked_of(kind)
        parameters = {"store": store.place} | ({} if workers is None else {"workers": workers})
        parent = str(flow_run.id)
        service = PoolService(asking, spread.pool.name, parent, key_of(spread.name), parameters, job_variables)
        try:
            wave = job.job.plan(evaluator(job.job.engine, futures))
        finally:
            wait(futures)
        job.job.running()
        packer = Packer(store, spread.name, spread.keys, spread.oracles, spread.campaign.path.parent)
        # In a queue of a cluster a flow run may be pending for days.
        taken_s = TAKEN_S if kind is PoolType.process else None
        driver = Driver(service, packer.packed, engine, job.tally, spread.pool, spread.say, taken_s=taken_s)
        try:
            show = _Shown(spread, wave)
            while wave:
                driver.run(wave, show)
                wave = job.job.more()
        except BundleError as error:
            raise WorkPoolError(f"--pool: {error}") from None
        settle(futures)


class _Shown:
    """Shows on the flow run's page how many shards are through."""

    def __init__(self, spread: Spread, members: Sequence[Member]) -> None:
        run = str(flow_run.id)
        self._pool = spread.pool.name
        self._say = spread.say
        self._members = len(members)
        self._bar = ProgressBar(f"{key_of(spread.name)}-shards", run)
        self._log = get_run_logger()
        self._total = 0
        with tolerated():
            tag(run, spread.name)

    def __call__(self, done: int, total: int) -> None:
        if not self._total:
            said = f"{total} shard{'s'[: total != 1]} for the work pool {self._pool}"
            self._log.info("%d configurations; %s", self._members, said)
            self._say(said)
        self._total = total
        with tolerated():
            self._bar.show(done / total, f"{done} of {total} shards through")
