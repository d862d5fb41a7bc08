"""The columns of a campaign directory's tables, against row-by-row counting."""

import json
import math
import re
from collections import Counter

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.oracles.judgement.verdict import run_judgement
from vastflow.oracles.results.executed import NAMED_FILES, KeptFiles
from vastflow.oracles.results.schema import BEHAVIORS_FILE, behaviors_of, codes, floats, integers, read_columns
from vastflow.oracles.results.tables import CODES, ConfigurationTable, VerdictTable
from vastflow.sim.model.digest import file_digest

SCHEMA = pa.schema(
    {
        "configuration": pa.string(),
        "run_index": pa.int32(),
        "oracle": pa.string(),
        "judgement": pa.string(),
        "reason": pa.string(),
        "metrics": pa.string(),
    }
)
NAMES = ["a", "b", "c"]


def verdict(configuration="a", run_index=0, oracle="success", judgement="pass", reason="", **metrics):
    values = {name: {"value": value, "unit": "m"} for name, value in metrics.items()}
    return {
        "configuration": configuration,
        "run_index": run_index,
        "oracle": oracle,
        "judgement": judgement,
        "reason": reason,
        "metrics": json.dumps(values),
    }


def table_of(rows, names=NAMES):
    return VerdictTable(pa.Table.from_pylist(rows, SCHEMA), names)


said = st.dictionaries(
    st.tuples(st.sampled_from(NAMES), st.integers(0, 30), st.sampled_from(["success", "safety", "own.py:Judge"])),
    st.sampled_from(list(CODES)),
    max_size=40,
)


@settings(deadline=None)
@given(said, st.randoms(use_true_random=False))
def test_counts_are_those_of_rows_in_any_order(judged, random):
    keys = list(judged)
    random.shuffle(keys)
    table = table_of([verdict(*key, judged[key]) for key in keys])
    assert set(table.oracles) == {oracle for _, _, oracle in judged}
    for oracle in table.oracles:
        counted = Counter((name, judged[name, run, of]) for name, run, of in judged if of == oracle)
        assert table.counts(oracle).tolist() == [[counted[name, word] for word in CODES] for name in NAMES]
    runs = {}
    for (name, run, _), judgement in judged.items():
        runs.setdefault((name, run), []).append(judgement)
    together = Counter((name, run_judgement(judgements)) for (name, _), judgements in runs.items())
    assert len(table) == len(runs)
    assert table.counts(None).tolist() == [[together[name, word] for word in CODES] for name in NAMES]


def test_metrics_are_aligned_with_runs():
    table = table_of(
        [
            verdict("b", 1, time=2.5),
            verdict("b", 0, time=None),
            verdict("a", 7, time=3),
            verdict("a", 7, "safety", depth=1.0),
        ]
    )
    time = table.metrics("success")["time"]
    assert time.unit == "m"
    assert time.values[[0, 2]].tolist() == [3.0, 2.5] and math.isnan(time.values[1])
    assert [NAMES[k] for k in table.configuration] == ["a", "b", "b"]
    assert table.run_index.tolist() == [7, 0, 1]
    assert list(table.metrics("safety")) == ["depth"]
    time = table_of([verdict(time=None)]).metrics("success")["time"]
    assert time.unit == "m" and np.isnan(time.values).all()
    assert table_of([verdict()]).metrics("success") == {}


def test_reasons_are_those_of_one_judgement():
    table = table_of([verdict(reason="no"), verdict("b", 3, judgement="fail", reason="too late")])
    reasons = table.reasons("fail")
    assert (reasons.configuration.tolist(), reasons.reason.tolist()) == (["b"], ["too late"])


def test_unknown_configurations_judgements_and_metrics_are_refused():
    with pytest.raises(ValueError, match=r"verdicts.parquet judges 'z', which is no row of configurations.parquet"):
        table_of([verdict("z")])
    with pytest.raises(ValueError, match="has the judgement 'maybe'; it can be pass, fail, not judged"):
        table_of([verdict(judgement="maybe")])
    with pytest.raises(ValueError, match="JSON"):
        table_of([verdict(), {**verdict(run_index=1), "metrics": "{broken"}]).metrics("success")


def test_table_in_row_groups_reads_as_whole(tmp_path):
    rows = [verdict(NAMES[k % 3], k, reason=f"r{k % 4}", time=float(k)) for k in range(50)]
    table = pa.Table.from_pylist(rows, SCHEMA)
    with pq.ParquetWriter(tmp_path / "v.parquet", SCHEMA) as writer:
        for start in range(0, 50, 7):
            writer.write_table(table.slice(start, 7))
    read = VerdictTable(read_columns(tmp_path / "v.parquet", "configuration", "oracle", "judgement", "reason"), NAMES)
    assert read.counts(None).tolist() == table_of(rows).counts(None).tolist()
    assert read.metrics("success")["time"].values.tolist() == table_of(rows).metrics("success")["time"].values.tolist()


def test_null_is_empty_text_or_nan():
    found, known = codes(pa.chunked_array([["a", None], ["a", ""]]))
    assert [known[k] for k in found] == ["a", "", "a", ""]
    assert np.isnan(floats(pa.array([None, 1.0])[0:1])).all()
    assert floats(pa.array([1.0, None, 3.0]).slice(2)).tolist() == [3.0]
    assert integers(pa.chunked_array([pa.array([1, 2, 3]).slice(1), [4]])).tolist() == [2, 3, 4]


def test_columns_of_configurations_are_decoded():
    row = {
        "name": "a", "family": "f", "duplicate_of": None, "environment": None, "abstract": '{"file": "x"}',
        "scenario": '{"task": {}}', "factors": '{"noise": 0.1}', "provenance": "{}",
    }  # fmt: skip
    table = ConfigurationTable(pa.Table.from_pylist([row, {**row, "name": "b", "duplicate_of": "a", "abstract": "n"}]))
    assert table.factors[1] == {"noise": 0.1}
    assert (table.distinct.tolist(), table.duplicates) == ([0], {"b": "a"})
    assert [each["abstract"] for each in table.rows()] == [{"file": "x"}, "n"]
    assert table.rows()[0]["scenario"] == {"task": {}}


def test_behaviors_of_configuration_are_read_from_every_row_group(tmp_path):
    table = pa.table(
        {
            "configuration": ["a", "b", "b", "c"],
            "run_index": pa.array([0, 0, 1, 0], pa.int64()),
            "t_s": [0.5, 1.5, 2.5, 3.5],
            "name": ["drive", "wait", "", "drive"],
        }
    )
    pq.write_table(table, tmp_path / BEHAVIORS_FILE, row_group_size=2)
    found = {name: column.tolist() for name, column in behaviors_of(tmp_path, "b").items()}
    assert found == {"run_index": [0, 1], "t_s": [1.5, 2.5], "name": ["wait", ""]}
    assert [behaviors_of(tmp_path, name)["t_s"].tolist() for name in ("c", "a")] == [[3.5], [0.5]]
    assert [column.dtype for column in behaviors_of(tmp_path, "a").values()] == [np.int64, np.float64, object]
    assert behaviors_of(tmp_path, "d") == behaviors_of(tmp_path / "elsewhere", "a") == {}
    (tmp_path / BEHAVIORS_FILE).write_bytes(b"damaged")
    with pytest.raises(ValueError, match="Parquet"):
        behaviors_of(tmp_path, "b")


def test_kept_files_are_found_by_digest(tmp_path):
    plan, mesh = tmp_path / "inputs" / "deep" / "plan.fpm", tmp_path / "environments" / "e" / "mesh.stl"
    for file in (plan, mesh):
        file.parent.mkdir(parents=True)
        file.write_text(file.name)
    (tmp_path / "environments" / NAMED_FILES).write_text(json.dumps({"5011d": "e/mesh.stl"}))
    files = KeptFiles(tmp_path)
    assert (files.path(file_digest(plan)), files.path("5011d")) == (plan, mesh)
    with pytest.raises(ValueError, match=re.escape("no file has the digest 0123456789ab… that the scenario names")):
        files.path("0123456789abcdef")
