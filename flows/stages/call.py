"""One call of a stage of the Python API: what is missing in the store is computed by a flow of Prefect's, all else is found."""

import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vastflow.flows.flow_runs.flow_call import FlowCall
from vastflow.flows.request.campaign_file import OpenCampaign
from vastflow.flows.results.directory import directory_name
from vastflow.oracles.judgement.oracle import Oracle
from vastflow.tasks.engine import process
from vastflow.tasks.engine.engine import Engine, RunFault, RunsWanted
from vastflow.tasks.engine.index import ConfigurationRuns, Index
from vastflow.tasks.engine.machine_check import check_machine
from vastflow.tasks.engine.pool import Pool, cores
from vastflow.tasks.engine.progress import Observer, Reporter, Tally
from vastflow.tasks.engine.shards import Shard, missing_shards
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.prefect import campaign_log
from vastflow.tasks.store.store import Lost

if TYPE_CHECKING:
    from vastflow.flows.flow_runs.task_runs import TaskRuns


@dataclass(frozen=True, slots=True)
class StageRun:
    """A stage that is run alone.

    Attributes:
        name: The campaign's.
        stage: `instantiate`, `execute`, `observe` or `judge`; or what has these three together.
        title: Name of the flow run, if there is one.
        log: File for what would be said on the terminal otherwise.
    """

    name: str
    stage: str
    title: str
    engine: Engine
    workers: int
    tally: Tally
    log: Path

    def completed(
        self,
        configurations: Sequence[ConfigurationRuns],
        whole: Callable[[ConfigurationRuns], bool],
        mapped: "Callable[[Sequence[Shard], TaskRuns], None]",
        begin: Callable[[Sequence[ConfigurationRuns]], None] = lambda configurations: None,
    ) -> tuple[RunFault, ...]:
        """Compute what is missing; gives the faults that are left.

        Args:
            configurations: All of them: they are cut into the same shards whatever is missing.
            whole: Whether the store has everything of a configuration.
            mapped: Maps the stage over shards, and waits.
            begin: Lets workers begin with the configurations that miss something while Prefect starts.

        Raises:
            StoreError: the store can't be used.
            PrefectUnavailable: Prefect's API can't be had.
        """

        def absent() -> list[ConfigurationRuns]:
            self.tally.begin("scanning")
            broken = self.engine.broken
            return [
                configuration
                for configuration in configurations
                if not whole(configuration) and configuration.name not in broken
            ]

        for _ in self.engine.attempts():
            if missing := absent():
                shards = missing_shards(configurations, {configuration.name for configuration in missing})
                call = FlowCall(self.engine, self.tally, self.log)
                begin(missing)
                with suppress(Lost):
                    self.flow(call, partial(mapped, shards))
            if not missing or not absent():
                break
        return self.engine.faults

    def flow(self, call: FlowCall, body: "Callable[[TaskRuns], None]") -> None:
        """Run a flow of this stage alone.

        Raises:
            StoreError: the store can't be used.
            PrefectUnavailable: Prefect's API can't be had.
        """

        def flow() -> Any:
            from vastflow.flows.stages.flow import stage_flow

            self.tally.begin("instantiating" if self.stage == "instantiate" else "running")
            return stage_flow(self.stage, self.title, self.name, self.engine, body)(return_state=True)

        try:
            call.run(flow)
        except Exception:
            if self.engine.store_error is not None:  # what else broke follows from it
                raise self.engine.store_error from None
            raise


@contextmanager
def stage_run(
    opened: OpenCampaign,
    stage: str,
    keys: Keys,
    oracles: Sequence[Oracle[Any]] = (),
    workers: int | None = None,
    observer: Observer | None = None,
    stopping: RunsWanted | None = None,
) -> Iterator[StageRun]:
    """Begin a call: Ctrl-C and SIGTERM end it within seconds, what it says goes to a log below the store's local folder.

    Args:
        keys: Of what is computed.
        oracles: Those that judge, if any do.
        stopping: None where the number of runs of a configuration is fixed.

    Raises:
        MachineError: this machine lacks something that a computation needs.
    """
    created, tally = datetime.now(), Tally()
    with process.terminable(), Reporter(tally, observer):
        log = campaign_log.new_log(opened.store.local / "logs", f"{directory_name(opened.name)}-{stage}", created)
        with campaign_log.own_log(log):
            title = f"{stage} {opened.name} {created:%Y-%m-%d %H:%M:%S}"
            count = workers or cores()
            check_machine()
            engine = Engine(Index(opened.store, keys), Pool(count, log), tally, pickle.dumps(tuple(oracles)), stopping)
            try:
                yield StageRun(opened.name, stage, title, engine, count, tally, log)
            finally:
                engine.close()
