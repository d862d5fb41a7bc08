import json
import pickle
from functools import partial

import numpy as np
import pytest

from vastflow.oracles.judgment.registry import oracles_of
from vastflow.oracles.judgment.verdict import read_verdicts
from vastflow.producers.catalog.parameter import ParameterVariationList
from vastflow.sim import run as simulator
from vastflow.sim.model.blocks import read_recordings
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.recording import Recording, Run, RunLog
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.run import Execution
from vastflow.tasks.engine import work
from vastflow.tasks.engine.evaluation import packed, read_evaluation
from vastflow.tasks.engine.work import Broken, Executed, answered
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.store import StoreError, open_store

POSE = {"position": {"x": 0.0, "y": 0.0}, "orientation": {"yaw": 0.0}}
SCENARIO = Scenario("builtin:navigate_to_pose", 60.0, {}, {"start_pose": POSE, "goal_pose": POSE}, {})
COLUMNS = [
    "t_ms",
    "x_mm",
    "y_mm",
    "yaw_mrad",
    "estimated_x_mm",
    "estimated_y_mm",
    "estimated_yaw_mrad",
    "speed_mmps",
    "yaw_rate_mradps",
    "command_speed_mmps",
    "command_yaw_rate_mradps",
    "localized",
]


def recording(run_index):
    columns = {name: np.arange(3, dtype=np.int32) for name in COLUMNS}
    return Recording(Run(run_index, "0", "succeeded", 0, "", 10.0 + run_index, 5.0, 0, 0), columns)


@pytest.fixture
def store(tmp_path):
    return open_store(tmp_path / "store")


@pytest.fixture
def simulate(monkeypatch):
    """Replace the simulator; runs in the set break."""

    def replace(breaking=()):
        def execute(scenario, run_index, seed=0):
            if run_index in breaking:
                raise ValueError(f"run {run_index}\nbroke")
            return Execution(recording(run_index), RunLog(0.0, 0.5, 0.25, 1000, ("1.0 s: begun",)))

        monkeypatch.setattr(simulator, "execute", execute)

    return replace


def test_consecutive_runs_are_one_block(store, simulate):
    simulate()
    executed = work.execute(store, "execute/ab/key", SCENARIO, 2, 5, 0)
    assert executed.simulated_s == {2: 12.0, 3: 13.0, 4: 14.0}
    assert store.under("execute/ab/key") == ("2-5",)
    found = read_recordings(store.read("execute/ab/key/2-5", work.RECORDINGS))
    assert [each.run.run_index for each in found] == [2, 3, 4]


def test_stored_block_of_lost_worker_is_not_rerun(store, simulate):
    simulate()
    first = work.execute(store, "execute/k", SCENARIO, 0, 2, 0)
    simulate(breaking={0, 1})
    assert work.execute(store, "execute/k", SCENARIO, 0, 2, 0) == first


def test_broken_run_is_reported_and_others_are_stored(store, simulate):
    simulate(breaking={1})
    executed = work.execute(store, "execute/ab/key", SCENARIO, 0, 4, 0)
    assert executed.broken == {1: Broken("ValueError: run 1 broke")}
    assert sorted(executed.simulated_s) == [0, 2, 3]
    assert store.under("execute/ab/key") == ("0-1", "2-4")


def test_block_bytes_are_independent_of_batch(store, simulate):
    simulate()
    work.execute(store, "execute/ab/one", SCENARIO, 1, 2, 0)
    work.execute(store, "execute/ab/two", SCENARIO, 1, 2, 7)
    one, two = (store.find(f"execute/ab/{key}/1-2").content for key in ("one", "two"))
    assert one == two


def test_run_log_has_costs_and_is_in_no_digest(store, simulate):
    simulate()
    work.execute(store, "execute/ab/key", SCENARIO, 0, 2, 0)
    log = json.loads((store.local / "execute/ab/key/0-2" / work.RUN_LOG).read_text())
    assert [(run["run_index"], run["cpu_s"], run["lines"]) for run in log["runs"]] == [
        (0, 0.25, ["1.0 s: begun"]),
        (1, 0.25, ["1.0 s: begun"]),
    ]
    assert work.RUN_LOG not in store.find("execute/ab/key/0-2").files


def test_producer_error_is_returned(capsys):
    assert answered(int, "x") == Broken("ValueError: invalid literal for int() with base 10: 'x'")
    assert "Traceback" in capsys.readouterr().err


def test_impossible_scenario_has_no_traceback_and_stores_nothing(store, monkeypatch, capsys):
    def execute(scenario, run_index, seed=0):
        raise ScenarioError("the robot was never given a goal")

    monkeypatch.setattr(simulator, "execute", execute)
    executed = work.execute(store, "execute/ab/key", SCENARIO, 0, 2, 0)
    assert executed == Executed({}, dict.fromkeys((0, 1), Broken("the robot was never given a goal")))
    assert store.under("execute/ab/key") == ()
    assert capsys.readouterr().err == ""


def test_lost_input_is_reported_separately(store):
    answer = answered(work.observe, store, "execute/ab/gone/0-2", "observe/ab/key", SCENARIO)
    assert answer is None


def test_judging_stores_overall_judgments(store, simulate):
    simulate()
    work.execute(store, "execute/ab/key", SCENARIO, 0, 2, 0)
    work.observe(store, "execute/ab/key/0-2", "observe/ab/key", SCENARIO)
    oracles = partial(oracles_of, [])
    keyed = {"success": "s" * 64}
    work.judge(store, "execute/ab/key/0-2", "observe/ab/key", "judge/ab/key", SCENARIO, oracles, keyed)
    found = store.find("judge/ab/key").info
    assert found == {"runs": [[0, "pass"], [1, "pass"]], "causes": [], "oracles": keyed}
    assert [verdict.run_index for verdict in read_verdicts(store.read("judge/ab/key", work.VERDICTS))] == [0, 1]


def test_oracle_that_cannot_be_unpickled_is_reported(store, simulate):
    simulate()
    work.execute(store, "execute/ab/key", SCENARIO, 0, 1, 0)
    work.observe(store, "execute/ab/key/0-1", "observe/ab/key", SCENARIO)
    answer = answered(
        work.judge,
        store,
        "execute/ab/key/0-1",
        "observe/ab/key",
        "judge/ab/key",
        SCENARIO,
        partial(pickle.loads, b"junk"),
        {},
    )
    assert isinstance(answer, Broken)


def test_evaluation_is_stored(store):
    parameters = ParameterVariationList.Parameters(name="noise", values=[0.0, 0.1])
    work.evaluate(store, "evaluate/ab/key", packed(ParameterVariationList(parameters)), {})
    fragments = read_evaluation(store.read("evaluate/ab/key", "fragments.json"), {})
    assert [dict(fragment.values) for fragment in fragments] == [{"noise": 0.0}, {"noise": 0.1}]


def test_unusable_store_is_an_error(store):
    def put():
        raise StoreError("store: the disk is full")

    with pytest.raises(StoreError, match="the disk is full"):
        answered(put)


def test_whole_unit_goes_through_all_stages(store, simulate):
    simulate(breaking={1})
    keys, oracles = Keys("numeric", "e", "o", "j", 0, []), partial(oracles_of, [])
    computed = work.compute(store, keys, "checked", SCENARIO, 0, 4, oracles)
    assert (sorted(computed.simulated_s), list(computed.broken)) == ([0, 2, 3], [1])
    assert [each.key.partition("/")[0] for each in computed.artifacts] == ["execute", "observe", "judge"] * 2
    simulate(breaking=range(4))
    assert work.compute(store, keys, "checked", SCENARIO, 2, 4, oracles).artifacts == computed.artifacts[3:]


def test_whole_unit_leaves_broken_judgment_to_judge_stage(store, simulate):
    simulate()
    keys = Keys("numeric", "e", "o", "j", 0, [])
    computed = work.compute(store, keys, "checked", SCENARIO, 0, 2, partial(pickle.loads, b"junk"))
    assert [each.key.partition("/")[0] for each in computed.artifacts] == ["execute", "observe"]
    assert (list(computed.simulated_s), computed.broken) == ([0, 1], {})
