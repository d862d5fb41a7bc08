"""Pedestrians: bodies that walk by the social force model."""

import itertools
import math
from typing import Annotated, Final, Literal, Self

import numpy as np
from pydantic import Field

from vastflow.sim.model.elementary import dist, normals
from vastflow.sim.model.parameter import parameter
from vastflow.sim.world.mover import MoverRule
from vastflow.sim.world.waypoints import Point, Route

SLOWEST_MPS: Final = 0.1


class Pedestrian(MoverRule):
    """A person that walks from waypoint to waypoint, and keeps off walls, others, and, as asked, the robot.

    The speed's mean and standard deviation are those of Moussaïd and others (2009), see `vastflow.sim.world.social_force`.

    Attributes:
        waypoints: (x, y) in the map's frame (m); at a single one it stands.
        speed_m_s: Mean of the desired speed.
        speed_std_m_s: Standard deviation of the desired speed, which is drawn for each run.
        loop: As of `vastflow.sim.world.waypoints.Waypoints`; it turns where it goes back.
        phase_s: Greatest time of walking by which it is ahead of the first waypoint at the start, drawn for each run.
        avoids_robot: Whether the robot is a pedestrian to it, or nothing.
    """

    waypoints: Annotated[Route, Field(min_length=1)]
    speed_m_s: float = parameter(1.29, SLOWEST_MPS, 10.0)
    speed_std_m_s: float = parameter(0.19, 0.0, 10.0)
    loop: Literal["once", "back_and_forth", "around"] = "back_and_forth"
    phase_s: float = parameter(0.0, 0.0, 1e6)
    avoids_robot: bool = True

    def drawn(self, rng: np.random.Generator) -> Self:
        speed_m_s = self.speed_m_s + self.speed_std_m_s * float(normals(rng, (1,), np.float64)[0])
        phase_s = self.phase_s * rng.random()
        return self.model_copy(update={"speed_m_s": max(speed_m_s, SLOWEST_MPS), "phase_s": phase_s})

    @property
    def is_cyclic(self) -> bool:
        return self.loop != "once" and len(self.waypoints) > 1

    @property
    def points(self) -> tuple[Point, ...]:
        """Waypoints in the order in which they are walked to, each round once."""
        return self.waypoints + (self.waypoints[-2:0:-1] if self.loop == "back_and_forth" else ())

    def begin(self) -> tuple[Point, int]:
        """Return the place at the start, and the index of the point that it walks to first."""
        points, ahead_m = self.points, self.phase_s * self.speed_m_s
        legs = [*itertools.pairwise([*points, *points[: 1 if self.is_cyclic else 0]])]
        if self.is_cyclic:
            ahead_m = math.fmod(ahead_m, math.fsum(dist(*leg) for leg in legs))
        for k, (here, there) in enumerate(legs):
            if ahead_m < (length_m := dist(here, there)):
                share = ahead_m / length_m
                place = here[0] + share * (there[0] - here[0]), here[1] + share * (there[1] - here[1])
                return place, (k + 1) % len(points)
            ahead_m -= length_m
        return points[-1], len(points) - 1
