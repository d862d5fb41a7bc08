"""The campaign directory's tables: the same however the runs come in, and counted on the way."""

import hashlib
import json
import math

import numpy as np
import pyarrow.parquet as pq
import pytest
from table import each_row
from whole_directory import ConfigurationResult

from vastflow.flows.results.rows import rows_of, run_columns, verdict_columns
from vastflow.flows.results.tables import LOGS_FILE, KeptLogs, RunTables, configuration_row, instance_row
from vastflow.oracles.judgment.verdict import Metric, Verdict, read_verdicts, write_verdicts
from vastflow.oracles.results import schema
from vastflow.oracles.results.schema import CONFIGURATIONS, REJECTIONS, RUNS, VERDICTS, json_text, write_table
from vastflow.oracles.statistics.intervals import Counts
from vastflow.producers.model.configuration import Configuration, RejectedInstance, Step
from vastflow.sim.model.archive import write_behaviors
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.reading.checked import checked_digest
from vastflow.tasks.engine.engine import RunFault

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


def read_back(path, columns, rows):
    write_table(path / "t.parquet", columns, rows)
    return pq.ParquetFile(path / "t.parquet").read()


def test_table_keeps_columns_bit_for_bit_and_escapes_invalid_utf_8(tmp_path):
    assert read_back(tmp_path, REJECTIONS, []).schema.equals(REJECTIONS)
    texts = ["12", "null", 'say "no"\nthen', "σ ≥ 0.5 – 😀", "", "\\u0041", "y" * 100_000, None]
    found = read_back(tmp_path, RUNS, [{"reason": text} for text in [*texts, "no file a\udcff.csv"]])
    assert found["reason"].to_pylist() == [*texts, "no file a\\udcff.csv"]
    numbers = [0.1 + 0.2, 1e-300, -0.0, 1e22, 5.0]
    found = read_back(tmp_path, RUNS, [{"simulated_s": number} for number in numbers])["simulated_s"].to_pylist()
    assert [number.hex() for number in found] == [number.hex() for number in numbers]
    with pytest.raises(ValueError, match="unexpected field"):
        write_table(tmp_path / "t.parquet", REJECTIONS, [{"nonsense": 1}])


def test_configuration_is_written_with_files_as_digests(tmp_path):
    (row,) = read_back(tmp_path, CONFIGURATIONS, [configuration_row(CONFIGURATION)]).to_pylist()
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
        "steps": '[{"producer":"ParameterVariationList","keys":["noise"],"choice":1,"inputs":""}]',
    }


def test_run_is_written_with_its_contacts_counted():
    events = [{"kind": kind} for kind in ("contact", "recovery", "contact")]
    run = {**dict.fromkeys(RUNS.names), "run_index": 2, "error_code": 103, "events": events}
    columns = run_columns(CONFIGURATION, [run, {**run, "run_index": 3, "events": []}])
    assert list(columns) == RUNS.names
    assert (columns["configuration"], columns["family"]) == (["rooms-1"] * 2, ["rooms"] * 2)
    assert [*zip(*map(columns.get, ("run_index", "error_code", "contacts")), strict=True)] == [(2, 103, 2), (3, 103, 0)]


def test_verdict_is_written_with_its_metrics_and_units():
    verdict = Verdict("safety", 1, "fail", "too near", {"separation": Metric(0.2, "m")})
    columns = verdict_columns(CONFIGURATION, [verdict, *read_verdicts(write_verdicts([verdict]))])
    assert list(columns) == VERDICTS.names
    assert columns["metrics"] == ['{"separation":{"value":0.2,"unit":"m"}}'] * 2
    assert columns["reason"] == ["too near"] * 2


def test_rejection_is_written_with_request():
    row = instance_row(
        RejectedInstance("f", "f-1", "PathVariationRandom", "too long", {"path_length": 200.0}, {}), REJECTIONS
    )
    assert list(row) == REJECTIONS.names
    assert row["requested"] == '{"path_length":200.0}'


def test_json_of_non_finite_number_is_null():
    assert json_text([math.inf, math.nan, 1.0]) == "[null,null,1.0]"


ORACLES = ("success", "safety")
NAMES = ("room-1", "room-2", "room-3")


def log(first, stop):
    runs = [{"run_index": k, "lines": ['a "word"\nand a line'], "wall_s": 0.5} for k in range(first, stop)]
    return json.dumps({"runs": runs, "host": {"name": "h"}, "versions": {}, "pid": first}, indent=1).encode()


def behaviors(runs):
    return write_behaviors({k: {"t_s": np.array([0.5 * k]), "name": np.array(["drive"], object)} for k in runs})


def found_of(*blocks, judgment="pass", **more):
    verdicts = [Verdict(oracle, k, judgment) for block in blocks for k in block for oracle in ORACLES]
    return ConfigurationResult(verdicts=verdicts, behaviors=[behaviors(block) for block in blocks], **more)


def written(place, *results):
    place.mkdir(exist_ok=True)
    scenario = Scenario("builtin:navigate_to_pose", 1.0, {}, {}, {})
    with RunTables(place) as found:
        for name, result in zip(NAMES, results, strict=False):
            own = Configuration(name, "room", scenario, {}, {}, ())
            found.add(rows_of([(own, result)], {name: 3}, ORACLES))
    return found


def test_run_tables_write_equal_bytes_for_any_blocks(tmp_path):
    written(tmp_path / "one", found_of(range(3), exact=True))
    written(tmp_path / "other", found_of([2], range(5)))
    one, other = (
        {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in (tmp_path / each).glob("*.parquet")}
        for each in ("one", "other")
    )
    assert one == other and len(one) == 3
    assert schema.behaviors_of(tmp_path / "other", "room-1")["run_index"].tolist() == [0, 1, 2]


@pytest.mark.parametrize("rows", [1, 5, 100])
def test_run_tables_write_the_same_rows_in_groups_of_any_size(tmp_path, monkeypatch, rows):
    monkeypatch.setattr(schema, "_ROWS_A_GROUP", rows)
    written(tmp_path, *(found_of(range(3)) for _ in NAMES))
    read = pq.ParquetFile(tmp_path / "verdicts.parquet").read().to_pylist()
    asked = [(name, k, oracle) for name in NAMES for k in range(3) for oracle in ORACLES]
    assert [(row["configuration"], row["run_index"], row["oracle"]) for row in read] == asked


def test_run_tables_count_verdicts_by_oracle_and_together(tmp_path):
    fault = RunFault("room-3", None, "execute", "MemoryError")
    results = (found_of(range(3)), found_of(range(2), judgment="fail"), ConfigurationResult(faults=[fault]))
    found = written(tmp_path, *results)
    assert [found.counts(oracle) for oracle in (None, *ORACLES)] == [Counts(3, 2, 4)] * 3
    assert found.faults == [fault]


@each_row("damaged", [b"", b"{", b"[1]", b'{"runs": 3}', b"\xff"])
def test_run_log_is_read_as_written_and_damaged_one_left_out(tmp_path, damaged):
    written(tmp_path, found_of(logs=[log(2, 3), damaged, log(0, 2)]), found_of(logs=[log(0, 1)]))
    assert len((tmp_path / LOGS_FILE).read_bytes().splitlines()) == 3
    rows = KeptLogs(tmp_path).of("room-1")
    assert [(row["run_index"], row["pid"]) for row in rows] == [(0, 0), (1, 0), (2, 2)]
    assert rows[0]["lines"] == ['a "word"\nand a line'] and rows[0]["host"] == {"name": "h"}
    assert [row["run_index"] for row in KeptLogs(tmp_path).of("room-2")] == [0]
    assert KeptLogs(tmp_path).of("room-9") == []
