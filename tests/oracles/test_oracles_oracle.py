import pickle
from pathlib import Path

import pytest

from vastflow.oracles.catalog.safety import Safety
from vastflow.oracles.catalog.success import Success
from vastflow.oracles.judgement.conformance import check_oracle
from vastflow.oracles.judgement.oracle import OracleError, known_oracles, oracle_of, oracles_of

OWN = """
from vastflow.oracles.judgement.oracle import Oracle, Parameters


class Limit(Parameters):
    seconds: float = 10.0


class Quick(Oracle[Limit]):
    Parameters = Limit
    metrics = {"time": "s"}

    def judge(self, trace, situation):
        if trace.run.simulated_s <= self.parameters.seconds:
            return self.passed(trace, time=trace.run.simulated_s)
        return self.failed(trace, "too slow", time=trace.run.simulated_s)


class Fine(Oracle[Limit]):
    Parameters = Limit

    def judge(self, trace, situation):
        return self.passed(trace)


class NoOracle:
    pass
"""


def test_shipped_oracles_are_found_by_name() -> None:
    assert {"performance", "safety", "success"} <= set(known_oracles())
    assert isinstance(oracle_of("safety", {}), Safety)


def test_success_judges_first_without_being_asked_for() -> None:
    assert [oracle.name for oracle in oracles_of([("safety", {})])] == ["success", "safety"]


def test_success_takes_its_parameters_where_it_is_asked_for() -> None:
    oracles = oracles_of([("safety", {}), ("success", {"allow_missed": True})])
    assert [oracle.name for oracle in oracles] == ["success", "safety"]
    assert isinstance(oracles[0], Success)
    assert oracles[0].parameters.allow_missed


def test_unknown_oracle_is_answered_with_the_nearest_name() -> None:
    with pytest.raises(OracleError, match=r"no oracle 'saftey'; did you mean 'safety'\?") as caught:
        oracle_of("saftey", {})
    assert [fault.location for fault in caught.value.faults] == [()]


def test_every_wrong_parameter_is_reported_at_its_place() -> None:
    with pytest.raises(OracleError, match="max_deceleration_mps2") as caught:
        oracle_of("safety", {"robot_radius": 0.2, "max_deceleration_mps2": 0})
    faults = {fault.location: fault for fault in caught.value.faults}
    assert set(faults) == {("robot_radius",), ("max_deceleration_mps2",)}
    assert faults["robot_radius",].right == "did you mean 'robot_radius_m'?"
    assert faults["max_deceleration_mps2",].what == "got 0"
    assert faults["max_deceleration_mps2",].right == "input should be greater than 0"


@pytest.fixture
def own_oracle(tmp_path: Path) -> Path:
    (tmp_path / "own.py").write_text(OWN)
    return tmp_path


def test_oracle_of_a_file_is_found_relative_to_the_base(own_oracle: Path) -> None:
    assert oracle_of("own.py:Quick", {"seconds": 3}, own_oracle).parameters.seconds == 3.0


def test_edited_file_gives_the_edited_oracle(own_oracle: Path) -> None:
    before = oracle_of("own.py:Quick", {}, own_oracle)
    (own_oracle / "own.py").write_text(OWN.replace("= 10.0", "= 20.0"))
    assert (before.parameters.seconds, oracle_of("own.py:Quick", {}, own_oracle).parameters.seconds) == (10.0, 20.0)


def test_oracle_of_a_file_can_be_sent_to_another_process(own_oracle: Path) -> None:
    oracle = oracle_of("own.py:Quick", {"seconds": 3}, own_oracle)
    assert pickle.loads(pickle.dumps(oracle)).parameters == oracle.parameters


def test_oracle_that_measures_nothing_need_not_say_so(own_oracle: Path) -> None:
    check_oracle(oracle_of("own.py:Fine", {}, own_oracle))


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("absent.py:Quick", "no file"),
        ("own.py:Slow", "has no class 'Slow'"),
        ("own.py:NoOracle", "is not an oracle"),
    ],
)
def test_what_is_no_oracle_of_a_file_is_refused(own_oracle: Path, name: str, what: str) -> None:
    with pytest.raises(OracleError, match=what):
        oracle_of(name, {}, own_oracle)


def test_file_that_cannot_be_imported_is_a_fault_of_the_request(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("1 / 0")
    with pytest.raises(OracleError, match="can't be imported: ZeroDivisionError"):
        oracle_of("broken.py:Quick", {}, tmp_path)
