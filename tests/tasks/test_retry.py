"""Requests to a Prefect server that is away for a while, for ever, or only refuses."""

import httpx
import pytest
from prefect.exceptions import PrefectHTTPStatusError
from prefect.settings import get_current_settings, temporary_settings

from vastflow.tasks.prefect import retry
from vastflow.tasks.prefect.retry import RETRIES, bounded, retried

GONE = httpx.ConnectError("refused")


def answered(status):
    request = httpx.Request("POST", "http://api")
    return PrefectHTTPStatusError("no", request=request, response=httpx.Response(status, request=request))


class Server:
    """Fails as it is told, then answers; a second passes between two requests."""

    def __init__(self, *failures):
        self.failures, self.now_s = list(failures), 0.0

    def __call__(self):
        if self.failures:
            raise self.failures.pop(0)
        return "answer"

    def monotonic(self):
        return self.now_s

    def sleep(self, pause_s):
        self.now_s += pause_s


def test_request_is_repeated_until_the_server_is_back(monkeypatch):
    missed, server = [], Server(GONE, answered(503), GONE)
    monkeypatch.setattr(retry, "time", server)
    assert retried(server, 5.0, missed=missed.append) == "answer"
    assert missed == [GONE]


@pytest.mark.parametrize(
    ("failure", "ended", "least_s", "most_s"),
    [(GONE, False, 5.0, 7.0), (answered(409), False, 0.0, 0.0), (GONE, True, 0.0, 0.0)],
    ids=["away too long", "refused", "nobody waits"],
)
def test_request_is_given_up(monkeypatch, failure, ended, least_s, most_s):
    server = Server(*[failure] * 100)
    monkeypatch.setattr(retry, "time", server)
    with pytest.raises(type(failure), match=r"refused|no"):
        retried(server, 5.0, ended=lambda: ended)
    assert least_s <= server.now_s <= most_s


def test_prefect_clients_retry_briefly_unless_configured():
    before = get_current_settings().client.max_retries
    with bounded():
        assert get_current_settings().client.max_retries == RETRIES < before
    with temporary_settings({"client.max_retries": 9}), bounded():
        assert get_current_settings().client.max_retries == 9
