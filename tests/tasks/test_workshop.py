import pickle
from concurrent.futures import Future

import pytest

from vastflow.oracles.oracle import oracles_of
from vastflow.sim.scenario import Scenario
from vastflow.tasks import work
from vastflow.tasks.keys import Keys
from vastflow.tasks.pool import PoolClosed, WorkerDied
from vastflow.tasks.progress import Tally
from vastflow.tasks.shelf import Member, Shelf
from vastflow.tasks.store import StoreError, open_store
from vastflow.tasks.work import Broken, Executed, Gone
from vastflow.tasks.workshop import MemberFault, Workshop, block_size


def member(name, runs=2):
    return Member(name, "room", 1, Scenario("builtin:navigate_to_pose", 60.0, {}, {"name": name}, {}), runs)


class Pool:
    """Does jobs at once in this thread with stand-ins for the stages; `answers` says what becomes of a member."""

    def __init__(self):
        self.done = []
        self.answers = {}

    def submit(self, priority, function, *arguments):
        assert function is work.answered
        future = Future()
        try:
            future.set_result(self._do(*arguments))
        except Exception as error:  # noqa: BLE001 - as a pool does
            future.set_exception(error)
        return future

    def _do(self, stage, *arguments):
        scenario = next((each for each in arguments if isinstance(each, Scenario)), None)
        name = scenario.task["name"] if scenario else ""
        self.done.append((stage.__name__, name))
        answer = self.answers.get((stage.__name__, name))
        if callable(answer):
            answer = answer(*arguments)
        if isinstance(answer, Exception):
            raise answer
        if answer is not None:
            return answer
        store = arguments[0] if arguments else None
        if stage is work.execute:
            _, home, _, start, stop, _ = arguments
            store.put(f"{home}/{start}-{stop}", {"recordings.parquet": f"{name} {start} {stop}".encode()})
            return Executed({run: 10.0 for run in range(start, stop)}, {})
        if stage is work.observe:
            store.put(arguments[2], {"traces.parquet": b"trace"})
        if stage is work.judge:
            store.put(arguments[3], {"verdicts.json": b"[]"}, {"runs": [[0, "pass"], [1, "fail"]]})
        return None


@pytest.fixture
def pool():
    return Pool()


@pytest.fixture
def shop(tmp_path, pool):
    shelf = Shelf(open_store(tmp_path), Keys("numeric", "e", "o", "j", 0, []))
    tally = Tally()
    tally.expect({"a": 2, "b": 2})
    made = Workshop(shelf, pool, tally, pickle.dumps(oracles_of([])))
    made.tally = tally
    return made


def through(shop, members):
    recorded, all_recorded = shop.execute(members)
    observed, all_observed = shop.observe(members, recorded)
    judged, all_judged = shop.judge(members, observed)
    return judged, (all_recorded, all_observed, all_judged)


def test_each_stage_does_each_member_once(shop, pool):
    members = [member("a"), member("b")]
    judged, complete = through(shop, members)
    assert complete == (True, True, True)
    assert [len(rows) for rows in judged] == [1, 1]
    assert sorted(pool.done) == [(stage, name) for stage in ("execute", "judge", "observe") for name in "ab"]
    progress = shop.tally.progress()
    assert (progress.executed, progress.passed, progress.failed) == (4, 2, 2)


def test_what_is_in_the_store_is_not_computed(shop, pool):
    through(shop, [member("a")])
    pool.done.clear()
    shop._executing.clear()
    through(shop, [member("a"), member("b")])
    assert sorted(pool.done) == [("execute", "b"), ("judge", "b"), ("observe", "b")]


def test_a_member_started_early_is_not_started_again(shop, pool):
    shop.start_executing(member("a"))
    shop.execute([member("a")])
    assert pool.done == [("execute", "a")]


def test_kernels_are_compiled_before_anything_executes(shop, pool):
    shop.warm_up()
    shop.execute([member("a")])
    assert pool.done == [("compile_kernels", ""), ("execute", "a")]


@pytest.mark.parametrize("stage", ["execute", "observe", "judge"])
@pytest.mark.parametrize("error", [Broken("ValueError: x"), WorkerDied("died"), RuntimeError("can't be pickled")])
def test_an_error_costs_its_member_and_no_other(shop, pool, stage, error):
    pool.answers[stage, "a"] = error
    judged, complete = through(shop, [member("a"), member("b")])
    assert [len(rows) for rows in judged] == [0, 1]
    assert complete[("execute", "observe", "judge").index(stage)] is False
    assert {(fault.member, fault.run_index, fault.stage) for fault in shop.faults} == {("a", 0, stage), ("a", 1, stage)}
    assert shop.tally.progress().not_judged == 2


def test_a_run_that_kills_its_worker_costs_no_other_run_of_its_block(shop, pool):
    pool.answers["execute", "a"] = lambda *arguments: WorkerDied("died") if arguments[3] <= 1 < arguments[4] else None
    recorded, complete = shop.execute([member("a", runs=2)])
    assert [row[:2] for row in recorded[0]] == [[0, 1]]
    assert not complete
    assert shop.faults == (MemberFault("a", 1, "execute", "died"),)


def test_one_broken_run_is_one_fault(shop, pool):
    pool.answers["execute", "a"] = Executed({0: 1.0}, {1: Broken("ValueError: x")})
    shop.execute([member("a")])
    assert shop.faults == (MemberFault("a", 1, "execute", "ValueError: x"),)


def test_a_lost_artifact_is_no_fault_but_leaves_the_shard_incomplete(shop, pool):
    pool.answers["observe", "a"] = Gone("recordings")
    _, complete = through(shop, [member("a")])
    assert complete == (True, False, True)
    assert shop.faults == ()


def test_a_closed_pool_ends_the_stage(shop, pool):
    pool.answers["execute", "a"] = PoolClosed()
    with pytest.raises(PoolClosed):
        shop.execute([member("a")])


def test_a_block_is_short_enough_for_every_worker_to_have_several():
    assert block_size(20, 2) == 3
    assert block_size(120, 2) == 15
    assert block_size(109_600, 2) == 20
    assert block_size(1, 8) == 1


def test_a_store_that_cannot_be_used_any_more_ends_everything_and_is_no_members_fault(shop, pool):
    pool.answers["observe", "a"] = StoreError("store: the disk is full")
    pool.close = lambda: pool.done.append("closed")
    members = [member("a"), member("b")]
    recorded, _ = shop.execute(members)
    with pytest.raises(StoreError, match="the disk is full"):
        shop.observe(members, recorded)
    assert str(shop.store_error) == "store: the disk is full"
    assert pool.done[-1] == "closed"
    assert shop.faults == ()
