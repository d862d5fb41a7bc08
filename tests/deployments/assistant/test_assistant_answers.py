"""Answers on campaigns: each number is the report's, and pandas' from the tables."""

import base64
import io
import itertools
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hostile import executed, stranger
from PIL import Image
from table import each_row

from vastflow.deployments.assistant.answers import Answers
from vastflow.deployments.explorer.directories import Directories
from vastflow.flows.analysis.comparison import compared
from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.query import frames
from vastflow.oracles.results.tables import read_tables
from vastflow.oracles.statistics.intervals import wilson
from vastflow.sim.model.faults import UserError


@pytest.fixture
def runs(results):
    """The runs of the newest campaign, as its table has them."""
    found = pd.read_parquet(max(results.iterdir()) / "runs_wide.parquet")
    return found.astype({"configuration": str, "family": str, "passed": float})


@pytest.fixture
def tables(results):
    return read_tables(max(results.iterdir()))


def numbers(row):
    return row["passed"], row["failed"], row["not_judged"]


def test_campaigns_are_listed_newest_first_with_their_counts(call, ids, runs):
    found = call("campaigns")
    assert [each["campaign"] for each in found["campaigns"]] == ids
    assert numbers(found["campaigns"][0]) == (runs.passed.sum(), len(runs) - runs.passed.sum(), 0)
    assert (found["total_campaigns"], found["cut"]) == (2, [])
    assert call("campaigns", limit=1)["cut"] == ["1 more of campaigns: ask on with a greater offset or limit"]


def test_rates_of_a_campaign_have_the_headline_of_its_report(call, ids, tables, runs):
    found = call("rates", campaign=ids[0])
    newest, evidence = found["whole"], evidence_of(tables)[None].campaign
    assert (found["headline"], found["rates"]) == (evidence.headline.text, [])
    assert newest["rate"] == pytest.approx(runs.groupby("configuration").passed.mean().mean(), abs=1e-12)
    assert newest["interval"] == [evidence.interval.low, evidence.interval.high]
    assert newest["others"] == [evidence.clustered.low, evidence.clustered.high]


@each_row("by", ["family", "configuration", "noise"])
def test_rates_of_groups_equal_pandas(call, ids, runs, by):
    rows = call("rates", campaign=ids[0], by=by)["rates"]
    groups = runs.groupby(by)
    assert len(rows) == len(groups)
    for row in rows:
        own = groups.get_group(float(row[by]) if by == "noise" else row[by])
        passed = int(own.passed.sum())
        assert numbers(row) == (passed, len(own) - passed, 0)
        assert row["rate"] == pytest.approx(own.groupby("configuration").passed.mean().mean(), abs=1e-12)
        # Configurations of one number of runs have the interval of their runs together.
        ends = wilson(row["rate"] * len(own), len(own))
        assert row["interval"] == pytest.approx([ends.low, ends.high])


def test_rates_by_oracle_are_those_of_its_verdicts(call, ids, results):
    verdicts = pd.read_parquet(max(results.iterdir()) / "verdicts.parquet")
    for row in call("rates", campaign=ids[0], by="oracle")["rates"]:
        said = verdicts[verdicts.oracle == row["oracle"]].judgment
        assert numbers(row) == tuple((said == judgment).sum() for judgment in ("pass", "fail", "not judged"))


def test_failures_are_counted_as_pandas_counts_them(call, ids, runs):
    found, failed = call("failures", campaign=ids[0]), runs[runs.passed == 0.0]
    assert (found["failed"], found["runs"]) == (len(failed), len(runs))
    expected = failed.groupby("configuration").size().sort_values(ascending=False)
    assert [(each["configuration"], each["failed"]) for each in found["configurations"]] == [*expected.items()]
    assert sum(each["runs"] for each in found["reasons"]) == len(failed)
    one = call("failures", campaign=ids[0], configuration=expected.index[-1])
    assert (one["failed"], one["total_configurations"]) == (expected.iloc[-1], 1)


def test_run_is_described_in_words_and_events(call, ids):
    found = call("describe_run", campaign=ids[0], configuration="room-2", run_index=0)
    assert found["words"].startswith("room-2, run 0: fail. Its mission aborted after ")
    assert "stuck" in found["words"]
    passed = call("describe_run", campaign=ids[0], configuration="room-2", run_index=3)
    assert (passed["judgment"], passed["verdicts"][0]["judgment"]) == ("pass", "pass")


def test_run_without_recording_or_robot_is_described_without_numbers_of_a_robot(call, ids, results, monkeypatch):
    place = {"campaign": ids[0], "configuration": "room-2", "run_index": 3}
    real = frames.stored_run(max(results.iterdir()), "room-2", 3)
    for recording, words in (
        (None, "This run was not recorded. The verdicts say why."),
        (replace(real.recording, columns={}), "Its mission succeeded after 4.10 s."),
    ):
        monkeypatch.setattr(frames, "stored_run", lambda *_, told=recording: replace(real, recording=told))
        found = call("describe_run", **place)
        assert found["words"] == f"room-2, run 3: pass. {words}"
        assert found.keys().isdisjoint({"distance_m", "recoveries"}) and found["sentence"]


def test_events_of_a_run_go_on_after_the_first_ones(call, ids, monkeypatch):
    events = [{"t_s": float(k), "kind": "recovery", "x_m": 0.0, "y_m": 0.0, "text": "recovery: spin"} for k in range(5)]
    real = frames.facts_of
    monkeypatch.setattr(frames, "facts_of", lambda *asked: {**real(*asked), "events": events})
    asked = {"campaign": ids[0], "configuration": "room-2", "run_index": 0, "limit": 2}
    first, last = (call("describe_run", **asked, offset=offset) for offset in (0, 4))
    assert first["cut"] == ["3 more of events: ask on with a greater offset or limit"]
    assert (first["events"], last["events"], last["cut"]) == (events[:2], events[4:], [])


def test_answers_on_a_campaign_of_others_execute_nothing_of_it(tmp_path):
    (tmp_path / "results").mkdir()
    stranger(tmp_path / "results", tmp_path / "canary")
    answers = Answers(Directories([tmp_path / "results"]))
    run = {"configuration": "room", "run_index": 0}
    assert answers.describe_run(**run)["words"].startswith("room, run 0: fail. Its mission aborted")
    assert answers.draw_map(configuration="room")[1].startswith("room: 1 of 1 runs, 1 failed")
    assert answers.tables()["runs"] == answers.failures()["failed"] == 1
    assert executed(tmp_path / "canary") == []


def test_map_shows_requested_runs(call, ids):
    pictures = []
    for run_index in ([0], [3], []):
        picture, words = call("draw_map", campaign=ids[0], configuration="room-2", run_index=run_index)
        pictures.append(np.asarray(Image.open(io.BytesIO(base64.b64decode(picture.data)))))
        n, failed = len(run_index) or 4, {(0,): 1, (3,): 0, (): 2}[(*run_index,)]
        assert words.text.startswith(f"room-2: {n} of 4 runs, {failed} failed")
    assert not any((a == b).all() for a, b in itertools.pairwise(pictures))


def test_comparison_is_that_of_the_command(call, ids, results):
    before, after = map(read_tables, sorted(results.iterdir()))
    expected = compared(before, after)
    found = call("compare", before=ids[1], after=ids[0], limit=1)
    assert found["difference"]["difference"] == expected.whole.difference
    assert found["difference"]["interval"] == list(expected.whole.interval)
    assert found["words"].startswith(expected.gate.text)
    assert len(found["changes"]) == 1


def test_tables_tell_unit_and_range_of_each_column(call, ids, runs):
    found = {each["name"]: each for each in call("tables", campaign=ids[0])["columns_of_runs"]}
    assert {*found} == {*runs.columns}
    assert (found["simulated_s"]["unit"], found["noise"]["group"]) == ("s", "factor")
    assert found["noise"]["range"] == [runs.noise.min(), runs.noise.max()]
    assert "NULL is not judged" in found["passed"]["meaning"]


def test_sql_names_the_campaign_of_each_row(call, ids):
    found = call("sql", query="SELECT campaign, count(*) FROM runs GROUP BY ALL ORDER BY 1 DESC")
    assert found["rows"] == [[each, 12] for each in ids]


def test_running_campaign_has_no_answers_yet(answers, ids, monkeypatch):
    directory = answers.directory(ids[0])
    object.__setattr__(directory, "state", "running")
    monkeypatch.setattr(type(answers), "directory", lambda *_: directory)
    with pytest.raises(UserError, match="still running"):
        answers.rates(campaign=ids[0], by="family")


def test_answers_are_plain_json(call, ids):
    assert json.loads(json.dumps(call("campaigns"), allow_nan=False))
    for tool in ("rates", "tables", "failures"):
        assert json.loads(json.dumps(call(tool, campaign=ids[0]), allow_nan=False))


def test_configuration_without_a_robot_is_not_drawn(call, ids, monkeypatch):
    monkeypatch.setattr("vastflow.flows.analysis.comparison_pictures.read_walks", lambda *_: None)
    said = call("draw_map", campaign=ids[0], configuration="room-1")
    assert said.endswith("room-1 can't be drawn: office-2026-11-28-060000 has no recording of it")
