"""The campaign directory's tables."""

import math
import subprocess
import sys

import pyarrow.parquet as pq
import pytest

from vastflow.flows.results.tables import configuration_row, rejection_row, run_columns, verdict_columns
from vastflow.oracles.judgement.verdict import Metric, Verdict, read_verdicts, write_verdicts
from vastflow.oracles.results.schema import CONFIGURATIONS, REJECTIONS, RUNS, VERDICTS, json_text, write_table
from vastflow.producers.model.configuration import Configuration, RejectedInstance, Step
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.reading.checked import checked_digest

CONFIGURATION = Configuration(
    name="rooms-1",
    family="rooms",
    scenario=Scenario(
        "builtin:navigate_to_pose",
        360.0,
        {"map_file": FileContent("/somewhere/map.yaml", "d1")},
        {"goal_pose": {"x": 1.0}},
        {"noise": 0.25},
    ),
    factors={"noise": 0.25},
    provenance={"_path": [[0.0, 1.0]]},
    steps=(Step("ParameterVariationList", ("noise",)),),
)


def rows_of(path):
    return pq.ParquetFile(path).read().to_pylist()


def test_table_without_rows_still_has_its_columns(tmp_path):
    write_table(tmp_path / "t.parquet", REJECTIONS, [])
    assert pq.read_schema(tmp_path / "t.parquet").equals(REJECTIONS)


def test_text_comes_back_as_it_was(tmp_path):
    texts = ["2026-01-01", "12", "true", "null", 'say "no"\nthen', "σ ≥ 0.5 – 😀", "", "\\u0041", "y" * 100_000]
    write_table(tmp_path / "t.parquet", REJECTIONS, [dict.fromkeys(REJECTIONS.names, text) for text in texts])
    assert [row["reason"] for row in rows_of(tmp_path / "t.parquet")] == texts


def test_text_that_utf_8_does_not_have_is_written_as_an_escape(tmp_path):
    write_table(tmp_path / "t.parquet", RUNS, [{"reason": "no file a\udcff.csv"}, {"reason": None}, {"reason": ""}])
    assert [row["reason"] for row in rows_of(tmp_path / "t.parquet")] == ["no file a\\udcff.csv", None, ""]


def test_numbers_come_back_bit_for_bit(tmp_path):
    numbers = [0.1 + 0.2, 1e-300, -0.0, 1e22, 5.0]
    write_table(tmp_path / "t.parquet", RUNS, [{"simulated_s": number} for number in numbers])
    assert [row["simulated_s"].hex() for row in rows_of(tmp_path / "t.parquet")] == [n.hex() for n in numbers]


def test_column_the_table_does_not_have_is_refused(tmp_path):
    with pytest.raises(ValueError, match="unexpected field"):
        write_table(tmp_path / "t.parquet", REJECTIONS, [{"nonsense": 1}])


def test_configuration_is_written_with_files_as_digests(tmp_path):
    write_table(tmp_path / "t.parquet", CONFIGURATIONS, [configuration_row(CONFIGURATION)])
    (row,) = rows_of(tmp_path / "t.parquet")
    assert row == {
        "name": "rooms-1",
        "family": "rooms",
        "scenario_digest": CONFIGURATION.scenario.digest,
        "checked_digest": checked_digest(CONFIGURATION.scenario),
        "duplicate_of": None,
        "environment": "d1",
        "abstract": "builtin:navigate_to_pose",
        "timeout_s": 360.0,
        "scenario": '{"environment":{"map_file":{"file":"d1"}},"task":{"goal_pose":{"x":1.0}},"system":{"noise":0.25}}',
        "factors": '{"noise":0.25}',
        "provenance": '{"_path":[[0.0,1.0]]}',
        "steps": '[{"producer":"ParameterVariationList","keys":["noise"],"choice":1}]',
    }


def test_run_is_written_with_its_contacts_counted():
    run = {
        "run_index": 2,
        "seed": "7",
        "outcome": "aborted",
        "error_code": 103,
        "reason": "no path",
        "simulated_s": 12.5,
        "distance_m": 3.0,
        "recoveries": 1,
        "missed_goals": 0,
        "events": [{"kind": "contact"}, {"kind": "recovery"}, {"kind": "contact"}],
    }
    columns = run_columns(CONFIGURATION, [run, {**run, "run_index": 3, "events": []}])
    assert list(columns) == RUNS.names
    assert (columns["configuration"], columns["family"]) == (["rooms-1"] * 2, ["rooms"] * 2)
    assert [*zip(*map(columns.get, ("run_index", "error_code", "contacts")), strict=True)] == [(2, 103, 2), (3, 103, 0)]


def test_configuration_of_which_no_run_was_recorded_has_no_rows():
    assert {*map(len, run_columns(CONFIGURATION, []).values())} == {0}


def test_verdict_is_written_with_its_metrics_and_units():
    verdict = Verdict("safety", 1, "fail", "too near", {"separation": Metric(0.2, "m")})
    columns = verdict_columns(CONFIGURATION, [verdict, *read_verdicts(write_verdicts([verdict]))])
    assert list(columns) == VERDICTS.names
    assert columns["metrics"] == ['{"separation":{"value":0.2,"unit":"m"}}'] * 2
    assert columns["reason"] == ["too near"] * 2


def test_rejection_is_written_with_what_was_requested():
    row = rejection_row(RejectedInstance("f", "f-1", "PathVariationRandom", "too long", {"path_length": 200.0}, {}))
    assert list(row) == REJECTIONS.names
    assert row["requested"] == '{"path_length":200.0}'


def test_number_that_is_none_is_null():
    assert json_text([math.inf, math.nan, 1.0]) == "[null,null,1.0]"


def test_writing_a_table_does_not_import_pandas(tmp_path):
    program = (
        "import pathlib, sys\n"
        "from vastflow.oracles.results.schema import RUNS, write_table\n"
        f"write_table(pathlib.Path({str(tmp_path / 't.parquet')!r}), RUNS, [{{'run_index': 1}}])\n"
        f"write_table(pathlib.Path({str(tmp_path / 'e.parquet')!r}), RUNS, [])\n"
        "sys.exit('pandas' in sys.modules)\n"
    )
    assert subprocess.run([sys.executable, "-c", program], timeout=240, check=False).returncode == 0
