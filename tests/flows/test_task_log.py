"""Logs of task runs that are sent to Prefect's API."""

import logging
from types import SimpleNamespace

import pytest
from prefect.logging.configuration import setup_logging
from prefect.logging.handlers import APILogHandler

from vastflow.flows.flow_runs.task_runs import TASK_RUNS, quiet_task_runs


@pytest.fixture
def passes():
    """Whether the API's handler takes a record of a logger and level."""
    logger = logging.getLogger(TASK_RUNS)
    handler = APILogHandler()
    logger.addHandler(handler)
    try:
        yield lambda name, level: bool(handler.filter(logging.LogRecord(name, level, "", 0, "said", (), None)))
    finally:
        logger.removeHandler(handler)


def test_task_runs_send_warnings_and_flow_runs_everything(passes):
    with quiet_task_runs(SimpleNamespace(closed=False), "x"):
        assert not passes(TASK_RUNS, logging.INFO)
        assert passes(TASK_RUNS, logging.WARNING)
        assert passes("prefect.flow_runs", logging.INFO)


def test_afterwards_everything_is_sent_again(passes):
    with quiet_task_runs(SimpleNamespace(closed=False), "x"):
        pass
    assert passes(TASK_RUNS, logging.INFO)


def test_task_runs_of_an_ended_campaign_log_nothing_and_those_of_others_do():
    logger = logging.getLogger(TASK_RUNS)
    with quiet_task_runs(SimpleNamespace(closed=True), "x"):
        said = [bool(logger.filter(logging.makeLogRecord({"flow_run_id": each, "msg": "x"}))) for each in ("x", "y")]
    assert said == [False, True]


def test_prefect_has_its_handler_where_it_is_looked_for():
    setup_logging()
    assert any(isinstance(handler, APILogHandler) for handler in logging.getLogger(TASK_RUNS).handlers)
