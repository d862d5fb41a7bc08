"""Oracle `robustness`: how far the robot is from where it believes it is."""

from collections.abc import Mapping
from typing import ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vastflow.oracles.catalog.performance import arc_lengths_m
from vastflow.oracles.judgment.oracle import Oracle, Parameters
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import Trace

DEFAULT_BASIS: Final = "maximum"

_WORDS: Final[Mapping[str, str]] = {
    "update": "summed localization error over {updates:.0f} updates of AMCL",
    "step": "summed localization error over time steps",
    "metre": "summed localization error over meters driven",
    "mean": "mean localization error",
    "maximum": "greatest localization error",
}


class RobustnessParameters(Parameters):
    """Parameters of `robustness`.

    Attributes:
        threshold_m: The error that a run may have (m); the paper takes the robot's diameter.
        basis: Which of the metrics is compared with it. The paper sums over a run and does not say over what.
    """

    threshold_m: float = Field(default=0.3, gt=0)
    basis: Literal["update", "step", "metre", "mean", "maximum"] = DEFAULT_BASIS


class Robustness(Oracle[RobustnessParameters]):
    """Fails if a run's localization error exceeds `threshold_m`, the measurable reading of the paper's criterion.

    e is the distance between the estimated and the true position in m, from AMCL's first pose on. The paper sums e "over the run"
    and leaves open over which samples. All readings are measured, and `basis` names the one that judges:

    - `maximum` (default): the greatest e over time steps, the recording's rows, one each 0.1 s.
    - `mean`: of e over time steps.
    - `update`: Σ e over AMCL's updates. AMCL corrects the pose, and publishes it on `/amcl_pose`, only after 0.25 m or 0.2 rad
      of motion; that topic is the estimate among those that scenarios of this kind record.
    - `step`: Σ e over time steps. It grows with the rate of the samples.
    - `metre`: Σ e over each full meter driven, at the first row at which it is full.

    The robot's diameter bounds an error at an instant: beyond it, the robot is not where it believes any part of it to be. It says
    nothing of a sum, which grows with the path and with the rate of the samples: with 100 updates, 0.3 m is a mean error of 3 mm. So the
    default is the reading that depends on neither.

    An error equal to the threshold passes: all are compared to the micrometer, and a sum of millimeters is exact.

    A run without a robot, rows, or a pose from AMCL is not judged.

    Metrics: the five, in m, under their names; `updates` (1), their number, the first pose among them; `threshold` (m).
    """

    Parameters = RobustnessParameters
    metrics: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("update", "step", "metre", "mean", "maximum", "threshold"), "m"),
        "updates": "1",
    }

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        basis, threshold_m = self.parameters.basis, self.parameters.threshold_m
        if not len(trace):
            return self.not_judged(trace, "the recording has no rows", threshold=threshold_m)
        if missing := [name for name in ("localization_error_m", "localized") if name not in trace.columns]:
            return self.not_judged(trace, f"the trace has no {' and no '.join(missing)}", threshold=threshold_m)
        localized = np.flatnonzero(trace["localized"] > 0)
        if not localized.size:
            return self.not_judged(trace, "AMCL published no pose", updates=0, threshold=threshold_m)
        since = int(localized[0])
        error_m, xy_m = trace["localization_error_m"][since:], trace.xy_m[since:]
        metrics: dict[str, float | None] = {
            "update": _total_m(trace.update_errors_m),
            "step": _total_m(error_m),
            "metre": _total_m(error_m[full_meters(xy_m)]),
            "mean": round(float(error_m.mean()), 6),
            "maximum": float(error_m.max()),
            "updates": localized.size,
            "threshold": threshold_m,
        }
        measured_m = metrics[basis]
        assert measured_m is not None
        if measured_m > threshold_m:
            what = _WORDS[basis].format(**metrics)
            return self.failed(trace, f"{what} {measured_m:.3f} m, more than {threshold_m:g} m", **metrics)
        return self.passed(trace, **metrics)


def full_meters(xy_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """Indices of the points of a path (N, 2) at which its first, second, … meter is full."""
    along_m = np.round(arc_lengths_m(xy_m), 6)
    return np.searchsorted(along_m, np.arange(1, int(along_m[-1]) + 1))


def _total_m(errors_m: NDArray[np.float64]) -> float:
    return round(float(errors_m.sum()), 6)
