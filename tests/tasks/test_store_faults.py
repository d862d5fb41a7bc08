"""Files of a small campaign damaged at random: each is noticed and healed, none is served.

`VASTFLOW_FAULTS` says how many; a few in the ordinary course of the tests.
"""

import os
import pickle
import random

import pytest
from at_once import AtOnce

from vastflow.oracles.judgment.registry import oracles_of
from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.engine import units
from vastflow.tasks.engine.engine import Engine, judgments
from vastflow.tasks.engine.index import ConfigurationRuns, Index, missing
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.engine.work import BEHAVIORS, RECORDINGS, RUN_LOG, TRACES, VERDICTS, Executed
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.store import Lost, Store, open_store

FAULTS = int(os.environ.get("VASTFLOW_FAULTS", "40"))
CONFIGURATIONS = [
    ConfigurationRuns(f"room-{k}", "room", k, Scenario("builtin:navigate_to_pose", 60.0, {}, {"k": k}, {}), runs=3)
    for k in range(1, 5)
]


class Pool(AtOnce):
    """Does the stages without a simulator, and counts them; another process's store is a copy."""

    def __init__(self):
        self.done = 0

    def called(self, function, stage, store, *arguments):
        self.done += 1
        return function(getattr(self, stage.__name__), pickle.loads(pickle.dumps(store)), *arguments)

    def execute(self, store, home, scenario, start, stop, seed):
        recorded = f"recorded {scenario.digest} {start} {stop}".encode() * 20
        files = {RECORDINGS: recorded, BEHAVIORS: b"behaviors" * 9}
        store.put(f"{home}/{start}-{stop}", files, {"runs": [[k, 10.0] for k in range(start, stop)]}, {RUN_LOG: b"{}"})
        return Executed({run: 10.0 for run in range(start, stop)}, {})

    def observe(self, store, recording_key, key, scenario):
        store.put(key, {TRACES: b"trace of " + store.read(recording_key, RECORDINGS)})

    def judge(self, store, recording_key, trace_key, key, *_):
        judged = store.read(recording_key, RECORDINGS) + store.read(trace_key, TRACES)
        store.put(key, {VERDICTS: b"verdicts on " + judged}, {"runs": [[k, "pass"] for k in range(3)], "causes": []})


def campaign(store):
    """Complete and read a campaign as a session does; return all files and the number of jobs."""
    pool = Pool()
    index = Index(store, Keys("numeric", "e", "o", "j", 0, []))
    for _ in range(4):
        store.refresh()
        shop = Engine(index, pool, Tally(), oracles_of([]))
        recorded = shop.execute(CONFIGURATIONS).made
        observed = shop.observe(CONFIGURATIONS, recorded).made
        shop.judge(CONFIGURATIONS, observed)
        assert shop.faults == ()
        try:
            return {configuration.name: files_of(index, configuration) for configuration in CONFIGURATIONS}, pool.done
        except Lost:
            continue
    raise AssertionError("lost again and again")


def files_of(index, configuration):
    stored = index.stored(configuration)
    if missing([each.block for each in stored], configuration.runs):
        raise Lost(configuration.name)
    load, found = index.store.load, []
    for each in stored:
        if each.trace is None or each.verdicts is None:
            raise Lost(configuration.name)
        found += [load(each.recordings, RECORDINGS), load(each.recordings, BEHAVIORS)]
        found += [load(each.trace, TRACES), load(each.verdicts, VERDICTS), judgments(each.verdicts)]
    return found


def damage(files, rng):
    """Spoil a file that something depends on, at random; gives words for it."""
    path = rng.choice([path for path in files.paths() if not path.endswith(RUN_LOG)])
    content = files.read(path)
    kind = rng.choice(["change", "truncate", "delete"])
    at = rng.randrange(len(content))
    if kind == "change":
        files.write(path, content[:at] + bytes([content[at] ^ rng.randrange(1, 256)]) + content[at + 1 :])
    elif kind == "truncate":
        files.write(path, content[:at])
    else:
        files.delete(path)
    return f"{kind} {path} at {at} of {len(content)}"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["folder", "memory", "s3"])
def test_random_damage_is_noticed_and_healed(kind, request, tmp_path, raw, monkeypatch):
    monkeypatch.setattr(units, "_UNITS_A_WORKER", 1)
    if kind == "folder":
        store = open_store(tmp_path / "store")
    else:
        address = request.getfixturevalue(kind)
        store = Store(address) if kind == "memory" else open_store(address)
    whole, jobs = campaign(store)
    assert jobs == 3 * len(CONFIGURATIONS)
    assert campaign(store) == (whole, 0)
    rng = random.Random(7)
    for number in range(FAULTS if kind != "s3" else FAULTS // 4):
        what = f"fault {number}: {damage(raw(store), rng)}"
        found, jobs = campaign(store)
        assert found == whole, what
        assert 1 <= jobs <= 3, what
        assert [store.fault(each.key) for each in store.holdings()] == [None] * 3 * len(CONFIGURATIONS), what
