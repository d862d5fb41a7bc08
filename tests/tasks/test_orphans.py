"""Flow runs whose process is gone: told by their tags, and what they asked of a work pool is canceled."""

import subprocess
import sys

import psutil
import pytest
from prefect.context import TagsContext

from vastflow.tasks.prefect import orphans
from vastflow.tasks.prefect.orphans import is_orphan, process_tags, tagged, untagged

RUN = "00000000-0000-4000-8000-000000000001"


def tags_of(pid, began_s):
    host, _ = process_tags()
    return [host, f"process:{pid}@{began_s}", "vastflow"]


def test_flow_run_of_a_living_process_is_no_orphan():
    assert not is_orphan(["vastflow", *process_tags()])


def test_flow_run_whose_process_is_gone_is_an_orphan():
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    assert is_orphan(tags_of(ended.pid, 1))


def test_later_process_of_the_same_number_does_not_run_it():
    process = psutil.Process()
    assert is_orphan(tags_of(process.pid, int(process.create_time()) - 60))


def test_flow_run_of_another_host_or_without_tags_is_no_orphan():
    _, process, name = tags_of(1, 1)
    assert not is_orphan(["host:elsewhere/1", process, name])
    assert not is_orphan([name])


def test_flow_runs_have_the_tags_of_their_process_and_task_runs_do_not():
    from prefect import tags

    with tags("mine"), tagged():
        assert TagsContext.get().current_tags == {"mine", *process_tags()}
        with untagged():
            assert TagsContext.get().current_tags == {"mine"}


class Answer:
    def __init__(self, content):
        self._content = content

    def json(self):
        return self._content


class ShardsOf:
    """An API with flow runs that a dead campaign asked of a work pool; a worker ends 60 at each look, if there is one."""

    def __init__(self, waiting, worker=60):
        self.waiting, self.cancelling, self.worker, self.parents = waiting, 0, worker, set()

    def request(self, method, address, json):
        self.parents |= set(json["flow_runs"]["parent_flow_run_id"]["any_"])
        if address == "/flow_runs/bulk_set_state":
            assert "CANCELLING" in json["flow_runs"]["state"]["type"]["not_any_"]
            moved = min(json["limit"], self.waiting)
            self.waiting, self.cancelling = self.waiting - moved, self.cancelling + moved
            return Answer({})
        self.cancelling = max(self.cancelling - self.worker, 0)
        return Answer(self.waiting + self.cancelling)


def test_what_a_dead_campaign_asked_of_a_work_pool_is_canceled_and_waited_for(monkeypatch):
    monkeypatch.setattr(orphans, "_POLL_S", 0.0)
    shards = ShardsOf(130)
    orphans._call_off(shards, RUN)
    assert (shards.waiting, shards.cancelling, shards.parents) == (0, 0, {RUN})


@pytest.mark.timeout(60)
def test_workers_that_are_gone_too_are_not_waited_for(monkeypatch):
    monkeypatch.setattr(orphans, "CALLED_OFF_S", 0.1)
    shards = ShardsOf(10, worker=0)
    orphans._call_off(shards, RUN)
    assert (shards.waiting, shards.cancelling) == (0, 10)
