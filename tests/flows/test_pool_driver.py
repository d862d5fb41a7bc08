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
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.prefect.deployment import OTHER_CODE, STORE_AWAY
from vastflow.tasks.store.store import Store, StoreError, open_store

KEYS = Keys("numeric", "a", "b", "c", 0, [])
RUNS = 2
FINISHED = Seen("ended", "Completed", "", "")


def configuration(k):
    return ConfigurationRuns(f"hall-{k}", "hall", k, Scenario("builtin:navigate_to_pose", 1.0, {}, {"k": k}, {}), RUNS)


def compute(store, each, start=0, stop=RUNS):
    """Write what a worker stores of a configuration."""
    index = Index(store, KEYS)
    home = KEYS.recordings(each.checked)
    info = {"runs": [[run, 2.0] for run in range(start, stop)]}
    recorded = store.put(f"{home}/{start}-{stop}", {RECORDINGS: f"{each.name} {start}-{stop}".encode()}, info)
    block = index.block(each, start, stop, recorded.content)
    trace = store.put(index.trace_key(each, block), {TRACES: b"trace"})
    said = {"runs": [[run, "pass"] for run in range(start, stop)]}
    store.put(index.verdicts_key(each, block, trace.content), {VERDICTS: b"[]"}, said)


class Workers:
    """Workers that call `act` with a shard's configurations and report the state that it returns."""

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


def once(state, first=lambda workers, flow_run, some: None):
    """The first shard comes to `state`, after `first`; every other is computed."""
    states = iter([state])

    def act(workers, flow_run, some):
        if (found := next(states, None)) is None:
            return done(workers, flow_run, some)
        first(workers, flow_run, some)
        return found

    return act


@pytest.fixture
def driver_of(tmp_path):
    """Makes a driver over workers, with its engine, tally and what it said."""
    store, pools = open_store(tmp_path / "store"), []

    def made(act, configurations, pool=WorkPool("lab", shards=1), online=1, **times):  # noqa: B008
        pools.append(Pool(1))
        tally = Tally()
        tally.expect({each.name: RUNS for each in configurations})
        workers = Workers(store, act, online)
        workers.tally, workers.pool, workers.said = tally, pools[-1], []
        engine = Engine(Index(store, KEYS), pools[-1], tally, ())
        times = {"poll_s": 0.0, "silent_s": 9.0, **times}
        return Driver(workers, workers.packed, engine, tally, pool, workers.said.append, **times), engine, workers

    yield made
    for pool in pools:
        pool.close()


@pytest.fixture
def drive(driver_of):
    """Drives configurations over workers; gives progress, faults, workers, and the error."""

    def run(act, configurations, *pool, **options):
        driver, engine, workers = driver_of(act, configurations, *pool, **options)
        error = None
        try:
            driver.run(configurations)
        except Exception as raised:  # noqa: BLE001
            error = raised
        return workers.tally.progress(), engine.faults, workers, error

    return run


@pytest.fixture
def configurations():
    return [configuration(k) for k in range(1, 9)]


def test_configurations_are_counted_as_executed_and_judged(drive, configurations):
    progress, faults, workers, error = drive(done, configurations[:7], WorkPool("lab"))
    assert (progress.executed, progress.passed, progress.simulated_s, faults, error) == (14, 14, 28.0, (), None)
    assert [name for name, _ in workers.tried] == ["1–7 of hall"]
    progress, _, workers, _ = drive(done, configurations)  # what the store has is not asked for
    assert [names for _, names in workers.tried] == [["hall-8"]] and progress.executed == RUNS


def test_configurations_that_want_more_runs_go_to_the_workers_again_for_these_alone(driver_of, configurations):
    driver, engine, workers = driver_of(done, configurations)
    store, tally, shown = engine.index.store, workers.tally, []
    compute(store, configurations[0], 2, 4)  # of an earlier campaign: the first two runs of it are missing
    for each in configurations:
        tally.want(each.name, RUNS, 5)
    driver.run(configurations, lambda *shards: shown.append(shards))
    for each in configurations:
        runs = 5 if each in configurations[:3] else RUNS
        tally.want(each.name, runs, runs)
    tally.reuse("hall-1", range(2, 4))
    workers.act = lambda workers, flow_run, some: [compute(store, each, RUNS, 5) for each in some] and FINISHED
    driver.run([replace(each, runs=5) for each in configurations[:3]], lambda *shards: shown.append(shards))
    progress, asked = tally.progress(), [names for _, names in workers.tried]
    assert asked == [[each.name for each in configurations], ["hall-1", "hall-2", "hall-3"]]
    assert (progress.runs_done, progress.runs_total, progress.at_most) == (16 + 9, 16 + 9, False)
    assert (progress.executed, progress.reused, shown[-1]) == (16 + 9 - 2, 2, (2, 2))


def test_shard_that_fails_once_is_given_to_another_worker_with_what_is_missing(drive, configurations):
    failed = Seen("ended", "Failed", "its disk was full", "")
    act = once(failed, lambda workers, flow_run, some: compute(workers.store, some[0]))
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


@each_row(
    ("poison", "count", "pool"),
    [
        ({"hall-2", "hall-7"}, 8, WorkPool("lab", shards=1)),
        ({"hall-1", "hall-12", "hall-20", "hall-32"}, 32, WorkPool("lab", shards=4)),
    ],
)
def test_poison_configurations_are_found(drive, poison, count, pool):
    many = [replace(configuration(k), name=f"hall-{k}", scenario=salted(k, count)) for k in range(1, count + 1)]
    progress, faults, _, error = drive(dies_of(poison), many, pool)
    assert error is None and {fault.configuration for fault in faults} == poison
    assert (progress.passed, progress.not_judged) == (RUNS * (count - len(poison)), RUNS * len(poison))


def salted(k, salt):
    """A scenario of its own for each row: all rows share a store."""
    return Scenario("builtin:navigate_to_pose", 1.0, {}, {"k": k, "salt": salt}, {})


OTHER = "farm7 differs in the numeric class; give all workers the campaign's own version of vastflow"
LACKING = "farm7 finds no bundle in the store '/x'"


@each_row(
    ("state", "message", "kind", "words", "tries"),
    [
        (
            "Crashed",
            "the image can't be pulled",
            WorkersFailed,
            "workers of the work pool 'lab' fail whatever they are given, at last with Crashed: the image can't be pulled",
            range(4, 16),
        ),
        (OTHER_CODE, OTHER, WorkersFailed, f"workers of the work pool 'lab': {OTHER}", [3]),
        (STORE_AWAY, LACKING, StoreError, f"store: a worker of the work pool 'lab' can't use it: {LACKING}", [3]),
    ],
)
def test_workers_that_compute_nothing_end_the_campaign(drive, state, message, kind, words, tries):
    seen = Seen("ended", state, message, "")
    _, _, workers, error = drive(lambda *_: seen, [configuration(k) for k in range(1, 65)])
    assert (type(error), str(error)) == (kind, words)
    assert len(workers.tried) in tries


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


def test_configuration_whose_fault_was_forgotten_and_that_breaks_again_has_a_fault_again(driver_of, configurations):
    driver, engine, _ = driver_of(dies_of({"hall-1"}), configurations[:1])
    driver.run(configurations[:1])
    assert engine.broken == {"hall-1"}
    engine.forget(engine.broken)
    driver.run(configurations[:1])
    assert engine.broken == {"hall-1"}


def test_silent_flow_run_is_given_up_and_its_shard_retried(drive, configurations):
    act = once(Seen("running", "Running", "", ""))
    progress, faults, workers, _ = drive(act, configurations, silent_s=0.05, poll_s=0.01)
    assert [why for _, why in workers.given_up] == ["no sign of life for 0 s: its worker is gone"]
    assert (progress.passed, faults) == (16, ())


def test_signs_of_life_keep_a_slow_shard(drive, configurations):
    beats = itertools.count()

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


def test_idle_pool_is_reported_once_with_the_command_for_a_worker(drive, configurations):
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
    def deleted(workers, flow_run, some):
        workers.seen = lambda ids: {each: workers.ended[each] for each in ids if each != flow_run}

    progress, _, workers, _ = drive(once(Seen("running", "Running", "", ""), deleted), configurations)
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
def test_shards_are_as_many_as_the_work_is_worth(configurations, runs, most, count):
    assert shard_count(WorkPool("lab", shards=most), configurations, runs) == count


def test_pool_has_a_name_and_at_least_one_shard():
    with pytest.raises(UserError, match="--pool: expected the name of a work pool"):
        WorkPool("")
    with pytest.raises(UserError, match="--shards: expected 1 or more, got 0"):
        WorkPool("lab", shards=0)


def test_report_tells_each_configuration_once_and_its_end(driver_of, configurations):
    _, engine, _ = driver_of(done, configurations)
    store, fault = engine.index.store, RunFault("hall-2", None, "execute", "ValueError: ×")
    compute(store, configurations[0])
    engine.add_faults([fault])
    report = Report(engine, "an-id")
    report.add(configurations[:1])
    report.add(configurations[:1])
    report.add(configurations[:2], last=True)
    first, last, none = (read_part(store, "an-id", number) for number in range(3))
    (each,) = engine.index.stored(configurations[0])
    assert [one.key for one in first.artifacts] == [one.key for one in (each.recordings, each.trace, each.verdicts)]
    assert (last.artifacts, last.faults, none) == ((), (fault,), None)
    assert [(part.faults, part.last) for part in (first, last)] == [((), False), ((fault,), True)]


def test_state_of_an_ended_flow_run_needs_no_listing_of_the_store(drive, configurations, monkeypatch):
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


def test_flow_run_that_never_began_is_given_up_unless_it_queues(drive, configurations):
    pending = Seen("taken", "Pending", "", "")
    act = once(pending)
    progress, _, workers, _ = drive(act, configurations, taken_s=0.05, poll_s=0.01)
    assert (len(workers.given_up), progress.passed) == (1, 16)

    def wait(workers, flow_run, some):
        threading.Timer(0.3, workers.pool.close).start()
        return pending

    _, _, workers, error = drive(wait, [configuration(99)], poll_s=0.01)
    assert isinstance(error, PoolClosed)
    assert workers.given_up == []
