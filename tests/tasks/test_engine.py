from dataclasses import replace
from types import SimpleNamespace

import pytest
from at_once import AtOnce

from vastflow.oracles.judgment.registry import oracles_of
from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.engine import units, work
from vastflow.tasks.engine.engine import Engine, RunFault
from vastflow.tasks.engine.executor import ClusterError, PoolClosed, WorkerDied
from vastflow.tasks.engine.index import ConfigurationRuns, Index
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.engine.shards import Shard
from vastflow.tasks.engine.work import Broken, Executed
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.store import StoreError, open_store


def configuration(name, runs=2):
    return ConfigurationRuns(name, "room", 1, Scenario("builtin:navigate_to_pose", 60.0, {}, {"name": name}, {}), runs)


class Pool(AtOnce):
    """Has stand-ins for the stages; `answers` says what becomes of a configuration."""

    def __init__(self):
        self.done = []
        self.answers = {}

    def called(self, function, stage, *arguments):
        assert function is work.answered
        scenario = next((each for each in arguments if isinstance(each, Scenario)), None)
        name = scenario.task["name"] if scenario else ""
        self.done.append((stage.__name__, name))
        answer = self.answers.get((stage.__name__, name))
        if callable(answer):
            answer = answer(*arguments)
        if isinstance(answer, Exception):
            raise answer
        if answer is not None:
            return None if answer == "lost" else answer
        store = arguments[0] if arguments else None
        if stage is work.execute:
            _, home, _, start, stop, _ = arguments
            facts = {"runs": [[run, 10.0] for run in range(start, stop)]}
            store.put(f"{home}/{start}-{stop}", {"recordings.parquet": f"{name} {start} {stop}".encode()}, facts)
            return Executed({run: 10.0 for run in range(start, stop)}, {})
        if stage is work.observe:
            store.put(arguments[2], {"traces.parquet": b"trace"})
        if stage is work.judge:
            store.put(arguments[3], {"verdicts.json": b"[]"}, {"runs": [[0, "pass"], [1, "fail"]], "causes": []})
        return None


@pytest.fixture
def pool():
    return Pool()


@pytest.fixture
def engine_of(tmp_path, pool, monkeypatch):
    monkeypatch.setattr(units, "_UNITS_A_WORKER", 1)
    index = Index(open_store(tmp_path), Keys("numeric", "e", "o", "j", 0, []))
    tally = Tally()
    tally.expect({"a": 2, "b": 2})

    def engine_of(**options):
        made = Engine(index, pool, tally, oracles_of([]), **options)
        made.tally = tally
        return made

    return engine_of


@pytest.fixture
def engine(engine_of):
    return engine_of()


def through(engine, configurations):
    """Outcomes of the three stages."""
    recorded = engine.execute(configurations)
    observed = engine.observe(configurations, recorded.made)
    return recorded, observed, engine.judge(configurations, observed.made)


def there(outcomes):
    return [(outcome.there, outcome.wanted) for outcome in outcomes]


def test_stages_compute_each_configuration_once(engine, pool):
    configurations = [configuration("a"), configuration("b")]
    outcomes = through(engine, configurations)
    assert there(outcomes) == [(0, 2), (0, 2), (0, 2)]
    assert [len(rows) for rows in outcomes[-1].made] == [1, 1]
    assert sorted(pool.done) == [(stage, name) for stage in ("execute", "judge", "observe") for name in "ab"]
    progress = engine.tally.progress()
    assert (progress.executed, progress.passed, progress.failed) == (4, 2, 2)


def test_stored_artifacts_are_not_computed(engine, pool):
    through(engine, [configuration("a")])
    pool.done.clear()
    engine._executing.clear()
    assert there(through(engine, [configuration("a"), configuration("b")])) == [(1, 2), (1, 2), (1, 2)]
    assert sorted(pool.done) == [("execute", "b"), ("judge", "b"), ("observe", "b")]


def test_early_configuration_starts_once(engine, pool):
    engine.start([configuration("a")])
    engine.execute([configuration("a")])
    assert pool.done == [("execute", "a")]


def test_kernels_are_compiled_before_anything_executes(engine, pool):
    engine.warm_up([{}])
    engine.execute([configuration("a")])
    assert pool.done == [("compile_kernels", ""), ("execute", "a")]


def test_kernels_are_compiled_only_for_robots(engine, pool):
    engine.warm_up([])
    engine.execute([configuration("a")])
    assert pool.done == [("execute", "a")]


@pytest.mark.parametrize("stage", ["execute", "observe", "judge"])
@pytest.mark.parametrize("error", [Broken("ValueError: x"), WorkerDied("died"), RuntimeError("can't be pickled")])
def test_error_affects_only_its_configuration(engine, pool, stage, error):
    pool.answers[stage, "a"] = error
    assert [len(rows) for rows in through(engine, [configuration("a"), configuration("b")])[-1].made] == [0, 1]
    assert {(fault.configuration, fault.run_index, fault.stage) for fault in engine.faults} == {
        ("a", 0, stage),
        ("a", 1, stage),
    }
    assert engine.tally.progress().not_judged == 2


def test_worker_killing_run_affects_no_other_run(engine, pool):
    pool.answers["execute", "a"] = lambda *arguments: WorkerDied("died") if arguments[3] <= 1 < arguments[4] else None
    recorded = engine.execute([configuration("a", runs=2)])
    assert [row[:2] for row in recorded.made[0]] == [[0, 1]]
    assert engine.faults == (RunFault("a", 1, "execute", "died"),)


def test_broken_run_is_one_fault(engine, pool):
    pool.answers["execute", "a"] = Executed({0: 1.0}, {1: Broken("ValueError: x")})
    engine.execute([configuration("a")])
    assert engine.faults == (RunFault("a", 1, "execute", "ValueError: x"),)


def test_lost_artifact_is_missing_and_not_a_fault(engine, pool):
    pool.answers["observe", "a"] = "lost"
    assert [outcome.made == [[]] for outcome in through(engine, [configuration("a")])] == [False, True, True]
    assert engine.faults == ()


def test_closed_pool_ends_the_stage(engine, pool):
    pool.answers["execute", "a"] = PoolClosed()
    with pytest.raises(PoolClosed):
        engine.execute([configuration("a")])


@pytest.mark.parametrize("kind", [StoreError, ClusterError])
def test_unusable_store_or_cluster_ends_everything_without_fault(engine, pool, kind):
    pool.answers["observe", "a"] = kind("store: the disk is full")
    pool.close = lambda: pool.done.append("closed")
    configurations = [configuration("a"), configuration("b")]
    recorded = engine.execute(configurations)
    with pytest.raises(kind, match="the disk is full"):
        engine.observe(configurations, recorded.made)
    assert str(engine.ended_by) == "store: the disk is full"
    assert pool.done[-1] == "closed"
    assert engine.faults == ()


def test_interrupted_task_run_ends_as_cancelled():
    from vastflow.tasks.prefect import stages

    def execute(configurations):
        raise PoolClosed

    state = stages.execute.fn(Shard([]), SimpleNamespace(execute=execute))
    assert (state.name, state.message) == ("Cancelled", "the campaign was ended before this was computed")


def recorded(store, keys, checked, scenario, start, stop, oracles):
    """Execute a whole unit without observing or judging it."""
    facts = {"runs": [[run, 10.0] for run in range(start, stop)]}
    home = keys.recordings(checked)
    made = store.put(f"{home}/{start}-{stop}", {"recordings.parquet": b"recordings"}, facts)
    return Executed({run: 10.0 for run in range(start, stop)}, {}, 1.0, (made,))


def judged(store, keys, checked, *arguments):
    """Execute, observe, and judge a whole unit."""
    executed = recorded(store, keys, checked, *arguments)
    (recording,) = executed.artifacts
    trace = store.put(keys.trace(checked, recording.content), {"traces.parquet": b"trace"})
    info = {"runs": [[0, "pass"], [1, "fail"]], "causes": []}
    verdicts = store.put(keys.verdicts(checked, recording.content, trace.content), {"verdicts.json": b"[]"}, info)
    return replace(executed, artifacts=(recording, trace, verdicts))


def test_whole_unit_is_judged_before_the_other_stages_begin(engine_of, pool):
    pool.answers["compute", "a"], engine = judged, engine_of(whole_units=True)
    executed = engine.execute([configuration("a")])
    assert (engine.tally.progress().passed, engine.tally.progress().failed) == (1, 1)
    observed = engine.observe([configuration("a")], executed.made)
    outcomes = executed, observed, engine.judge([configuration("a")], observed.made)
    assert pool.done == [("compute", "a")]
    assert there(outcomes) == [(0, 1), (0, 1), (0, 1)], "it was made now"
    assert (engine.tally.progress().passed, engine.tally.progress().failed) == (1, 1)


def test_stage_that_broke_in_a_whole_unit_is_named_once(engine_of, pool):
    pool.answers.update({("compute", "a"): recorded, ("judge", "a"): Broken("ValueError: x")})
    engine = engine_of(whole_units=True)
    through(engine, [configuration("a")])
    assert pool.done == [("compute", "a"), ("observe", "a"), ("judge", "a")]
    assert engine.faults == tuple(RunFault("a", run, "judge", "ValueError: x") for run in (0, 1))


def test_runs_whose_oracle_killed_the_worker_are_not_executed_again(engine_of, pool):
    def compute(*arguments):
        recorded(*arguments)
        return WorkerDied("died")

    pool.answers.update({("compute", "a"): compute, ("judge", "a"): WorkerDied("died")})
    engine = engine_of(whole_units=True)
    through(engine, [configuration("a")])
    assert pool.done == [("compute", "a"), ("observe", "a"), ("judge", "a")]
    assert engine.faults == tuple(RunFault("a", run, "judge", "died") for run in (0, 1))
