"""A campaign whose shards a work pool computes, from inside its flow. Importing it imports Prefect."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from prefect.client.orchestration import get_client
from prefect.runtime import flow_run

from vastflow.flows.flow_runs.pages import ProgressBar, key_of, tolerated
from vastflow.flows.flow_runs.task_runs import TaskRuns
from vastflow.flows.pool.driver import TAKEN_S, Driver
from vastflow.flows.pool.service import Asking, PoolService, asked_of_containers, pool_type
from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.request.work_pool import WorkPool
from vastflow.flows.run.computing import Computing
from vastflow.flows.run.prepared import PreparedCampaign
from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine.index import FoundRuns
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.engine.remote_shard import BundleError, Packer
from vastflow.tasks.engine.shards import Shard
from vastflow.tasks.prefect.adapter import current_flow
from vastflow.tasks.prefect.deployment import PoolType


class CampaignPool:
    """The work pool that computes a campaign's shards.

    Args:
        name: The pool's.
        label: The campaign's, as the keys of its artifacts have it.
    """

    def __init__(self, driver: Driver, name: str, label: str, tally: Tally) -> None:
        self._driver = driver
        self._name = name
        self._tally = tally
        self._bar = ProgressBar(f"{label}-shards", str(flow_run.id))
        self._said = False

    def compute(self, task_runs: TaskRuns, due: Sequence[FoundRuns], shards: Sequence[Shard]) -> None:
        """Compute missing runs, traces, and verdicts of configurations in shards of the pool.

        Raises:
            UserError, WorkersFailed, StoreError, PrefectUnavailable: see `Driver.run` and `PoolService`.
        """

        def show(done: int, total: int) -> None:
            if not self._said:
                self._said = True
                self._tally.notice(f"{total} shard{'s'[: total != 1]} for the work pool {self._name}")
            with tolerated():
                self._bar.show(done / total, f"{done} of {total} shards through")

        try:
            self._driver.run([each.configuration for each in due], show)
        except BundleError as error:
            raise UserError(f"--pool: {error}") from None


@contextmanager
def pool_of(run: PreparedCampaign, computing: Computing) -> Iterator[CampaignPool | None]:
    """The work pool that was asked to compute a campaign; None where this machine does.

    Raises:
        UserError: there is no such pool.
    """
    asked, engine, tally = run.request, computing.engine, computing.tally
    if asked.pool is None:
        yield None
        return
    pool = WorkPool(asked.pool, asked.shards, asked.pool_wait_s)
    with get_client(sync_client=True) as client:
        asking = Asking(client, tally.notice, lambda: engine.closed)
        kind = pool_type(asking, pool.name)
        job_variables, workers = asked_of_containers(kind, run.campaign, asked.workers)
        request = RunRequest(campaign=run.name, store=run.store.place, workers=workers)
        given, label = request.model_dump(exclude_defaults=True), key_of(run.name)
        service = PoolService(asking, pool.name, str(flow_run.id), label, current_flow(), given, job_variables)
        packer = Packer(run.store, run.name, run.keys, run.opened.oracles, run.campaign.path.parent)
        # In a queue of a cluster a flow run may be pending for days.
        taken_s = TAKEN_S if kind is PoolType.process else None
        driver = Driver(service, packer.packed, engine, tally, pool, tally.notice, taken_s=taken_s)
        yield CampaignPool(driver, pool.name, label, tally)
