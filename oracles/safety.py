"""Oracle `safety`: the separation kept from obstacles."""

import math
from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from vastflow.oracles.oracle import Oracle, Parameters
from vastflow.oracles.situation import Situation
from vastflow.oracles.trace import Trace
from vastflow.oracles.verdict import Verdict
from vastflow.oracles.whereabouts import whereabouts_of
from vastflow.sim.obstacle import Obstacle


class SafetyParameters(Parameters):
    """Parameters of `safety`; the defaults are the paper's TurtleBot 4.

    Attributes:
        robot_radius_m: Radius of the robot (m).
        max_speed_mps: v, its greatest speed (m/s).
        max_deceleration_mps2: a, its greatest deceleration (m/s²).
    """

    robot_radius_m: float = Field(default=0.15, ge=0)
    max_speed_mps: float = Field(default=0.5, ge=0)
    max_deceleration_mps2: float = Field(default=2.5, gt=0)


class Safety(Oracle[SafetyParameters]):
    """Fails where the robot ever comes closer to an obstacle than it could stop within: the paper's criterion.

    d_min = r_obstacle + r_robot + v²/(2a), all in m, between centres, with r_obstacle the greatest distance from
    the obstacle's centre to its outline in the plane. 0.5 m cube: 0.354 + 0.15 + 0.05 = 0.554 m; 0.8 m cube:
    0.766 m. Separation is taken at the recording's rows, from where the obstacles are then; one that appears counts from
    then on, and one that is pushed where it was pushed to. A run without obstacles passes. Contacts are counted, those with
    walls too, and are no criterion of their own: one with an obstacle is closer than d_min anyway.

    Metrics: `smallest_separation` (m), between centres; `margin` (m), the smallest of separation - d_min over
    all obstacles; `contacts` (1). The first two have no value where no obstacle was ever there.
    """

    Parameters = SafetyParameters
    metrics: ClassVar[Mapping[str, str]] = {"smallest_separation": "m", "margin": "m", "contacts": "1"}

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        contacts = float(sum(event.kind == "contact" for event in trace.run.events))
        obstacles = [whereabouts.obstacle for whereabouts in whereabouts_of(situation, trace.run)]
        if obstacles and not len(trace):
            return self.not_judged(trace, "the recording has no rows", contacts=contacts)
        closest = {o.size_class: o for o in obstacles}  # of one class, so one required separation
        smallest_m = {name: float(trace[f"separation_m/{name}"].min()) for name in closest}
        separation_m = {name: apart_m for name, apart_m in smallest_m.items() if apart_m < math.inf}
        if not separation_m:
            return self.passed(trace, contacts=contacts)
        margin_m = {name: apart_m - self.required_m(closest[name]) for name, apart_m in separation_m.items()}
        worst = min(margin_m, key=lambda name: margin_m[name])
        metrics = {
            "smallest_separation": min(separation_m.values()),
            "margin": margin_m[worst],
            "contacts": contacts,
        }
        if margin_m[worst] < 0:
            required_m = self.required_m(closest[worst])
            reason = f"{separation_m[worst]:.3f} m from the centre of a {worst}, less than {required_m:.3f} m"
            return self.failed(trace, reason, **metrics)
        return self.passed(trace, **metrics)

    def required_m(self, obstacle: Obstacle) -> float:
        """d_min (m) between the centres of robot and `obstacle`."""
        p = self.parameters
        return obstacle.circumradius_m + p.robot_radius_m + p.max_speed_mps**2 / (2 * p.max_deceleration_mps2)
