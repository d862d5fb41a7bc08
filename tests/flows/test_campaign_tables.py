"""The tables of a campaign's runs: the same however the runs come in, and counted on the way."""

import hashlib
import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from table import each_row
from whole_directory import ConfigurationResult

from vastflow.flows.results.campaign_tables import LOGS_FILE, CampaignTables, KeptLogs, RunLogs
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.judgement.verdict import Verdict
from vastflow.oracles.results import schema
from vastflow.oracles.results.behaviors import Behaviors
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.archive import write_behaviors
from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.engine.engine import RunFault

ORACLES = ("success", "safety")
NAMES = ("room-1", "room-2", "room-3")


def configuration(name):
    return Configuration(name, "room", Scenario("builtin:navigate_to_pose", 1.0, {}, {}, {}), {}, {}, ())


def log(first, stop):
    runs = [{"run_index": k, "lines": ['a "word"\nand a line'], "wall_s": 0.5} for k in range(first, stop)]
    return json.dumps({"runs": runs, "host": {"name": "h"}, "versions": {}, "pid": first}, indent=1).encode()


def behaviors(runs):
    return write_behaviors({k: {"t_s": np.array([0.5 * k]), "name": np.array(["drive"], object)} for k in runs})


def found_of(*blocks, judgement="pass", exact=False):
    verdicts = [Verdict(oracle, k, judgement) for block in blocks for k in block for oracle in ("success", "safety")]
    return ConfigurationResult(
        verdicts=verdicts, behaviors=[behaviors(block) for block in blocks], logs=[log(0, 2)], exact=exact
    )


def written(place, *results):
    place.mkdir()
    with CampaignTables(place, ORACLES) as found:
        for name, result in zip(NAMES, results, strict=False):
            found.add(configuration(name), result, 3)
    return found


def digests(place):
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in place.glob("*.parquet")}


def test_tables_have_the_same_bytes_however_the_runs_were_blocked(tmp_path):
    written(tmp_path / "one", found_of(range(3), exact=True))
    written(tmp_path / "other", found_of([2], range(5)))
    assert digests(tmp_path / "one") == digests(tmp_path / "other")
    assert Behaviors(tmp_path / "other").of("room-1")["run_index"].tolist() == [0, 1, 2]


@pytest.mark.parametrize("rows", [1, 2, 5, 100])
def test_rows_that_are_written_some_at_a_time_are_the_same_rows(tmp_path, monkeypatch, rows):
    monkeypatch.setattr(schema, "_ROWS_A_GROUP", rows)
    written(tmp_path / "few", *(found_of(range(3)) for _ in NAMES))
    read = pq.ParquetFile(tmp_path / "few" / "verdicts.parquet").read().to_pylist()
    asked = [(name, k, oracle) for name in NAMES for k in range(3) for oracle in ("success", "safety")]
    assert [(row["configuration"], row["run_index"], row["oracle"]) for row in read] == asked


def test_verdicts_are_counted_by_oracle_and_together(tmp_path):
    fault = RunFault("room-3", None, "execute", "MemoryError")
    found = written(
        tmp_path / "x",
        found_of(range(3)),
        found_of(range(2), judgement="fail"),
        ConfigurationResult(faults=[fault]),
    )
    assert found.tally.counts == Counts(3, 2, 4)
    assert found.tally.by_oracle == {"success": Counts(3, 2, 4), "safety": Counts(3, 2, 4)}


def test_run_log_is_a_line_and_comes_back_as_it_was(tmp_path):
    logs = RunLogs(tmp_path)
    logs.add("room-1", [log(2, 3), log(0, 2)])
    logs.add('a "name"', [log(0, 1)])
    logs.close()
    assert len((tmp_path / LOGS_FILE).read_bytes().splitlines()) == 3
    rows = KeptLogs(tmp_path).of("room-1")
    assert [(row["run_index"], row["pid"]) for row in rows] == [(0, 0), (1, 0), (2, 2)]
    assert rows[0]["lines"] == ['a "word"\nand a line'] and rows[0]["host"] == {"name": "h"}
    assert [row["run_index"] for row in KeptLogs(tmp_path).of('a "name"')] == [0]
    assert KeptLogs(tmp_path).of("room-9") == []


@each_row("damaged", [b"", b"{", b"[1]", b'{"runs": 3}', b"\xff"])
def test_damaged_run_log_is_left_out(tmp_path, damaged):
    logs = RunLogs(tmp_path)
    logs.add("room-1", [damaged, log(0, 1)])
    logs.close()
    assert [row["run_index"] for row in KeptLogs(tmp_path).of("room-1")] == [0]
