"""A call of a Prefect flow, with an embedded API if none is configured."""

import contextvars
import ctypes
import logging
import os
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

from vastflow.tasks.engine import process
from vastflow.tasks.engine.engine import Engine
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.prefect import campaign_log
from vastflow.tasks.prefect.adapter import end_services
from vastflow.tasks.prefect.server import (
    SENDING_S,
    ApiServer,
    PrefectUnavailable,
    configured_url,
    embedded,
)
from vastflow.tasks.store.artifact import redacted

LOGGER: Final = logging.getLogger("vastflow.flow_call")

CONFIGURED: Final = "PREFECT_API_URL"

FLOWS: Final = 3
"""Maximum number of attempts when the embedded API fails a flow; computed results stay."""

GONE_S: Final = 1.0
"""Time for Prefect's services to send their queues to a server that has just failed the flow."""

_JOIN_S: Final = 3.0


class FlowCall:
    """One call of a flow; an embedded API starts with the object and ends with `run`.

    Args:
        engine: Engine that the flow computes with; an interrupt ends it.
        log: File for all that would be said on the terminal otherwise.
    """

    def __init__(self, engine: Engine, tally: Tally, log: Path) -> None:
        # Where one is configured it costs no processor time beside it; a profile of Prefect's says so only later.
        self._server = None if os.environ.get(CONFIGURED) else ApiServer(log)
        self._engine = engine
        self._log = log
        self._tally = tally

    def run(self, flow: Callable[[], Any], done: Callable[[], bool] = lambda: False) -> None:
        """Run a flow to its end.

        Args:
            flow: Calls the flow and gives its final state. It is called in a thread of its own and with Prefect at hand, so that it
                may import modules that import Prefect.
            done: Whether the flow has done all it is for, whatever becomes of Prefect's account of it.

        Raises:
            PrefectUnavailable: Prefect's API can't be started, or was gone before the flow had done all.
            Exception: what the flow raised.
        """
        self._tally.begin("starting Prefect")
        flow_run = _Thread(lambda: self._run(flow, done))
        try:
            flow_run.start()
            flow_run.wait()
        except KeyboardInterrupt:
            bound = process.bound(self._kill_server) if process.owns_process() else None
            campaign_log.hush()
            self._engine.close()
            if self._server is not None and not self._server.answers:
                self._server.stop(0)  # the flow waits for it
            if self._tally.progress().phase in ("reporting", "postprocessing"):
                flow_run.interrupt()
            if flow_run.ended(_JOIN_S) and bound is not None:
                bound.cancel()
            self._kill_server()
            raise
        finally:
            if self._server is not None:
                self._server.stop()

    def _kill_server(self) -> None:
        if self._server is not None:
            self._server.stop(0)

    def _run(self, flow: Callable[[], Any], done: Callable[[], bool]) -> None:
        with ExitStack() as stack:
            stack.enter_context(campaign_log.prefect_log(self._log))
            from vastflow.tasks.prefect.orphans import tagged
            from vastflow.tasks.prefect.retry import IN_BETWEEN_S, PAUSE_S, bounded, busy

            configured = configured_url()
            if configured:
                self._kill_server()
                stack.enter_context(bounded())
            else:
                self._server = self._server or ApiServer(self._log)
                stack.enter_context(embedded(self._server.url(), self._server.auth))
                for notice in self._server.notices:
                    self._tally.notice(notice)
            tries_left, deadline_s = FLOWS, time.monotonic() + IN_BETWEEN_S
            while True:
                tries_left -= 1
                ended = False
                try:
                    with tagged():
                        state = flow()
                    ended = True
                    break
                except Exception as error:  # what a flow raises is in its state: this is of Prefect itself
                    LOGGER.warning("Prefect's API failed the flow", exc_info=True)
                    said = redacted(" ".join(str(error).split()))[:200] or type(error).__name__
                    where, help_ = "embedded API", f"See {self._log}"
                    if configured:
                        where = f"API at {redacted(configured)}"
                        help_ = "Start it (`prefect server start`), or unset PREFECT_API_URL"
                    unavailable = PrefectUnavailable(f"Prefect's {where} failed ({said}). {help_}")
                    if done():
                        self._tally.notice(f"all is computed, but Prefect's pages do not show the end: {unavailable}")
                        return
                    is_busy = busy(error) and time.monotonic() < deadline_s
                    if self._engine.closed or not (is_busy if configured else tries_left):
                        raise unavailable from None
                    if configured:
                        time.sleep(PAUSE_S)
                    elif self._server is not None:
                        self._server.url()  # killed before the flow had heard of it; it is back with this
                finally:
                    end_services(SENDING_S if ended else GONE_S)
            if not state.is_completed() and not done():
                raise state.result(raise_on_failure=False)


class _Thread:
    """A call in a thread of its own: Prefect's flow must not find a notebook's event loop, nor Ctrl-C.

    What the caller's context holds goes along: so a flow finds what was opened for it, and inside a flow run of Prefect's this one is its child.
    """

    def __init__(self, function: Callable[[], None]) -> None:
        self._function = function
        self._context = contextvars.copy_context()
        self._error: BaseException | None = None
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._call, name="vastflow flow", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def ended(self, timeout_s: float) -> bool:
        """Whether it ends within `timeout_s`."""
        return self._done.wait(timeout_s)

    def interrupt(self) -> None:
        """Interrupt the flow, so that it removes unfinished files."""
        if self._thread.ident is not None:
            ctypes.pythonapi.PyThreadState_SetAsyncExc(
                ctypes.c_ulong(self._thread.ident), ctypes.py_object(KeyboardInterrupt)
            )

    def wait(self) -> None:
        """Wait for the end, and raise the function's error, if any."""
        while not self._done.wait(1.0):  # with a time limit, so that Ctrl-C is heard on every system
            pass
        if self._error is not None:
            raise self._error

    def _call(self) -> None:
        try:
            self._context.run(self._function)
        except BaseException as error:  # noqa: BLE001 - raised again in the thread that waits
            self._error = error
        finally:
            self._done.set()
