"""The oracle `robustness` on hand-computed errors."""

from typing import Any

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.catalog.robustness import full_meters
from vastflow.oracles.judgement.oracle import OracleError, oracle_of
from vastflow.oracles.judgement.verdict import Verdict
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import NoReference, Trace
from vastflow.sim.model.recording import Run

RUN = Run(0, "0", "succeeded", 0, "", 1.0, 1.0, 0, 0)
BASES = ("update", "step", "metre", "mean", "maximum")


def judged(error_mm: Any, localized: Any, x_m: Any = None, **parameters: Any) -> Verdict:
    n = len(error_mm)
    columns = {
        "t_s": np.arange(n) * 0.1,
        "x_m": np.zeros(n) if x_m is None else np.asarray(x_m, dtype=float),
        "y_m": np.zeros(n),
        "localization_error_m": np.asarray(error_mm, dtype=float) * 1e-3,
        "localized": np.asarray(localized, dtype=float),
    }
    oracle = oracle_of("robustness", parameters)
    return oracle.judge(Trace(RUN, columns, NoReference("none is needed")), Situation(None, (), ()))


def measured(verdict: Verdict) -> dict[str, float | None]:
    return {name: metric.value for name, metric in verdict.metrics.items()}


def test_every_basis_is_measured_beside_the_one_that_judges() -> None:
    # Updates at rows 1 and 3; meters are full at rows 2 (1.2 m) and 4 (2.0 m); row 0 is before AMCL's first pose.
    verdict = judged([900, 10, 20, 40, 80], [0, 1, 0, 1, 0], x_m=[0, 0.5, 1.7, 2.4, 2.5])
    assert measured(verdict) == pytest.approx(
        {
            "update": 0.05,
            "step": 0.15,
            "metre": 0.02 + 0.08,
            "mean": 0.0375,
            "maximum": 0.08,
            "updates": 2,
            "threshold": 0.3,
        }
    )
    assert verdict.judgement == "pass"


@each_row(
    ("basis", "reason"),
    [
        ("update", "summed localization error over 2 updates of AMCL 0.050 m, more than 0.01 m"),
        ("step", "summed localization error over time steps 0.150 m, more than 0.01 m"),
        ("metre", "summed localization error over meters driven 0.100 m, more than 0.01 m"),
        ("mean", "mean localization error 0.037 m, more than 0.01 m"),
        ("maximum", "greatest localization error 0.080 m, more than 0.01 m"),
    ],
)
def test_basis_that_judges_is_chosen_in_the_campaign_file(basis: str, reason: str) -> None:
    verdict = judged([0, 10, 20, 40, 80], [0, 1, 0, 1, 0], [0, 0.5, 1.7, 2.4, 2.5], basis=basis, threshold_m=0.01)
    assert (verdict.judgement, verdict.reason) == ("fail", reason)


@each_row(("last_mm", "judgement"), [(100, "pass"), (101, "fail")])
def test_sum_of_exactly_the_threshold_passes(last_mm: int, judgement: str) -> None:
    # As floating-point numbers 0.1 + 0.1 + 0.1 is more than 0.3.
    assert judged([100, 100, last_mm], [1, 1, 1], basis="update").judgement == judgement


@each_row("seconds", [1, 10, 100])
def test_longer_run_with_the_same_errors_is_judged_alike(seconds: int) -> None:
    assert judged([50, 300] * 5 * seconds, [1, 1] * 5 * seconds).judgement == "pass"
    assert judged([50, 301] * 5 * seconds, [1, 1] * 5 * seconds).judgement == "fail"


@each_row("basis", BASES)
@each_row(("error_mm", "judgement"), [(300, "pass"), (301, "fail")])
def test_single_sample_is_its_own_sum_mean_and_maximum(basis: str, error_mm: int, judgement: str) -> None:
    verdict = judged([0, error_mm], [0, 1], x_m=[0, 0], basis=basis)
    expected = "pass" if basis == "metre" else judgement  # no meter is full
    assert verdict.judgement == expected


def test_robot_that_never_moves_has_no_meter() -> None:
    verdict = judged([50] * 40, [1] + [0] * 39)
    assert (measured(verdict)["metre"], measured(verdict)["update"]) == (0.0, 0.05)


def test_recording_without_rows_is_not_judged_and_keeps_its_metrics() -> None:
    verdict = judged([], [])
    assert (verdict.judgement, verdict.reason) == ("not judged", "the recording has no rows")
    assert measured(verdict) == {**dict.fromkeys((*BASES, "updates")), "threshold": 0.3}


def test_robot_that_was_never_localized_is_not_judged() -> None:
    verdict = judged([10, 10], [0, 0])
    assert (verdict.judgement, verdict.reason) == ("not judged", "AMCL published no pose")
    assert measured(verdict)["updates"] == 0


def test_trace_without_the_signal_is_not_judged() -> None:
    trace = Trace(RUN, {"t_s": np.zeros(2)}, NoReference("none is needed"))
    verdict = oracle_of("robustness", {}).judge(trace, Situation(None, (), ()))
    assert verdict.reason == "the trace has no localization_error_m and no localized"


def test_basis_that_does_not_exist_is_refused() -> None:
    with pytest.raises(OracleError, match="'update', 'step', 'metre', 'mean' or 'maximum'"):
        oracle_of("robustness", {"basis": "second"})


def test_full_meters_are_counted_along_the_way() -> None:
    xy_m = np.column_stack(([0.0, 0.6, 0.6, 0.6, 0.6], [0.0, 0.0, 0.4, 0.4, 2.6]))
    np.testing.assert_array_equal(full_meters(xy_m), [2, 4, 4])  # lengths 0, 0.6, 1.0, 1.0, 3.2
    assert full_meters(xy_m[:2]).size == 0
