"""Garbage collection: seldom while a campaign is under way, and as before afterwards."""

import gc

import pytest

from vastflow.tasks.engine.process import few_collections


@pytest.fixture
def thresholds():
    before = gc.get_threshold()
    gc.set_threshold(700, 10, 10)
    yield gc.get_threshold()
    gc.set_threshold(*before)


def test_python_looks_for_garbage_seldom_inside_and_as_before_afterwards(thresholds):
    with few_collections():
        assert gc.get_threshold()[0] > 10 * thresholds[0]
    assert gc.get_threshold() == thresholds


def test_it_looks_as_before_after_an_error_too(thresholds):
    with pytest.raises(ValueError, match="inside"), few_collections():
        raise ValueError("inside")
    assert gc.get_threshold() == thresholds


def test_who_has_switched_it_off_keeps_it_off(thresholds):
    gc.set_threshold(0)
    with few_collections():
        assert gc.get_threshold()[0] == 0
