"""Requests to a Prefect server that is away for a while, for ever, or only says no."""

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


@pytest.fixture
def server(monkeypatch):
    """Makes a server by whose clock requests are patient."""

    def made(*failures):
        found = Server(*failures)
        monkeypatch.setattr(retry, "time", found)
        return found

    return made


def test_server_that_comes_back_is_not_missed(server):
    missed = []
    assert retried(server(GONE, answered(503), GONE), 5.0, missed=missed.append) == "answer"
    assert missed == [GONE]


def test_server_that_stays_away_is_given_up_after_the_time_that_is_given(server):
    away = server(*[GONE] * 100)
    with pytest.raises(httpx.ConnectError, match="refused"):
        retried(away, 5.0)
    assert 5.0 < away.now_s <= 7.0


def test_what_a_server_refuses_is_not_asked_again(server):
    there = server(answered(409))
    with pytest.raises(PrefectHTTPStatusError, match="no"):
        retried(there, 5.0)
    assert there.now_s == 0.0


def test_nobody_waits_once_the_campaign_was_ended(server):
    away = server(*[GONE] * 100)
    with pytest.raises(httpx.ConnectError, match="refused"):
        retried(away, 5.0, ended=lambda: True)
    assert away.now_s == 0.0


def test_prefects_own_clients_give_up_soon_unless_the_user_has_set_how_often_they_try():
    before = get_current_settings().client.max_retries
    with bounded():
        assert get_current_settings().client.max_retries == RETRIES < before
    with temporary_settings({"client.max_retries": 9}), bounded():
        assert get_current_settings().client.max_retries == 9
