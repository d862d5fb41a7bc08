"""The ledger of flow runs, with and without a real API of Prefect's."""

import json
import os
import subprocess
import sys
import time

import pytest
from table import each_row

from vastflow.tasks.prefect import ledger

RUN = "00000000-0000-4000-8000-000000000001"


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    """The user's state folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path


def changed(**values):
    (file,) = ledger.folder().glob("*.json")
    file.write_text(json.dumps({**json.loads(file.read_text()), **values}))


def gone_pid():
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    return ended.pid


def test_a_flow_run_of_a_living_process_is_no_orphan_and_leaves_nothing_behind():
    ledger.enter(RUN, "http://x/api")
    assert ledger.orphans() == []
    ledger.leave(RUN)
    assert list(ledger.folder().iterdir()) == []


def test_a_flow_run_whose_process_is_gone_is_an_orphan():
    ledger.enter(RUN, "http://x/api")
    changed(pid=gone_pid())
    assert [(entry.flow_run_id, entry.api) for entry in ledger.orphans()] == [(RUN, "http://x/api")]


def test_a_later_process_of_the_same_number_does_not_run_it():
    ledger.enter(RUN, "http://x/api")
    changed(began_s=1.0)
    assert len(ledger.orphans()) == 1


def test_of_processes_on_another_host_nothing_is_known_here():
    ledger.enter(RUN, "http://x/api")
    changed(pid=gone_pid(), host="elsewhere")
    assert ledger.orphans() == []


def test_a_flow_run_is_in_the_ledger_by_a_tag_until_it_has_begun_and_its_task_runs_do_not_have_it():
    from prefect import tags
    from prefect.context import TagsContext

    with tags("mine"), ledger.announced("http://x/api"):
        (mark,) = TagsContext.get().current_tags - {"mine"}
        assert [file.stem for file in ledger.folder().iterdir()] == [mark]
        with ledger.begun(RUN, "http://x/api"):
            assert [file.stem for file in ledger.folder().iterdir()] == [RUN]
            assert TagsContext.get().current_tags == {"mine"}


@each_row("content", ["", "{", "[]", '{"pid": 1}'])
def test_a_damaged_entry_is_passed_over(content):
    ledger.enter(RUN, "http://x/api")
    (ledger.folder() / f"{RUN}.json").write_text(content)
    assert ledger.orphans() == []


def test_what_nobody_could_tell_prefect_of_in_a_month_is_forgotten():
    ledger.enter(RUN, "http://x/api")
    changed(pid=gone_pid())
    long_ago = time.time() - 31 * 24 * 3600
    os.utime(ledger.folder() / f"{RUN}.json", (long_ago, long_ago))
    assert ledger.orphans() == []
    assert list(ledger.folder().iterdir()) == []


def test_a_state_folder_that_cannot_be_written_is_no_reason_to_fail(state, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(state / "file" / "below"))
    (state / "file").touch()
    ledger.enter(RUN, "http://x/api")
    ledger.leave(RUN)
    assert ledger.orphans() == []


def test_without_an_orphan_prefect_is_not_imported():
    script = "import sys; from vastflow.tasks.prefect import ledger; ledger.end_orphans('x'); print('prefect' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=240, check=True)
    assert done.stdout == "False\n"


def test_an_api_that_is_not_there_leaves_the_entry_for_the_next_call(caplog):
    from prefect.settings import temporary_settings

    ledger.enter(RUN, "http://127.0.0.1:9/api")
    changed(pid=gone_pid())
    with temporary_settings({"api.url": "http://127.0.0.1:9/api"}):
        assert ledger.end_orphans("http://127.0.0.1:9/api") == 0
    assert f"flow run {RUN} of a process that is gone stays open" in caplog.text
    assert len(ledger.orphans()) == 1


class Answer:
    def __init__(self, content):
        self._content = content

    def json(self):
        return self._content


class ShardsOf:
    """An API with flow runs that a dead campaign asked a work pool for; a worker ends one at each look."""

    def __init__(self, waiting):
        self.waiting, self.cancelling, self.ended, self.parents = waiting, 0, 0, set()

    def request(self, method, address, json):
        some = json["flow_runs"]
        self.parents |= set(some["parent_flow_run_id"]["any_"])
        of_all = "CANCELLING" not in some["state"]["type"]["not_any_"]
        if address == "/flow_runs/bulk_set_state" and json["state"]["type"] == "CANCELLED":
            self.ended += json["limit"] if json["force"] else 0
            return Answer({})
        if address == "/flow_runs/bulk_set_state":
            moved = min(json["limit"], self.waiting)
            self.waiting, self.cancelling = self.waiting - moved, self.cancelling + moved
            return Answer({})
        if of_all:
            self.cancelling = max(self.cancelling - 60, 0)
        return Answer(self.waiting + of_all * self.cancelling)


def test_what_a_dead_campaign_asked_a_work_pool_for_is_called_off_and_waited_for(monkeypatch):
    monkeypatch.setattr(ledger, "_POLL_S", 0.0)
    shards = ShardsOf(130)
    ledger._call_off(shards, RUN)
    assert (shards.waiting, shards.cancelling, shards.ended, shards.parents) == (0, 0, 0, {RUN})


def test_workers_that_are_gone_too_are_not_waited_for_and_what_they_had_is_ended(monkeypatch):
    monkeypatch.setattr(ledger, "CALLED_OFF_S", 0.1)
    shards = ShardsOf(10**9)
    ledger._call_off(shards, RUN)
    assert shards.waiting > 0
    assert shards.ended > 0
