"""The columns of a campaign directory's tables, against row-by-row counting."""

import json
import math
from collections import Counter

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.oracles.judgement.verdict import run_judgement
from vastflow.oracles.results.column import codes, floats, integers, parsed, read_columns
from vastflow.oracles.results.tables import ConfigurationTable
from vastflow.oracles.results.verdict_table import CODES, verdict_table

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
    return verdict_table(pa.Table.from_pylist(rows, SCHEMA), names)


said = st.dictionaries(
    st.tuples(st.sampled_from(NAMES), st.integers(0, 30), st.sampled_from(["success", "safety", "own.py:Judge"])),
    st.sampled_from(list(CODES)),
    max_size=40,
)


@settings(deadline=None)
@given(said, st.randoms(use_true_random=False))
def test_counts_are_those_of_the_rows_in_whatever_order_they_stand(judged, random):
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


def test_metric_is_aligned_with_the_runs_and_nothing_is_not_a_number():
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


def test_metric_that_no_run_has_keeps_its_name_and_unit():
    time = table_of([verdict(time=None)]).metrics("success")["time"]
    assert time.unit == "m" and np.isnan(time.values).all()


def test_oracle_may_measure_nothing():
    assert table_of([verdict()]).metrics("success") == {}


def test_reasons_are_those_of_one_judgement():
    table = table_of([verdict(reason="no"), verdict("b", 3, judgement="fail", reason="too late")])
    reasons = table.reasons("fail")
    assert reasons.configuration.tolist() == ["b"]
    assert reasons.reason.tolist() == ["too late"]


def test_verdict_of_no_configuration_is_refused():
    with pytest.raises(ValueError, match=r"verdicts.parquet judges 'z', which is no row of configurations.parquet"):
        table_of([verdict("z")])


def test_judgement_that_is_none_is_refused():
    with pytest.raises(ValueError, match="has the judgement 'maybe'; it can be pass, fail, not judged"):
        table_of([verdict(judgement="maybe")])


def test_table_in_many_pieces_reads_like_one(tmp_path):
    rows = [verdict(NAMES[k % 3], k, reason=f"r{k % 4}", time=float(k)) for k in range(50)]
    table = pa.Table.from_pylist(rows, SCHEMA)
    with pq.ParquetWriter(tmp_path / "v.parquet", SCHEMA) as writer:
        for start in range(0, 50, 7):
            writer.write_table(table.slice(start, 7))
    read = verdict_table(read_columns(tmp_path / "v.parquet", "configuration", "oracle", "judgement", "reason"), NAMES)
    assert read.counts(None).tolist() == table_of(rows).counts(None).tolist()
    assert read.metrics("success")["time"].values.tolist() == table_of(rows).metrics("success")["time"].values.tolist()


def test_nothing_is_an_empty_text_and_not_a_number():
    found, known = codes(pa.chunked_array([["a", None], ["a", ""]]))
    assert [known[k] for k in found] == ["a", "", "a", ""]
    assert np.isnan(floats(pa.array([None, 1.0])[0:1])).all()
    assert floats(pa.array([1.0, None, 3.0]).slice(2)).tolist() == [3.0]
    assert integers(pa.chunked_array([pa.array([1, 2, 3]).slice(1), [4]])).tolist() == [2, 3, 4]


def test_what_is_no_json_object_is_refused():
    with pytest.raises(ValueError, match="JSON"):
        parsed(pa.array(['{"a": 1}', "{broken"]))


def test_columns_of_configurations_are_decoded():
    row = {
        "name": "a", "family": "f", "duplicate_of": None, "environment": None, "abstract": '{"file": "x"}',
        "scenario": '{"task": {}}', "factors": '{"noise": 0.1}', "provenance": "{}",
    }  # fmt: skip
    table = ConfigurationTable(pa.Table.from_pylist([row, {**row, "name": "b", "duplicate_of": "a", "abstract": "n"}]))
    assert table.abstracts == [{"file": "x"}, "n"]
    assert table.factors[1] == {"noise": 0.1}
    assert table.distinct.tolist() == [0]
    assert table.rows()[0]["scenario"] == {"task": {}}
