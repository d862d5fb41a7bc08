"""Oracle `performance`: how far the path driven is from the best one."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vastflow.oracles.judgment.oracle import Oracle, Parameters
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import NoReference, Trace
from vastflow.sim.model.elementary import hypots


class PerformanceParameters(Parameters):
    """Parameters of `performance`.

    Attributes:
        local_robot_radius_m: r (m); the robot's inscribed radius if not given. The paper's is `robot_radius` of Nav2's local costmap.
        samples: N, points compared.
    """

    local_robot_radius_m: float | None = Field(default=None, gt=0)
    samples: int = Field(default=100, ge=2)


class Performance(Oracle[PerformanceParameters]):
    """Fails where RMSE > L r: the paper's path optimality.

    RMSE = sqrt(1/N Σ |p_i - q_i|²) in m, with p_i on the true trajectory and q_i on the A* reference
    (`vastflow.oracles.observation.observe`), both at fraction i / (N - 1) of their own arc length, i = 0..N-1. L is the reference's
    octile length in m and r the robot's radius in m; the paper compares L r (m²) with RMSE (m)
    as numbers, which is a lax bound and grows with L. Exactly L r passes.

    Every run with a recording is graded, as in the paper. A trajectory that ended early is compared with the
    whole reference, so that what was not driven counts as error; it may still be below the bound near the goal. Whether
    the mission succeeded is what `success` says. Without a reference path a run is not judged.

    Metrics: `rmse` (m), `threshold` (m, the number L r), `reference_length` (m), `length_ratio` (1), length
    of the trajectory over that of the reference.
    """

    Parameters = PerformanceParameters
    metrics: ClassVar[Mapping[str, str]] = {"rmse": "m", "threshold": "m", "reference_length": "m", "length_ratio": "1"}

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        reference = trace.reference
        if isinstance(reference, NoReference):
            return self.not_judged(trace, f"no reference path: {reference.reason}")
        if not reference.length_m > 0:
            return self.not_judged(trace, "the reference path has no length", reference_length=reference.length_m)
        if not len(trace):
            return self.not_judged(trace, "the recording has no rows", reference_length=reference.length_m)
        rmse_m = path_rmse_m(trace.xy_m, reference.points_xy_m, self.parameters.samples)
        threshold = reference.length_m * (self.parameters.local_robot_radius_m or situation.inscribed_radius_m)
        metrics: dict[str, float | None] = {
            "rmse": rmse_m,
            "threshold": threshold,
            "reference_length": reference.length_m,
            "length_ratio": float(arc_lengths_m(trace.xy_m)[-1]) / reference.length_m,
        }
        if round(rmse_m - threshold, 9) > 0:
            reason = f"RMSE {rmse_m:.2f} m to the reference path, more than {threshold:.2f} m"
            return self.failed(trace, reason, **metrics)
        return self.passed(trace, **metrics)


def path_rmse_m(path_xy_m: NDArray[np.float64], other_xy_m: NDArray[np.float64], samples: int) -> float:
    """Root mean squared distance of two polylines (N, 2), (M, 2) at `samples` equal fractions of their arc lengths."""
    apart = resampled(path_xy_m, samples) - resampled(other_xy_m, samples)
    return float(np.sqrt(np.mean(np.sum(apart * apart, axis=1))))


def resampled(path_xy_m: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    """(samples, 2) points at equal fractions of a polyline's arc length, its ends included.

    A polyline without length gives its first point `samples` times.
    """
    along_m = arc_lengths_m(path_xy_m)
    at_m = np.linspace(0.0, along_m[-1], samples)
    return np.column_stack([np.interp(at_m, along_m, path_xy_m[:, axis]) for axis in (0, 1)])


def arc_lengths_m(path_xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) distance along a polyline (N, 2) up to each of its points."""
    return np.asarray(np.r_[0.0, np.cumsum(hypots(*np.diff(path_xy_m, axis=0).T))])
