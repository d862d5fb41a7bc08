"""Rows of configurations: made from artifacts once, and kept by all that they follow from."""

import dataclasses
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vastflow.flows.results.rows import KeptRows, StoredResult, copies_in, parts, rows_of
from vastflow.oracles.judgment.verdict import Verdict, write_verdicts
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.archive import write_behaviors
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.recording import Recording, Run
from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.store.artifact import Block, Stored
from vastflow.tasks.store.store import open_store

ORACLES = ["success"]


def configuration(number):
    scenario = Scenario("builtin:navigate_to_pose", 1.0, {}, {}, {"number": number})
    return Configuration(f"room-{number}", "room", scenario, {}, {}, ())


@pytest.fixture
def store(tmp_path):
    return open_store(tmp_path / "store")


@pytest.fixture
def result(store):
    """Makes stored results of two runs that end as told."""

    def make(judgment="fail", faults=(), causes=((1, "planner"),), **more):
        runs = [Recording(Run(k, str(k), "succeeded", 0, "", 1.5, 2.0, 0, 0), {}) for k in range(2)]
        behaviors = write_behaviors({k: {"t_s": np.array([0.5 * k])} for k in range(2)})
        files = {"recordings.parquet": write_recordings(runs), "behaviors.arrow": behaviors}
        recordings = store.put(
            "execute/aa/a/0-2", files, {"runs": [[0, 1.0], [1, 1.0]]}, sidecar={"runlog.json": b'{"runs": []}'}
        )
        verdicts = write_verdicts([Verdict("success", k, judgment) for k in range(2)])
        judged = store.put(f"judge/aa/{judgment}", {"verdicts.json": verdicts}, {"runs": [], "causes": causes})
        block = Block(recordings.key, 0, 2, recordings.content)
        return StoredResult(store, [Stored(block, recordings, None, judged)], 2, faults, **more)

    return make


def same(one, other):
    names = [field.name for field in dataclasses.fields(one)]
    return all(getattr(one, name) == getattr(other, name) for name in names if name != "faults")


def test_kept_rows_are_those_that_were_made(store, result):
    kept, own = KeptRows(store, ORACLES), configuration(1)
    made = rows_of([(own, result())], {own.name: 2}, ORACLES)
    assert made.counted == Counter({("success", "fail"): 2, (None, "fail"): 2})
    assert made.runs["cause"].to_pylist() == [None, "planner"]
    assert made.behaviors.num_rows == 2 and made.logs.startswith(b'{"configuration": "room-1"')
    key = kept.key([(own, result(), 2)])
    assert kept.find(key) is None
    kept.put(key, made)
    assert same(kept.find(key), made)


def test_key_follows_from_names_runs_verdicts_and_oracles(store, result):
    kept, one, other = KeptRows(store, ORACLES), configuration(1), configuration(2)
    keys = {
        kept.key([(one, result(), 2)]),
        kept.key([(other, result(), 2)]),
        kept.key([(one, result(), 1)]),
        kept.key([(one, result("pass"), 2)]),
        kept.key([(one, result(), 2), (other, result(), 2)]),
        KeptRows(store, [*ORACLES, "safety"]).key([(one, result(), 2)]),
    }
    assert len(keys) == 6 and None not in keys
    assert kept.key([(one, result(), 2)]) in keys


def test_part_with_a_fault_has_no_key(store, result):
    broken = result(faults=[RunFault("room-1", None, "judge", "MemoryError")])
    assert KeptRows(store, ORACLES).key([(configuration(1), result(), 2), (configuration(2), broken, 2)]) is None


def test_equal_rows_are_equal_artifacts_whenever_runs_took_place(store, result):
    kept, own = KeptRows(store, ORACLES), configuration(1)
    made = rows_of([(own, result())], {own.name: 2}, ORACLES)
    for key, logs in (("rows/aa/a", b'{"wall_s": 1}\n'), ("rows/aa/b", b'{"wall_s": 2}\n')):
        kept.put(key, dataclasses.replace(made, logs=logs))
        assert kept.find(key).logs == logs
    assert store.find("rows/aa/a").content == store.find("rows/aa/b").content


@pytest.mark.parametrize("name", ["runs.arrow", "logs.jsonl"])
def test_damaged_rows_are_gone(store, result, name):
    kept, own = KeptRows(store, ORACLES), configuration(1)
    key = kept.key([(own, result(), 2)])
    kept.put(key, rows_of([(own, result())], {own.name: 2}, ORACLES))
    file = store.local / key / name
    file.write_bytes(file.read_bytes()[:-1] + b"?")
    assert kept.find(key) is None


def test_copy_is_read_only_where_its_content_is_the_same(store, result, tmp_path, monkeypatch):
    (content,) = result().recordings
    copies = copies_in(tmp_path, "room-1")
    file = copies["recordings.parquet"]
    file.parent.mkdir()
    file.write_bytes(content[:-1] + b"?")
    assert result(copies=copies).recordings == [content]
    file.write_bytes(content)
    copied = result(copies=copies)
    monkeypatch.setattr(store, "load", lambda *_: pytest.fail("the store was asked"))
    assert copied.recordings == [content]


@given(st.integers(0, 300), st.integers(0, 299))
def test_edit_reaches_the_parts_beside_it(count, edited):
    before = [configuration(number) for number in range(count)]
    cut = [tuple(each.name for each in part) for part in parts(before)]
    assert [name for part in cut for name in part] == [each.name for each in before]
    assert all(1 <= len(part) <= 64 for part in cut)
    after = [each for each in before if each.name != f"room-{edited}"]
    moved = {tuple(each.name for each in part) for part in parts(after)} - set(cut)
    assert sum(map(len, moved)) <= 5 * 64
