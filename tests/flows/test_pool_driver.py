"""The driver of a work pool: what it does with shards that succeed, fail, fall silent or are never taken."""

import itertools
import threading
from collections import Counter
from dataclasses import replace

import pytest
from table import each_row

from vastflow.flows.pool import driver as pool_driver
from vastflow.flows.pool.driver import Driver
from vastflow.flows.pool.service import Seen
from vastflow.flows.request.work_pool import WorkersFailed, WorkPool, shard_count
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.engine.engine import Engine, RunFault
from vastflow.tasks.engine.index import ConfigurationRuns, Index
from vastflow.tasks.engine.pool import Pool, PoolClosed
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.engine.remote_shard import Report, ReportPart, read_part, write_part
from vastflow.tasks.engine.work import RECORDINGS, TRACES, VERDICTS
from vastflow.tasks.execution.deployment import OTHER_CODE, STORE_AWAY
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.store import Store, StoreError, open_store

KEYS = Keys("numeric", "a", "b", "c", 0, [])
RUNS = 2
FINISHED = Seen("ended", "Completed", "", "")


def configuration(k):
    return ConfigurationRuns(f"hall-{k}", "hall", k, Scenario("builtin:navigate_to_pose", 1.0, {}, {"k": k}, {}), RUNS)


def compute(store, each, start=0, stop=RUNS):
    """What a worker leaves in the store of a configuration."""
    index = Index(store, KEYS)
    home = KEYS.recordings(each.checked)
    info = {"runs": [[run, 2.0] for run in range(start, stop)]}
    recorded = store.put(f"{home}/{start}-{stop}", {RECORDINGS: f"{each.name} {start}-{stop}".encode()}, info)
    block = index.block(each, start, stop, recorded.content)
    trace = store.put(index.trace_key(each, block), {TRACES: b"trace"})
    said = {"runs": [[run, "pass"] for run in range(start, stop)]}
    store.put(index.verdicts_key(each, block, trace.content), {VERDICTS: b"[]"}, said)


class Workers:
    """Workers that do with a shard what `act` says: it is given its configurations and gives the state that it ends in."""

    numbers = itertools.count()

    def __init__(self, store, act, online=1):
        self.store, self.act, self.online = store, act, online
        self.bundles, self.tried, self.ended, self.cancelled, self.given_up = {}, [], {}, [], []

    def packed(self, configurations):
        key = f"bundle/{next(self.numbers)}"
        self.bundles[key] = tuple(configurations)
        return key

    def submit(self, bundle, name):
        flow_run = f"run-{next(self.numbers)}"
        configurations = self.bundles[bundle]
        self.tried.append((name, [each.name for each in configurations]))
        self.ended[flow_run] = self.act(self, flow_run, configurations)
        return flow_run

    def seen(self, ids):
        return {each: self.ended[each] for each in ids}

    def cancel(self, ids):
        self.cancelled += ids

    def give_up(self, flow_run, why):
        self.given_up.append((flow_run, why))

    def workers_online(self):
        return self.online


def done(workers, flow_run, configurations):
    for each in configurations:
        compute(workers.store, each)
    return Seen("ended", "Completed", "", "")


def dies_of(poison):
    """Computes in order until it meets the poison."""

    def act(workers, flow_run, configurations):
        for each in configurations:
            if each.name in poison:
                return Seen("ended", "Crashed", "exited with status -9", "")
            compute(workers.store, each)
        return Seen("ended", "Completed", "", "")

    return act


@pytest.fixture
def drive(tmp_path):
    """Drives configurations over workers; gives the tally, the faults, what was said, and the workers."""
    store = open_store(tmp_path / "store")
    pools = []

    def run(act, configurations, pool=WorkPool("lab", shards=1), online=1, **times):  # noqa: B008
        pools.append(Pool(1))
        tally = Tally()
        tally.expect({each.name: RUNS for each in configurations})
        engine = Engine(Index(store, KEYS), pools[-1], tally, b"")
        workers, said = Workers(store, act, online), []
        workers.tally = tally
        driver = Driver(
            workers, workers.packed, engine, tally, pool, said.append, **{"poll_s": 0.0, "silent_s": 9.0, **times}
        )
        workers.pool, workers.said = pools[-1], said
        error = None
        try:
            driver.run(configurations)
        except Exception as raised:  # noqa: BLE001
            error = raised
        return tally.progress(), engine.faults, workers, error

    yield run
    for pool in pools:
        pool.close()


@pytest.fixture
def configurations():
    return [configuration(k) for k in range(1, 9)]


def test_configurations_are_counted_as_executed_and_judged(drive, configurations):
    progress, faults, workers, error = drive(done, configurations)
    assert (progress.executed, progress.passed, progress.simulated_s, faults, error) == (16, 16, 32.0, (), None)
    assert sum(len(names) for _, names in workers.tried) == 8


def test_what_the_store_has_is_not_asked_for(drive, configurations):
    drive(done, configurations[:7])
    progress, _, workers, _ = drive(done, configurations)
    assert [names for _, names in workers.tried] == [["hall-8"]]
    assert progress.executed == RUNS


def test_configurations_that_want_more_runs_go_to_the_workers_again_for_these_alone(tmp_path, configurations):
    store = open_store(tmp_path / "store")
    tally, pool = Tally(), Pool(1)
    tally.expect({each.name: RUNS for each in configurations})
    engine = Engine(Index(store, KEYS), pool, tally, b"")
    workers, shown = Workers(store, done), []
    driver = Driver(workers, workers.packed, engine, tally, WorkPool("lab", shards=1), print, poll_s=0.0)
    compute(store, configurations[0], 2, 4)  # of an earlier campaign: the first two runs of it are missing
    try:
        for each in configurations:
            tally.want(each.name, RUNS, 5)
        driver.run(configurations, lambda *shards: shown.append(shards))
        more = [replace(each, runs=5) for each in configurations[:3]]
        for each in configurations:
            tally.want(each.name, 5 if each in configurations[:3] else RUNS, 5 if each in configurations[:3] else RUNS)
        tally.reuse("hall-1", range(2, 4))
        workers.act = lambda workers, flow_run, some: [compute(store, each, RUNS, 5) for each in some] and FINISHED
        driver.run(more, lambda *shards: shown.append(shards))
    finally:
        pool.close()
    progress = tally.progress()
    assert [names for _, names in workers.tried] == [
        [each.name for each in configurations],
        ["hall-1", "hall-2", "hall-3"],
    ]
    assert (progress.runs_done, progress.runs_total, progress.at_most) == (16 + 9, 16 + 9, False)
    assert (progress.executed, progress.reused) == (16 + 9 - 2, 2)
    assert shown[-1] == (2, 2)


def test_shard_is_called_by_its_places(drive, configurations):
    _, _, workers, _ = drive(done, configurations, WorkPool("lab"))
    assert [name for name, _ in workers.tried] == ["1–8 of hall"]


def test_shard_that_fails_once_is_given_to_another_worker_with_what_is_missing(drive, configurations):
    failures = iter([True])

    def act(workers, flow_run, some):
        if next(failures, False):
            compute(workers.store, some[0])
            return Seen("ended", "Failed", "its disk was full", "")
        return done(workers, flow_run, some)

    progress, faults, workers, _ = drive(act, configurations[:3])
    assert [names for _, names in workers.tried] == [["hall-1", "hall-2", "hall-3"], ["hall-2", "hall-3"]]
    assert workers.tried[1][0] == "2–3 of hall, try 2"
    assert workers.said == ["1–3 of hall will be tried again: Failed: its disk was full"]
    assert (progress.passed, faults) == (6, ())


def test_configuration_that_kills_its_worker_ends_alone_and_the_others_are_computed(drive, configurations):
    progress, faults, workers, error = drive(dies_of({"hall-4"}), configurations)
    assert error is None
    assert [(fault.configuration, fault.run_index, fault.stage) for fault in faults] == [("hall-4", None, "execute")]
    assert "at last with it alone; Crashed: exited with status -9" in faults[0].error
    assert (progress.passed, progress.not_judged) == (14, 2)
    assert workers.tried[-1][1] == ["hall-4"] or ["hall-4"] in [names for _, names in workers.tried]
    tried = Counter(name for _, names in workers.tried for name in names)
    assert tried["hall-4"] <= 3 + 3  # three whole, then halves


def test_two_poisons_are_both_found(drive, configurations):
    progress, faults, _, _ = drive(dies_of({"hall-2", "hall-7"}), configurations)
    assert {fault.configuration for fault in faults} == {"hall-2", "hall-7"}
    assert (progress.passed, progress.not_judged) == (12, 4)


def test_poison_in_every_shard_is_found(drive):
    many = [configuration(k) for k in range(1, 33)]
    progress, faults, _, error = drive(dies_of({"hall-1", "hall-12", "hall-20", "hall-32"}), many, WorkPool("lab", 4))
    assert error is None
    assert {fault.configuration for fault in faults} == {"hall-1", "hall-12", "hall-20", "hall-32"}
    assert progress.passed == 2 * 28


def test_workers_that_fail_whatever_they_are_given_end_the_campaign_before_every_configuration_was_tried(drive):
    crashed = Seen("ended", "Crashed", "the image can't be pulled", "")
    _, _, workers, error = drive(lambda *_: crashed, [configuration(k) for k in range(1, 65)])
    assert isinstance(error, WorkersFailed)
    assert str(error) == (
        "workers of the work pool 'lab' fail whatever they are given, at last with Crashed: the image can't be pulled"
    )
    assert len(workers.tried) < 16


def test_fault_that_the_worker_reports_is_the_configurations_and_nothing_is_tried_again(drive, configurations):
    def act(workers, flow_run, some):
        for each in some[1:]:
            compute(workers.store, each)
        fault = RunFault(some[0].name, 1, "judge", "KeyError: 'x'")
        write_part(workers.store, flow_run, 0, ReportPart((), (fault,), last=True))
        return Seen("ended", "Completed", "", "")

    _, faults, workers, _ = drive(act, configurations)
    assert faults == (RunFault("hall-1", 1, "judge", "KeyError: 'x'"),)
    assert len(workers.tried) == 1


def test_configuration_whose_fault_was_forgotten_and_that_breaks_again_has_a_fault_again(tmp_path, configurations):
    store, tally, pool = open_store(tmp_path / "store"), Tally(), Pool(1)
    tally.expect({"hall-1": RUNS})
    engine = Engine(Index(store, KEYS), pool, tally, b"")
    workers = Workers(store, dies_of({"hall-1"}))
    driver = Driver(workers, workers.packed, engine, tally, WorkPool("lab"), lambda line: None, poll_s=0.0)
    try:
        driver.run(configurations[:1])
        assert engine.broken == {"hall-1"}
        engine.forget(engine.broken)
        driver.run(configurations[:1])
    finally:
        pool.close()
    assert engine.broken == {"hall-1"}


def test_flow_run_without_a_sign_of_life_is_given_up_and_its_shard_tried_again(drive, configurations):
    silent = iter([True])

    def act(workers, flow_run, some):
        return Seen("running", "Running", "", "") if next(silent, False) else done(workers, flow_run, some)

    progress, faults, workers, _ = drive(act, configurations, silent_s=0.05, poll_s=0.01)
    assert [why for _, why in workers.given_up] == ["no sign of life for 0 s: its worker is gone"]
    assert (progress.passed, faults) == (16, ())


def test_signs_of_life_keep_a_slow_shard(drive, configurations):
    beats = itertools.count()

    class Slow(Workers):
        pass

    def act(workers, flow_run, some):
        beat = next(beats)
        if beat == 0:
            workers.seen = lambda ids: {
                each: Seen("running", "Running", "", str(next(beats)))
                if next(beats) < 60
                else done(workers, flow_run, some)
                for each in ids
            }
        return Seen("running", "Running", "", "")

    progress, _, workers, _ = drive(act, configurations, silent_s=0.2, poll_s=0.02)
    assert (workers.given_up, progress.passed) == ([], 16)


def test_cancelled_shard_is_not_judged_and_the_others_are(drive, configurations):
    def act(workers, flow_run, some):
        if some[0].name == "hall-1":
            return Seen("ended", "Cancelled", "", "")
        return done(workers, flow_run, some)

    many = [configuration(k) for k in range(1, 61)]
    progress, faults, _, _ = drive(act, many, WorkPool("lab", shards=6))
    assert {fault.error for fault in faults} == {"its flow run was cancelled"}
    assert progress.not_judged == RUNS * len(faults) > 0
    assert progress.passed == RUNS * (60 - len(faults)) > 0


def test_workers_with_other_code_end_the_campaign_after_three_tries(drive, configurations):
    what = "farm7 differs in the numeric class; give all workers the campaign's own version of vastflow"
    _, _, workers, error = drive(lambda *_: Seen("ended", OTHER_CODE, what, ""), configurations)
    assert isinstance(error, WorkersFailed)
    assert str(error) == f"workers of the work pool 'lab': {what}"
    assert len(workers.tried) == 3


def test_workers_that_do_not_reach_the_store_are_a_fault_of_the_store(drive, configurations):
    _, _, _, error = drive(
        lambda *_: Seen("ended", STORE_AWAY, "farm7 finds no bundle in the store '/x'", ""), configurations
    )
    assert isinstance(error, StoreError)
    assert str(error).startswith("store: a worker of the work pool 'lab' can't use it: farm7 finds no bundle")


def test_nothing_taken_is_said_once_with_the_command_that_starts_a_worker(drive, configurations):
    looks = itertools.count()

    def act(workers, flow_run, some):
        ended = []

        def seen(ids):
            if next(looks) < 20:
                return {each: Seen("waiting", "Scheduled", "", "") for each in ids}
            ended.append(done(workers, flow_run, some))
            return {each: ended[-1] for each in ids}

        workers.seen = seen
        return Seen("waiting", "Scheduled", "", "")

    _, _, workers, error = drive(act, configurations, online=0, idle_s=0.05, poll_s=0.01)
    assert error is None
    assert workers.said == ["no worker of the work pool 'lab' is there; start one: prefect worker start --pool lab"]


def test_workers_that_are_there_and_take_nothing_are_counted(drive, configurations):
    pool = WorkPool("lab", wait_s=0.2)
    waiting = Seen("waiting", "Scheduled", "", "")
    _, _, workers, error = drive(lambda *_: waiting, configurations, pool, online=2, idle_s=0.05, poll_s=0.01)
    assert workers.said == ["2 workers of the work pool 'lab' took nothing for 0 s; still waiting"]
    assert isinstance(error, WorkersFailed)
    assert str(error).startswith("no worker of the work pool 'lab' took anything for ")
    assert sorted(workers.cancelled) == sorted(workers.ended)


def test_ended_campaign_cancels_what_is_on_its_way(drive, configurations):
    def act(workers, flow_run, some):
        threading.Timer(0.05, workers.pool.close).start()
        return Seen("running", "Running", "", "")

    _, _, workers, error = drive(act, configurations, poll_s=0.02)
    assert isinstance(error, PoolClosed)
    assert workers.cancelled == list(workers.ended)


def test_flow_run_that_somebody_deleted_is_tried_again(drive, configurations):
    deleted = iter([True])

    def act(workers, flow_run, some):
        if next(deleted, False):
            workers.seen = lambda ids: {each: workers.ended[each] for each in ids if each != flow_run}
            return Seen("running", "Running", "", "")
        return done(workers, flow_run, some)

    progress, _, workers, _ = drive(act, configurations)
    assert (progress.passed, len(workers.tried)) == (16, 2)


@each_row(
    ("configurations", "runs", "most", "count"),
    [
        (1, 5, None, 1),
        (24, 120, None, 6),
        (5480, 109600, None, 50),
        (30, 6000, None, 30),
        (4, 0, None, 1),
        (24, 120, 3, 3),
        (24, 120, 24, 24),
        (24, 120, 99, 24),
    ],
)
def test_there_are_as_many_shards_as_the_work_is_worth(configurations, runs, most, count):
    assert shard_count(WorkPool("lab", shards=most), configurations, runs) == count


def test_pool_has_a_name_and_at_least_one_shard():
    with pytest.raises(UserError, match="--pool: expected the name of a work pool"):
        WorkPool("")
    with pytest.raises(UserError, match="--shards: expected 1 or more, got 0"):
        WorkPool("lab", shards=0)


def test_report_tells_each_configuration_once_and_its_end(tmp_path, configurations):
    store = open_store(tmp_path / "store")
    pool = Pool(1)
    engine = Engine(Index(store, KEYS), pool, Tally(), b"")
    compute(store, configurations[0])
    fault = RunFault("hall-2", None, "execute", "ValueError: ×")
    engine.add_faults([fault])
    report = Report(engine, "an-id")
    report.add(configurations[:1])
    report.add(configurations[:1])
    report.add(configurations[:2], last=True)
    pool.close()
    parts = [read_part(store, "an-id", number) for number in range(3)]
    assert [[each.key for each in part.artifacts] for part in parts[:2]] == [
        [
            artifact.key
            for each in engine.index.stored(configurations[0])
            for artifact in (each.recordings, each.trace, each.verdicts)
        ],
        [],
    ]
    assert [(part.faults, part.last) for part in parts[:2]] == [((), False), ((fault,), True)]
    assert parts[2] is None


def test_what_a_flow_run_told_to_its_end_is_believed_and_the_store_is_not_listed(drive, configurations, monkeypatch):
    refreshes = []
    monkeypatch.setattr(Store, "refresh", lambda store: refreshes.append(1))

    def act(workers, flow_run, some):
        for each in some:
            compute(workers.store, each)
        write_part(workers.store, flow_run, 0, ReportPart((), (), last=True))
        return FINISHED

    progress, _, _, _ = drive(act, configurations)
    assert (progress.passed, refreshes) == (16, [])
    drive(done, [configuration(9)])  # one that told nothing
    assert refreshes == [1]


def test_configurations_are_counted_while_their_shard_is_under_way(drive, configurations, monkeypatch):
    monkeypatch.setattr(pool_driver, "LISTEN_S", 0.0)
    beats, passed = itertools.count(), []

    def act(workers, flow_run, some):
        def seen(ids):
            beat = next(beats)
            passed.append(workers.tally.progress().passed)
            if beat < len(some):
                compute(workers.store, some[beat])
                write_part(workers.store, flow_run, beat, ReportPart(()))
                return {each: Seen("running", "Running", "", str(beat)) for each in ids}
            return dict.fromkeys(ids, FINISHED)

        workers.seen = seen
        return Seen("running", "Running", "", "")

    drive(act, configurations[:3])
    assert passed == [0, 2, 4, 6]


def test_flow_run_that_was_taken_and_never_begun_is_given_up_only_where_nothing_queues(drive, configurations):
    taken = iter([True])

    def act(workers, flow_run, some):
        return Seen("taken", "Pending", "", "") if next(taken, False) else done(workers, flow_run, some)

    progress, _, workers, _ = drive(act, configurations, taken_s=0.05, poll_s=0.01)
    assert (len(workers.given_up), progress.passed) == (1, 16)
    pending = Seen("taken", "Pending", "", "")

    def wait(workers, flow_run, some):
        threading.Timer(0.3, workers.pool.close).start()
        return pending

    _, _, workers, error = drive(wait, [configuration(99)], poll_s=0.01)
    assert isinstance(error, PoolClosed)
    assert workers.given_up == []
