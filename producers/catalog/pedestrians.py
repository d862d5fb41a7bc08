"""The producer of pedestrians that walk about on the map."""

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from vastflow.producers.catalog.crossing import taut_m
from vastflow.producers.catalog.mover import Entries, MoverProducer, NamedParameters
from vastflow.producers.model.configuration import DRAW
from vastflow.producers.model.numbers import Amounts, Count, Flags, NotNegative, Positive, Seed
from vastflow.producers.model.producer import Draws
from vastflow.producers.places.ground import Ground, ground_of, map_of
from vastflow.producers.places.route import LegRequest, draw_leg
from vastflow.producers.places.stops import START_KEY, given_start
from vastflow.sim.model.digest import Value, digest
from vastflow.sim.model.elementary import hypots
from vastflow.sim.model.pose import Pose

MARGIN_M: Final = 0.1
"""Least gap between walls and a person on its route."""
TRIES: Final = 50
"""Routes that are drawn for a person."""


class PedestrianParameters(NamedParameters):
    """Parameters of `PedestrianVariation`."""

    amount: Amounts
    """Number of pedestrians; one value or several. More of them are the fewer and further ones."""
    avoids_robot: Flags = (True,)
    """Whether they walk round the robot, or through it; one value or several."""
    name: Annotated[str, Field(min_length=1)] = "person"
    """Begins their names: `person 1`, `person 2`, …"""
    radius_m: Positive = 0.25
    """Radius of a person (m)."""
    speed: Positive = 1.29
    """Mean of their desired speeds (m/s), drawn for each run."""
    speed_std: NotNegative = 0.19
    """Standard deviation of these (m/s)."""
    route: Positive = 6.0
    """Length of a route (m), by half as much more or less; they walk to and fro on it, and begin anywhere on it in a run."""
    keep_off: NotNegative = 1.0
    """Least distance of routes from the robot's start (m)."""
    count: Count = 1
    """Draws of all routes."""
    seed: Seed = 0
    """Seed of the draws."""


class PedestrianVariation(MoverProducer[PedestrianParameters]):
    """Pedestrians by the social force model, who walk to and fro on routes of their own.

    A route is a shortest path on free ground, pulled taut, and keeps off the robot's start. Other bodies that move are kept.
    """

    Parameters = PedestrianParameters

    stops = (START_KEY,)

    @property
    def factors(self) -> Mapping[str, Sequence[Value]]:
        asked = self.parameters
        return {"amount": asked.amount, "avoids_robot": asked.avoids_robot, DRAW: range(1, asked.count + 1)}

    def maker(self, inputs: Mapping[str, Value], draws: Draws) -> Callable[..., Entries | str]:
        """A route depends on the seed, what is read, its draw, and its number alone."""
        ground = ground_of(map_of(inputs, self.parameters.map_file), 2 * (self.parameters.radius_m + MARGIN_M))
        start = given_start(inputs, START_KEY)

        def people(amount: int, avoids: bool, number: int) -> Entries | str:
            found: list[dict[str, Value]] = []
            for k in range(1, amount + 1):
                route = self._route(ground, start, draws(int(digest({DRAW: number, "person": k})[:16], 16)))
                if route is None:
                    return f"no route for person {k} was found in {TRIES} draws"
                found.append(self._person(k, route, avoids))
            return found

        return people

    def _route(self, ground: Ground, start: Pose | None, rng: np.random.Generator) -> list[list[float]] | None:
        request = LegRequest(self.parameters.route, self.parameters.route / 2, 0.0)
        for _ in range(TRIES if len(ground.cells) else 0):
            row, column = ground.cells[rng.integers(len(ground.cells))].tolist()
            leg = draw_leg(ground, (row, column), request, rng)
            if leg is None:
                continue
            centers_m = ground.occupancy.centers_of(leg.cells)
            if start is None or hypots(*(centers_m - (start.x_m, start.y_m)).T).min() >= self.parameters.keep_off:
                return [[round(x, 6), round(y, 6)] for x, y in taut_m(ground, centers_m).tolist()]
        return None

    def _person(self, k: int, route: list[list[float]], avoids: bool) -> dict[str, Value]:
        asked, waypoints = self.parameters, list[Value]([*route])
        return {
            "name": f"{asked.name} {k}",
            "shape": {"radius_m": asked.radius_m},
            "rule": "pedestrian",
            "waypoints": waypoints,
            "speed_m_s": asked.speed,
            "speed_std_m_s": asked.speed_std,
            "phase_s": 3 * asked.route / asked.speed,
            "avoids_robot": avoids,
        }
