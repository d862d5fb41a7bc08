import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.engine.index import ConfigurationRuns, Index, missing, run_blocks
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.artifact import Block
from vastflow.tasks.store.store import open_store

CONFIGURATION = ConfigurationRuns("room-1", "room", 1, Scenario("builtin:navigate_to_pose", 60.0, {}, {}, {}), runs=8)


@pytest.fixture
def index(tmp_path):
    return Index(open_store(tmp_path), Keys("numeric", "e", "o", "j", 0, []))


def put(index, start, stop):
    home = index.keys.recordings(CONFIGURATION.checked)
    facts = {"runs": [[run, 10.0] for run in range(start, stop)]}
    return index.store.put(f"{home}/{start}-{stop}", {"recordings.parquet": f"{start} {stop}".encode()}, facts)


def spans(blocks):
    return [(block.start, block.stop) for block in blocks]


@each_row(
    ("blocks", "absent"), [([(0, 5)], [5, 6, 7]), ([(0, 20)], []), ([(0, 2), (3, 8)], [2]), ([(0, 1), (0, 8)], [])]
)
def test_runs_of_no_block_are_missing(blocks, absent):
    assert missing([Block("", *block, "") for block in blocks], 8) == absent


def test_blocks_that_add_nothing_are_left_out(index):
    for start, stop in [(0, 3), (0, 5), (2, 4), (3, 8), (8, 10)]:
        put(index, start, stop)
    assert spans(index.blocks(CONFIGURATION)) == [(0, 5), (3, 8)]


def test_damaged_block_is_missing(index):
    artifact = put(index, 0, 8)
    (index.store.local / artifact.key / "recordings.parquet").unlink()
    assert missing(index.blocks(CONFIGURATION), 8) == list(range(8))


def test_misnamed_folder_is_not_a_block(index):
    home = index.store.local / index.keys.recordings(CONFIGURATION.checked)
    (home / "notes").mkdir(parents=True)
    assert index.blocks(CONFIGURATION) == []


def test_verdicts_are_found_through_the_trace(index):
    put(index, 0, 8)
    (found,) = index.stored(CONFIGURATION)
    assert (found.trace, found.verdicts) == (None, None)
    trace = index.store.put(index.trace_key(CONFIGURATION, found.block), {"traces.parquet": b"t"})
    key = index.verdicts_key(CONFIGURATION, found.block, trace.content)
    assert index.stored(CONFIGURATION)[0].verdicts is None
    verdicts = index.store.put(key, {"verdicts.json": b"[]"}, {"runs": [], "causes": []})
    assert index.stored(CONFIGURATION)[0].verdicts == verdicts


@given(st.sets(st.integers(0, 60)), st.integers(1, 9))
def test_run_blocks_hold_each_run_once_without_gaps_and_not_too_many(runs, most):
    parts = run_blocks(sorted(runs), most)
    assert [run for start, stop in parts for run in range(start, stop)] == sorted(runs)
    assert all(0 < stop - start <= most for start, stop in parts)
