"""The campaign of a program: what the program writes, and what its oracle says of it."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import refused
from table import each_row

from vastflow.flows import run_campaign
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.oracles.judgment.registry import oracle_of
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import trace_of
from vastflow.oracles.replay.recorded import recorded_run
from vastflow.oracles.results.tables import read_tables
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.archive import read_outputs
from vastflow.sim.model.recording import Run
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.run import execute
from vastflow.sim.scenario.programs.folders import files_matching
from vastflow.sim.scenario.programs.run import process_run

GROWTH = Path(__file__).parents[2] / "campaigns/growth"
RUN = Run(0, "", "succeeded", 0, "", 1.0, 0.0, 0, 0)

pytestmark = pytest.mark.timeout(900)


@pytest.fixture
def grown(tmp_path):
    """The record of the program, run with these arguments."""

    def run_it(*arguments):
        with process_run(ProcessSetup(files_matching(GROWTH, ["growth.py"])), where=tmp_path) as run:
            run.start(["python3", "growth.py", *arguments]).wait(120)
            return run.close()

    return run_it


def judged(tables):
    oracle = oracle_of("growth_oracle.py:StaysBelowCapacity", {"capacity": 1000}, GROWTH)
    return oracle.judge(SimpleNamespace(run=RUN, tables=tables), Situation(None, (), ()))


def test_slow_growth_stays_below_the_capacity(grown):
    record = grown("--growth-rate", "0.5", "--initial-population", "10")
    table = record.outputs.tables["growth"]
    assert list(table) == ["t_s", "population"]
    assert (table["t_s"][-1], table["population"][0]) == (100.0, 10.0)
    verdict = judged(record.outputs.tables)
    assert verdict.judgment == "pass"
    assert verdict.metrics["final"].value == pytest.approx(1000.0)


def test_empty_population_is_refused(grown):
    record = grown("--growth-rate", "1.0", "--initial-population", "0")
    assert "expected more than 0, got --initial-population 0" in record.logs[0].text
    assert judged(record.outputs.tables).judgment == "not judged"


def test_non_numeric_population_fails():
    tables = {"growth": {"t_s": np.arange(3.0), "population": np.array([1.0, -np.inf, np.nan])}}
    assert judged(tables).reason == "the population is -inf at 1 s"


@each_row("column", [np.array([]), np.array(["a"])])
def test_table_without_numbers_is_not_judged(column):
    verdict = judged({"growth": {"t_s": np.zeros(len(column)), "population": column}})
    assert (verdict.judgment, verdict.reason) == ("not judged", "growth.csv has no rows of numbers")


@pytest.fixture(scope="module")
def fastest():
    """The configuration of the fastest growth from a hundred, and the campaign's oracles."""
    campaign, oracles = read_campaign(GROWTH / "growth.vast")
    found = instantiate(campaign)
    assert (campaign.notes, campaign.unexecutable, found.rejections, len(found.configurations)) == ((), (), (), 20)
    (configuration,) = [c for c in found.configurations if c.factors == {"growth_rate": 4.0, "initial_population": 100}]
    return configuration, oracles


def test_run_of_the_campaign_is_a_recording_without_rows_and_a_table(fastest):
    execution = execute(fastest[0].scenario, 0)
    recording = execution.recording
    assert (recording.run.outcome, recording.columns) == ("succeeded", {})
    assert [text.text for text in execution.log.texts] == ["974.9 after 200 steps of 0.5 s\n"]
    trace = trace_of(recording, {"no_reference": "there is no robot"}, {})
    assert trace["growth/population"].max() == pytest.approx(1116.08, abs=0.01)
    assert len(trace) == 0


def test_scenario_digest_depends_on_program_text(fastest, tmp_path):
    for file in GROWTH.iterdir():
        if file.is_file():
            (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "growth.py").write_text((GROWTH / "growth.py").read_text().replace("default=200", "default=100"))
    campaign, _ = read_campaign(tmp_path / "growth.vast")
    digests = {configuration.scenario.digest for configuration in instantiate(campaign).configurations}
    assert len(digests) == 20 and fastest[0].scenario.digest not in digests


@pytest.mark.timeout(900)
def test_campaign_runs_through_the_flow_and_is_reported_without_maps(tmp_path):
    names = ["growth-1-1", "growth-5-3"]
    results = run_campaign(
        GROWTH / "growth.vast", only=names, results=tmp_path / "results", store=tmp_path / "store", workers=1
    )
    assert (results.faults, results.summary.passed, results.summary.failed) == ((), 1, 1)
    tables = read_tables(results.directory)
    reasons = {row["configuration"]: row["reason"] for row in tables.verdicts.rows() if row["judgment"] == "fail"}
    assert reasons == {"growth-5-3": "1116, 12 % above the capacity of 1000"}
    report = (results.directory / "report.html").read_text()
    assert [words for words in ("Where it happened", "m driven", "missed goals") if words in report] == []
    figures = sorted(file.name for file in (results.directory / "figures").iterdir())
    assert figures == ["factors.png", "factors.svg", "rates.png", "rates.svg"]
    kept = read_outputs((results.directory / "outputs/growth-5-3.zip").read_bytes())
    assert len(kept[0].tables["growth"]["population"]) == 201
    assert (results.directory / "inputs/growth.py").read_bytes() == (GROWTH / "growth.py").read_bytes()
    recorded = recorded_run(results.directory, "growth-5-3", 0)
    assert Path(recorded.scenario.programs.files[0][1].path) == results.directory / "inputs/growth.py"
    assert "growth-5-3 has no robot, so there is nothing to draw" in refused(
        "replay", results.directory, "growth-5-3", 0
    )
