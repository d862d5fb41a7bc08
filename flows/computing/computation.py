"""A computation: one run of a Prefect flow, with a pool of its own and, where none is configured, an API of its own."""

import contextvars
import functools
import logging
import os
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final

from vastflow.tasks import chatter, ending, ledger
from vastflow.tasks.engine import Engine, block_size
from vastflow.tasks.index import Index, Member
from vastflow.tasks.pool import Pool, PoolClosed
from vastflow.tasks.progress import Tally
from vastflow.tasks.server import (
    SENDING_S,
    ApiServer,
    PrefectUnavailable,
    configured_url,
    embedded,
    end_services,
    prefect_home,
)
from vastflow.tasks.store import StoreError
from vastflow.tasks.surroundings import check_surroundings

LOGGER: Final = logging.getLogger("vastflow.computation")

CONFIGURED: Final = "PREFECT_API_URL"

FLOWS: Final = 3
"""As often a flow is begun at an embedded API that fails it; what it has computed stays."""

WAVES: Final = 3
"""As often what got lost from the store meanwhile is computed again before it is given up."""

GONE_S: Final = 1.0
"""What Prefect's services may take to send what they have, to a server that has just failed the flow."""

_JOIN_S: Final = 3.0


class Computation:
    """Server and pool start with the object, beside whatever its owner does next; `run` ends both.

    Args:
        oracles: The pickled oracles.
        workers: Worker processes.
        log: File for all that would be said on the terminal otherwise.

    Raises:
        SurroundingsError: this machine lacks something that a computation needs.

    Attributes:
        engine: What the flow's stages work with.
        flow_run_id: Of the flow run that has ended, where an API is configured that outlives it and no other flow run is round it.
    """

    def __init__(self, index: Index, oracles: bytes, workers: int, tally: Tally, log: Path) -> None:
        check_surroundings()
        # Where one is configured it costs no processor time beside it; a profile of Prefect's says so only later.
        self._server = None if os.environ.get(CONFIGURED) else ApiServer(log)
        self._pool = Pool(workers, log)
        self._log = log
        self._tally = tally
        self.flow_run_id: str | None = None
        self.engine = Engine(index, self._pool, tally, oracles)

    def run(
        self, flow: Callable[[Engine], Any], begin: Callable[[Engine], None] = lambda engine: None
    ) -> BaseException | None:
        """Run a flow to its end.

        Args:
            flow: Calls the flow with what its tasks take and gives its final state. It is called in a thread of its own and
                with Prefect at hand, so that it may import modules that import Prefect.
            begin: Lets workers begin while Prefect starts.

        Returns:
            What the flow raised; `PrefectUnavailable` where its API was gone, and tasks may have ended all the same.

        Raises:
            StoreError: the store can't be used any more.
            PrefectUnavailable: Prefect's API can't be started.
        """
        flow_run = _Thread(lambda: self._run(flow))
        try:
            begin(self.engine)
            flow_run.start()
            try:
                return flow_run.outcome()
            finally:
                if self.engine.store_error is not None:  # what else broke follows from it
                    raise self.engine.store_error
        except KeyboardInterrupt:
            bound = ending.bound(self._kill_server) if ending.owns_process() else None
            chatter.hush()
            self._pool.close()
            if self._server is not None and not self._server.answers:
                self._server.stop(0)  # the flow waits for it
            if flow_run.ended(_JOIN_S) and bound is not None:
                bound.cancel()
            self._kill_server()
            raise
        finally:
            self._pool.close()
            if self._server is not None:
                self._server.stop()

    def _kill_server(self) -> None:
        if self._server is not None:
            self._server.stop(0)

    def _run(self, flow: Callable[[Engine], Any]) -> BaseException | None:
        with ExitStack() as stack:
            stack.enter_context(chatter.prefect_log(self._log))
            from vastflow.tasks.patience import bounded

            configured = configured_url()
            if configured:
                self._kill_server()
                stack.enter_context(bounded())
            else:
                self._server = self._server or ApiServer(self._log)
                stack.enter_context(embedded(self._server.url()))
                for notice in self._server.notices:
                    self._tally.notice(notice)
            api = configured or str(prefect_home())
            ledger.end_orphans(api)
            for tries_left in reversed(range(1 if configured else FLOWS)):
                ended = False
                try:
                    with ledger.announced(api):
                        state = flow(self.engine)
                    ended = True
                    break
                except Exception as error:  # what a flow raises is in its state: this is of Prefect itself
                    LOGGER.warning("Prefect's API failed the flow", exc_info=True)
                    if not tries_left:
                        return PrefectUnavailable(_refusal(configured, self._log, error))
                    if self._server is not None:
                        self._server.url()  # killed before the flow had heard of it; it is back with this
                finally:
                    end_services(SENDING_S if ended else GONE_S)
            if state.state_details.flow_run_id is not None:
                ledger.leave(str(state.state_details.flow_run_id))
            if configured and not inside_flow_run() and state.state_details.flow_run_id is not None:
                self.flow_run_id = str(state.state_details.flow_run_id)
        error: BaseException | None = None if state.is_completed() else state.result(raise_on_failure=False)
        return error


def end_orphans(log: Path) -> None:
    """End flow runs of processes that are gone at an API that outlives its campaigns. Without any Prefect is not imported."""
    if any(entry.api.startswith("http") for entry in ledger.orphans()):
        with chatter.prefect_log(log):
            ledger.end_orphans(configured_url() or "")


def inside_flow_run() -> bool:
    """Whether this call comes from inside a flow run, whose page and artifacts are then not this call's business."""
    from prefect.context import FlowRunContext

    return FlowRunContext.get() is not None


def _refusal(configured: str | None, log: Path, error: Exception) -> str:
    said = " ".join(str(error).split())[:200] or type(error).__name__
    if configured is None:
        return f"Prefect's embedded API failed ({said}); see {log}"
    return f"Prefect's API at {configured} failed ({said}); start it (`prefect server start`), or unset PREFECT_API_URL"


class _Thread:
    """A call in a thread of its own: Prefect's flow must not find a notebook's event loop, nor Ctrl-C.

    What the caller's context holds goes along, so that inside a flow run of Prefect's this one is its child.
    """

    def __init__(self, function: Callable[[], BaseException | None]) -> None:
        self._function = functools.partial(contextvars.copy_context().run, function)
        self._answer: BaseException | None = None
        self._error: BaseException | None = None
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._call, name="vastflow flow", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def ended(self, timeout_s: float) -> bool:
        """Whether it ends within `timeout_s`."""
        return self._done.wait(timeout_s)

    def outcome(self) -> BaseException | None:
        """Wait for the end; gives what the function gave and raises what it raised."""
        while not self._done.wait(1.0):  # with a time limit, so that Ctrl-C is heard on every system
            pass
        if self._error is not None:
            raise self._error
        return self._answer

    def _call(self) -> None:
        try:
            self._answer = self._function()
        except BaseException as error:  # noqa: BLE001 - raised again in the thread that waits
            self._error = error
        finally:
            self._done.set()


def begin_executing(engine: Engine, members: Sequence[Member], missing_runs: int, workers: int) -> None:
    """Compile kernels where a robot drives, and hand the missing runs of members to the pool, while Prefect starts."""
    if any(member.drives for member in members):
        engine.warm_up()
    engine.block_runs = block_size(missing_runs, workers)

    def start_all() -> None:
        with suppress(PoolClosed, StoreError):  # the flow meets the same
            for member in members:
                engine.start_executing(member)

    threading.Thread(target=start_all, daemon=True).start()


def cores() -> int:
    """Processors this process may use: worker processes where nobody says how many."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
