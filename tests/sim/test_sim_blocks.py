"""Blocks of recordings, and logs of runs."""

import io
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from table import each_row

from vastflow.sim.model.blocks import (
    read_block,
    read_columns,
    read_recordings,
    read_rows,
    write_block,
    write_recordings,
)
from vastflow.sim.model.recording import Event, LogText, Recording, Run, RunLog, Use, run_log_of, run_log_row, run_row

TEXT = st.text(max_size=8)
NUMBERS = st.floats(-1e6, 1e6)
EVENTS = st.builds(Event, NUMBERS, TEXT, NUMBERS, NUMBERS, TEXT, NUMBERS)
RUNS = st.builds(
    Run,
    run_index=st.integers(0, 2**31 - 1),
    seed=TEXT,
    outcome=st.sampled_from(["succeeded", "aborted", "timed_out"]),
    error_code=st.integers(0, 999),
    reason=TEXT,
    simulated_s=NUMBERS,
    distance_m=NUMBERS,
    recoveries=st.integers(0, 99),
    missed_goals=st.integers(0, 9),
    events=st.lists(EVENTS, max_size=3).map(tuple),
)


@st.composite
def blocks(draw):
    """Recordings of one block: increasing run indices, the same columns, any lengths."""
    runs = draw(st.lists(RUNS, min_size=1, max_size=4, unique_by=lambda run: run.run_index))
    names = draw(st.lists(TEXT.filter(lambda n: n and n != "run_index"), min_size=1, max_size=3, unique=True))
    recordings = []
    for run in sorted(runs, key=lambda run: run.run_index):
        n = draw(st.integers(0, 20))
        recordings.append(Recording(run, {name: draw(arrays(np.int32, n)) for name in names}))
    return recordings


@given(blocks())
@settings(max_examples=60, deadline=None)
def test_block_is_read_as_written_and_its_bytes_depend_on_content_alone(recordings):
    content = write_recordings(recordings)
    found = read_recordings(content)
    assert content == write_recordings(recordings) == write_recordings(found)
    assert [r.run for r in found] == [r.run for r in recordings]
    for read, written in zip(found, recordings, strict=True):
        assert list(read.columns) == list(written.columns)
        for name, column in written.columns.items():
            assert read.columns[name].dtype == np.int32
            np.testing.assert_array_equal(read.columns[name], column)
        assert read.digest == written.digest


def a_recording(run_index=0, n=50, **changes):
    run = Run(run_index, "0:1:2", "succeeded", 0, "", 5.0, 2.0, 0, 0)
    t = np.arange(n, dtype=np.int32)
    return Recording(run, {"t_ms": t * 100, "x_mm": t * t, **changes})


def test_digest_of_a_recording_is_pinned():
    assert a_recording().digest == "a0d04e63e45f3b803cb5a96e1a9799951424f6fffd7c0bb58196518d4f2bf014"


def test_recording_digest_covers_names_and_values_of_columns():
    moved = np.arange(50, dtype=np.int32)
    digests = [a_recording(), a_recording(x_mm=moved), a_recording(y_mm=moved), a_recording(run_index=1)]
    assert len({recording.digest for recording in digests}) == 4


def test_empty_block_is_read_as_empty():
    assert read_block(write_block([], [])) == []


def test_runs_of_one_block_have_the_same_columns():
    with pytest.raises(ValueError, match=r"expected the same columns in all runs of a block, got \['a'\] and \['b'\]"):
        write_block([{"run_index": 0}, {"run_index": 1}], [{"a": np.zeros(1, np.int32)}, {"b": np.zeros(1, np.int32)}])


def test_block_stores_smooth_columns_as_differences(tmp_path):
    noise = np.random.default_rng(1).integers(-(2**31), 2**31 - 1, 52, dtype=np.int32)
    recordings = [a_recording(3, noise=noise[:50]), a_recording(5, n=2, noise=noise[50:])]
    (tmp_path / "b.parquet").write_bytes(write_recordings(recordings))
    table = pq.read_table(tmp_path / "b.parquet")
    assert read_rows(tmp_path / "b.parquet") == [run_row(recording.run) for recording in recordings]
    assert table.column_names == ["run_index", "t_ms:d1", "x_mm:d2", "noise"]
    np.testing.assert_array_equal(np.array(table["noise"]), noise)
    assert table["run_index"].to_pylist() == [3] * 50 + [5] * 2
    code = np.array(table["x_mm:d2"])
    differences = np.where(code % 2 == 0, code // 2, -(code + 1) // 2)
    expected = [*(k * k for k in range(50)), 0, 1]
    np.testing.assert_array_equal(np.cumsum(np.cumsum(differences)), expected)


def test_column_named_like_delta_is_read_back():
    columns = {"a:d2": np.array([7, -7, 7, 2**31 - 1], dtype=np.int32), "b:d0": np.arange(4, dtype=np.int32)}
    ((_, found),) = read_block(write_block([{"run_index": 0}], [columns]))
    assert list(found) == ["a:d2", "b:d0"]
    np.testing.assert_array_equal(found["a:d2"], columns["a:d2"])


def test_columns_are_read_alone():
    content = write_recordings([a_recording(3, n=2), a_recording(5, n=3)])
    index, columns = read_columns(content, ["x_mm"])
    assert (index.tolist(), list(columns), columns["x_mm"].tolist()) == ([3, 3, 5, 5, 5], ["x_mm"], [0, 1, 0, 1, 4])
    with pytest.raises(KeyError, match="y_mm"):
        read_columns(content, ["y_mm"])


def test_block_rejects_older_format():
    out = io.BytesIO()
    pq.write_table(pa.table({"run_index": [0]}, metadata={"vastflow.runs": "[{}]"}), out)
    with pytest.raises(ValueError, match="Another version of vastflow wrote this block"):
        read_block(out.getvalue())


LOG = RunLog(
    *(1_700_000_000.25, 2.5, 1.25, 4096, ("0.1 s: begun",)),
    texts=(LogText("map", ("map_server", "-v"), "ready\n", False),),
    resources=(Use(1.0, 0.5, 2048, 2),),
    notes=("big.bin is not kept",),
)


@each_row("log", [LOG, RunLog(0.0, 0.5, 0.25, 1000)])
def test_run_log_survives_json(log):
    assert run_log_of(json.loads(json.dumps(run_log_row(log)))) == log
