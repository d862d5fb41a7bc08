"""A flow whose Prefect API fails: restarted if embedded, reported if it is the user's."""

import contextlib
from types import SimpleNamespace

import httpx
import pytest
from prefect.exceptions import PrefectHTTPStatusError
from table import each_row

from vastflow.flows.run import flow_call
from vastflow.flows.run.flow_call import FLOWS, FlowCall
from vastflow.tasks.engine.engine import Engine
from vastflow.tasks.engine.index import Index
from vastflow.tasks.engine.pool import Pool
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.prefect import campaign_log
from vastflow.tasks.prefect.server import PrefectUnavailable
from vastflow.tasks.store.store import open_store

pytestmark = pytest.mark.timeout(900)


@pytest.fixture
def made(tmp_path, monkeypatch):
    """A call at an embedded API of a flow that has nothing to compute."""
    server = SimpleNamespace(answers=True, notices=(), auth="vastflow:secret", url=lambda: "http://127.0.0.1:9/api")
    server.stop = lambda grace_s=3.0: None
    monkeypatch.setattr(flow_call, "ApiServer", lambda log: server)
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "prefect"))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    index = Index(open_store(tmp_path / "store"), Keys("numeric", "e", "o", "j", 0, []))
    tally = Tally()
    return FlowCall(Engine(index, Pool(1), tally, ()), tally, tmp_path / "log")


class Flow:
    """A flow that its API fails some times."""

    def __init__(self, failures, error=lambda: RuntimeError("Failed to reach API")):
        self.begun = 0
        self._failures, self._error = failures, error

    def __call__(self):
        from prefect.states import Completed

        self.begun += 1
        if self.begun <= self._failures:
            raise self._error()
        return Completed()


EMBEDDED = "Prefect's embedded API failed (Failed to reach API). See {log}"
CONFIGURED = "Prefect's API at http://lab:4200/api failed (Failed to reach API). Start it (`prefect server start`), "


@each_row(
    ("failures", "configured", "begun", "words"),
    [
        (FLOWS - 1, None, FLOWS, None),
        (FLOWS, None, FLOWS, EMBEDDED),
        (1, "http://lab:4200/api", 1, f"{CONFIGURED}or unset PREFECT_API_URL"),
    ],
)
def test_flow_is_retried_only_with_embedded_api(made, monkeypatch, failures, configured, begun, words):
    monkeypatch.setattr(flow_call, "configured_url", lambda: configured)
    if configured:
        monkeypatch.setattr(flow_call, "ApiServer", lambda log: pytest.fail("an embedded API was started"))
    flow, said = Flow(failures), None
    try:
        made.run(flow)
    except PrefectUnavailable as error:
        said = str(error)
    assert (said, flow.begun) == (words and words.format(log=made._log), begun)


@pytest.mark.parametrize(("status", "begun"), [(503, 3), (401, 1)])
def test_flow_restarts_when_configured_api_is_busy(made, monkeypatch, status, begun):
    monkeypatch.setattr(flow_call, "configured_url", lambda: "http://lab:4200/api")
    monkeypatch.setattr(flow_call.time, "sleep", lambda pause_s: None)
    request = httpx.Request("POST", "http://lab:4200/api/flows/")
    error = PrefectHTTPStatusError("no", request=request, response=httpx.Response(status, request=request))
    flow = Flow(2, lambda: wrapped(error))
    with contextlib.suppress(PrefectUnavailable):
        made.run(flow)
    assert flow.begun == begun


def wrapped(cause):
    """An error as Prefect makes it of the server's answer."""
    error = RuntimeError("Failed to reach API")
    error.__cause__ = cause
    return error


def test_finished_flow_is_not_restarted_when_its_api_fails(made):
    flow = Flow(FLOWS)
    made.run(flow, done=lambda: True)
    assert flow.begun == 1
    (notice,) = made._tally.progress().notices
    assert notice.startswith("all is computed, but Prefect's pages do not show the end: ")


def test_password_in_the_address_is_neither_printed_nor_kept(made, monkeypatch, tmp_path):
    monkeypatch.setattr(flow_call, "configured_url", lambda: "http://me:s3cret@lab:4200/api")

    def flow():
        raise RuntimeError("401 Unauthorized for url 'http://me:s3cret@lab:4200/api/flows/'")

    words = r"^Prefect's API at http://…@lab:4200/api failed"
    with campaign_log.own_log(tmp_path / "log"), pytest.raises(PrefectUnavailable, match=words) as found:
        made.run(flow)
    assert "s3cret" not in str(found.value) + (tmp_path / "log").read_text()
