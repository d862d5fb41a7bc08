"""The campaign of a program: what the program writes, and what its oracle says of it."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from vastflow.oracles.oracle import oracle_of
from vastflow.oracles.situation import Situation
from vastflow.sim.behaviour.tree import ScenarioTree
from vastflow.sim.osc.parameters import bound
from vastflow.sim.osc.reading import read_scenarios
from vastflow.sim.process.actions import process_actions
from vastflow.sim.process.folder import files_matching
from vastflow.sim.process.run import process_run
from vastflow.sim.process.setup import ProcessSetup
from vastflow.sim.recording import Run

GROWTH = Path(__file__).parents[2] / "campaigns/growth"
RUN = Run(0, "", "succeeded", 0, "", 1.0, 0.0, 0, 0)

pytestmark = pytest.mark.timeout(30)


@pytest.fixture
def grown(tmp_path):
    """The record of the program, run with these arguments."""

    def run_it(*arguments):
        with process_run(ProcessSetup(GROWTH, files_matching(GROWTH, ["growth.py"])), tmp_path) as run:
            run.start(["python3", "growth.py", *arguments]).wait(20)
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
    assert verdict.judgement == "pass"
    assert verdict.metrics["final"].value == pytest.approx(1000.0)


def test_fast_growth_jumps_over_the_capacity(grown):
    verdict = judged(grown("--growth-rate", "4.0", "--initial-population", "100").outputs.tables)
    assert verdict.judgement == "fail"
    assert verdict.reason == "1116, 12 % above the capacity of 1000"


def test_exponential_growth_knows_no_capacity(grown):
    arguments = ("--growth-rate", "1.0", "--initial-population", "10", "--model", "exponential", "--steps", "10")
    table = grown(*arguments).outputs.tables["growth"]
    np.testing.assert_allclose(table["population"], 10.0 * 1.5 ** np.arange(11))


def test_a_population_of_nobody_is_no_population(grown):
    record = grown("--growth-rate", "1.0", "--initial-population", "0")
    assert "found --initial-population 0; more than 0" in record.logs[0].text
    assert judged(record.outputs.tables).judgement == "not judged"


def test_a_population_that_is_no_number_fails():
    tables = {"growth": {"t_s": np.arange(3.0), "population": np.array([1.0, -np.inf, np.nan])}}
    assert judged(tables).reason == "the population is -inf at 1 s"


@pytest.mark.parametrize("column", [np.array([]), np.array(["a"])])
def test_a_table_without_numbers_is_not_judged(column):
    verdict = judged({"growth": {"t_s": np.zeros(len(column)), "population": column}})
    assert (verdict.judgement, verdict.reason) == ("not judged", "growth.csv has no rows of numbers")


def driven(scenario, run, overrides):
    """A run of a scenario file's tree, a tick of 0.1 s lasting as long on the host while a program runs."""
    tree = ScenarioTree(scenario, bound(scenario, overrides), process_actions(run))
    try:
        while not tree.ended:
            tree.tick()
            run.wait(0.1)
    finally:
        tree.shutdown()
    return tree


def test_the_scenario_runs_the_program_with_the_parameters_of_its_configuration(tmp_path):
    (scenario,) = read_scenarios(GROWTH / "growth.osc")
    with process_run(ProcessSetup(GROWTH, files_matching(GROWTH, ["growth.py"])), tmp_path) as run:
        tree = driven(scenario, run, {"growth_rate": 4.0, "initial_population": 900})
        record = run.close()
    assert (tree.passed, tree.message) == (True, "")
    assert record.outputs.tables["growth"]["population"][0] == 900.0
    assert judged(record.outputs.tables).reason == "1080, 8 % above the capacity of 1000"


def test_a_program_that_refuses_its_arguments_fails_the_scenario(tmp_path):
    (scenario,) = read_scenarios(GROWTH / "growth.osc")
    with process_run(ProcessSetup(GROWTH, files_matching(GROWTH, ["growth.py"])), tmp_path) as run:
        tree = driven(scenario, run, {"initial_population": "few"})
    assert not tree.passed
    assert "invalid float value: 'few'" in tree.message
