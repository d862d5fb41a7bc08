"""The computation of a call: an engine with its workers, the progress, and a log."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from platformdirs import user_cache_dir

from vastflow.flows.request.campaign_file import OpenCampaign
from vastflow.flows.results.directory import directory_name
from vastflow.flows.results.summary import Work
from vastflow.flows.run.flow_call import FlowCall
from vastflow.oracles.judgment.oracle import Oracle
from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine import process
from vastflow.tasks.engine.engine import Engine, RunsWanted
from vastflow.tasks.engine.executor import Executor
from vastflow.tasks.engine.index import Index
from vastflow.tasks.engine.machine_check import check_machine
from vastflow.tasks.engine.pace import Pace
from vastflow.tasks.engine.pool import Pool, cores
from vastflow.tasks.engine.progress import Observer, Reporter, Tally
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.prefect import campaign_log
from vastflow.tasks.store.store import Store

if TYPE_CHECKING:
    from vastflow.flows.run.task_runs import TaskRuns


def stopwatch(tally: Tally) -> Callable[[], Work]:
    """Start a clock, and return a function for the work since, a cluster's included."""
    began_s, before_s = time.perf_counter(), process.cpu_s()

    def work() -> Work:
        done, cpu_s = tally.progress(), process.cpu_s() - before_s + tally.elsewhere_cpu_s
        return Work(done.executed, done.reused, done.simulated_s, cpu_s, time.perf_counter() - began_s)

    return work


@dataclass(frozen=True, slots=True)
class Computing:
    """The computation of a campaign, or of a `stage` of the Python API, with a log instead of the terminal."""

    name: str
    stage: str
    engine: Engine = field(repr=False)
    tally: Tally = field(repr=False)
    log: Path
    created: datetime

    @property
    def title(self) -> str:
        """Initial name of the flow run, before the campaign's size is known."""
        return f"{self.stage} {self.name} {self.created:%Y-%m-%d %H:%M:%S}".lstrip()

    def run(self, flow: Callable[[], Any], done: Callable[[], bool] = lambda: False) -> None:
        """Call a flow, see `FlowCall.run`; a `StoreError` comes before what follows from it."""
        try:
            FlowCall(self.engine, self.tally, self.log).run(flow, done)
        except Exception:
            if self.engine.ended_by is not None:  # what else broke follows from it
                raise self.engine.ended_by from None
            raise

    def run_alone(self, body: "Callable[[TaskRuns], None]") -> None:
        """Run a flow of this stage alone; `body` maps its task runs."""

        def called() -> Any:
            from prefect import flow

            from vastflow.flows.run.task_runs import task_runs_of

            @flow(name=self.stage, flow_run_name=self.title, persist_result=False)
            def alone() -> None:
                with task_runs_of(self.name, self.engine) as task_runs:
                    body(task_runs)

            self.tally.begin("instantiating" if self.stage == "instantiate" else "running")
            return alone(return_state=True)

        self.run(called)


@contextmanager
def show_progress(observer: Observer | None) -> Iterator[Tally]:
    """The progress of a call, shown to `observer` from one thread; meanwhile SIGTERM interrupts as Ctrl-C does."""
    tally = Tally()
    with process.terminable(), Reporter(tally, observer):
        yield tally


@contextmanager
def open_computing(
    opened: OpenCampaign,
    keys: Keys,
    oracles: Sequence[Oracle[Any]],
    tally: Tally,
    *,
    stage: str = "",
    workers: int | None = None,
    stopping: RunsWanted | None = None,
    cluster: str | None = None,
) -> Iterator[Computing]:
    """Open the computation of a call with a log in the store's local folder, and close it.

    Raises:
        StoreError: this machine lacks something that a computation needs.
    """
    created = datetime.now()
    label = f"{directory_name(opened.name)}-{stage}" if stage else directory_name(opened.name)
    logs = opened.store.local if opened.store.unwritable is None else Path(user_cache_dir("vastflow"))
    log = campaign_log.new_log(logs / "logs", label, created)
    with campaign_log.own_log(log):
        check_machine()
        pool = Pool(workers or cores(), log)
        executor = pool if cluster is None else _cluster(cluster, opened.store, pool, tally, log)
        options: dict[str, Any] = {"whole_units": not stage}
        if cluster is None:  # else workers of other machines keep pace or not
            options["pace"] = Pace(pool, tally.notice).keep
        engine = Engine(Index(opened.store, keys), executor, tally, oracles, stopping, **options)
        try:
            yield Computing(opened.name, stage, engine, tally, log, created)
        finally:
            engine.close()


def _cluster(address: str, store: Store, local: Executor, tally: Tally, log: Path) -> Executor:
    try:
        from vastflow.tasks.engine.dask_cluster import DaskCluster
    except ImportError as error:
        raise UserError(f"--cluster: Dask is missing ({error}). Call pip install 'vastflow[dask]'.") from None
    return DaskCluster(address, store, local, tally, log)
