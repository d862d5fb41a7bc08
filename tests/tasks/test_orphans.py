"""Flow runs whose process is gone: found by their tags, and their shards in a work pool canceled."""

import subprocess
import sys
from types import SimpleNamespace

import psutil
import pytest
from prefect import tags
from prefect.context import TagsContext

from vastflow.tasks.prefect import orphans
from vastflow.tasks.prefect.orphans import is_orphan, process_tags, tagged, untagged

RUN = "00000000-0000-4000-8000-000000000001"


def test_flow_run_is_an_orphan_if_its_process_on_this_host_is_gone():
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    host, own = process_tags()
    process = psutil.Process()
    later = f"process:{process.pid}@{int(process.create_time()) - 60}"  # another process of the same number
    assert is_orphan([host, f"process:{ended.pid}@1", "vastflow"]) and is_orphan([host, later])
    for names in (["vastflow", host, own], ["host:elsewhere/1", "process:1@1"], ["vastflow"]):
        assert not is_orphan(names)


def test_flow_runs_have_the_tags_of_their_process_and_task_runs_do_not():
    with tags("mine"), tagged():
        assert TagsContext.get().current_tags == {"mine", *process_tags()}
        with untagged():
            assert TagsContext.get().current_tags == {"mine"}


class ShardsOf:
    """An API with shards of a dead campaign; a worker ends 60 at each look, if there is one."""

    def __init__(self, waiting, worker):
        self.waiting, self.cancelling, self.worker, self.parents = waiting, 0, worker, set()

    def request(self, method, address, json):
        self.parents |= set(json["flow_runs"]["parent_flow_run_id"]["any_"])
        content = {}
        if address == "/flow_runs/bulk_set_state":
            assert "CANCELLING" in json["flow_runs"]["state"]["type"]["not_any_"]
            moved = min(json["limit"], self.waiting)
            self.waiting, self.cancelling = self.waiting - moved, self.cancelling + moved
        else:
            self.cancelling = max(self.cancelling - self.worker, 0)
            content = self.waiting + self.cancelling
        return SimpleNamespace(json=lambda: content)


@pytest.mark.timeout(60)
@pytest.mark.parametrize(("waiting", "worker", "wait_s", "left"), [(130, 60, 30.0, 0), (10, 0, 0.1, 10)])
def test_shards_of_a_dead_campaign_are_canceled_and_waited_for(monkeypatch, waiting, worker, wait_s, left):
    monkeypatch.setattr(orphans, "_POLL_S", 0.0)
    monkeypatch.setattr(orphans, "CALLED_OFF_S", wait_s)
    shards = ShardsOf(waiting, worker)
    orphans._call_off(shards, RUN)
    assert (shards.waiting, shards.cancelling, shards.parents) == (0, left, {RUN})
