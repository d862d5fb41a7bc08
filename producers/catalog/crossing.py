"""The producer of a body that crosses the robot's path."""

import itertools
import math
from collections.abc import Callable, Mapping
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vastflow.producers.catalog.mover import BodyParameters, Entries, MoverProducer
from vastflow.producers.model.numbers import DEFAULT_ROBOT_DIAMETER_M, NotNegative, Numbers, Positive, Positives
from vastflow.producers.model.producer import Draws
from vastflow.producers.places.clearance import taut
from vastflow.producers.places.ground import Ground, ground_of, map_of
from vastflow.producers.places.placement import MARGIN_M, Line
from vastflow.producers.places.route import corners
from vastflow.producers.places.stops import GOAL_KEY, GOALS_KEY, START_KEY, given_goals, given_start
from vastflow.sim.model.digest import Value
from vastflow.sim.model.elementary import cos_sin, dist, hypot

HEADING_M: Final = 1.0
"""Length of the path on either side of an encounter that gives its direction there."""
_STEP: Final = 0.5
"""Cells between the points of a straight line that are examined."""


class CrossingParameters(BodyParameters):
    """Parameters of `CrossingVariation`."""

    name: Annotated[str, Field(min_length=1)] = "crossing"
    """Name of the body."""
    encounter_s: Positives
    """Time of the run at which the body is on the robot's path, where the robot is then; one value or several."""
    angle_deg: Numbers = (90.0,)
    """Direction of its motion from the direction of the path there: 0 along with the robot, 90 from its right, 180 toward it, -90 from its left; one value or several."""
    speed: Positives = (1.0,)
    """Its speed (m/s); one value or several."""
    late_s: Numbers = (0.0,)
    """Time by which it comes after the robot, or before it where negative (s); one value or several."""
    robot_speed: Positive = 0.5
    """Speed at which the robot is expected to follow its path (m/s)."""
    departure_s: NotNegative = 0.0
    """Time of the run at which the robot is expected to set out (s)."""
    run_up: Positive = 1.5
    """Least free distance before the encounter in which it comes (m)."""
    robot_diameter: Positive = DEFAULT_ROBOT_DIAMETER_M
    """Diameter of the robot that finds the path (m)."""


class CrossingVariation(MoverProducer[CrossingParameters]):
    """A body at constant velocity that meets the robot on its path, at a time and an angle.

    It does not react to the robot.
    The path is the shortest one from start to goals, pulled taut, and the robot is expected on it at `robot_speed` from `departure_s`
    on. The body comes and goes on a straight line through that place, as far as the ground is free for it, and stands at both ends
    before and after. Other bodies that move are kept.
    """

    Parameters = CrossingParameters
    names = ("encounter_s", "angle_deg", "speed", "late_s")

    stops = (START_KEY, GOAL_KEY, GOALS_KEY)

    def maker(self, inputs: Mapping[str, Value], draws: Draws) -> Callable[..., Entries | str] | str:
        asked = self.parameters
        try:
            map_file = map_of(inputs, asked.map_file)
            line = robot_path(inputs, ground_of(map_file, asked.robot_diameter))
        except ValueError as error:
            return str(error)
        ground = ground_of(map_file, asked.diameter_m)

        def body(*values: float) -> Entries | str:
            motion = self._motion(line, ground, *values)
            return motion if isinstance(motion, str) else [{"name": asked.name, "shape": {**asked.shape}, **motion}]

        return body

    def _motion(
        self, line: Line, ground: Ground, encounter_s: float, angle_deg: float, speed: float, late_s: float
    ) -> dict[str, Value] | str:
        """Return the values of the body's motion, or the reason why there is none."""
        asked = self.parameters
        along_m, length_m = (encounter_s - asked.departure_s) * asked.robot_speed, float(line.along_m[-1])
        if not 0.0 < along_m < length_m:
            return f"the robot is {along_m:.2f} m along its path at {encounter_s:g} s, and the path is {length_m:.2f} m long"
        x_m, y_m = point_at(line, along_m)
        (x0, y0), (x1, y1) = (point_at(line, along_m + at_m) for at_m in (-HEADING_M, HEADING_M))
        chord_m = hypot(x1 - x0, y1 - y0)
        if chord_m < ground.occupancy.resolution_m:
            return f"the robot's path turns back at {encounter_s:g} s, and has no direction there"
        c, s = cos_sin(math.radians(angle_deg))
        ahead = (x1 - x0) / chord_m, (y1 - y0) / chord_m
        toward = c * ahead[0] - s * ahead[1], s * ahead[0] + c * ahead[1]
        there_s = encounter_s + late_s
        run_up_m = min(free_m(ground, (x_m, y_m), (-toward[0], -toward[1])), there_s * speed)
        if run_up_m < asked.run_up:
            return (
                f"at {encounter_s:g} s and {angle_deg:g} degrees the body has {run_up_m:.2f} m to the robot's path, "
                f"and run_up is {asked.run_up:g} m"
            )
        begin = x_m - run_up_m * toward[0], y_m - run_up_m * toward[1]
        if dist(begin, point_at(line, 0.0)) < ground.robot_diameter_m / 2 + asked.robot_diameter / 2 + MARGIN_M:
            return f"at {encounter_s:g} s, {angle_deg:g} degrees, {speed:g} m/s the body begins where the robot does"
        beyond_m = max(free_m(ground, (x_m, y_m), toward), ground.occupancy.resolution_m)
        ends = [[round(x_m + at_m * toward[0], 6), round(y_m + at_m * toward[1], 6)] for at_m in (-run_up_m, beyond_m)]
        return {"waypoints": ends, "speed_m_s": speed, "start_s": round(there_s - run_up_m / speed, 6)}


def robot_path(inputs: Mapping[str, Value], ground: Ground) -> Line:
    """Return the robot's shortest path from start to goals, pulled taut.

    Raises:
        ValueError: there is none.
    """
    from vastflow.sim.world import octile

    start = given_start(inputs, START_KEY)
    goals = given_goals(inputs, GOALS_KEY) or given_goals(inputs, GOAL_KEY)
    if start is None or not goals:
        raise ValueError(f"there is no path to cross: no {START_KEY} with {GOAL_KEY} or {GOALS_KEY} was written before")
    points: list[NDArray[np.float64]] = []
    for one, other in itertools.pairwise([start, *goals]):
        stops = np.array([(one.x_m, one.y_m), (other.x_m, other.y_m)])
        path = octile.shortest_path(ground.occupancy, ground.passable, stops)
        if path is None:
            raise ValueError(f"there is no path from the start to the goals for {ground.robot_text}")
        points.append(taut_m(ground, path[0]))
    return Line.along(np.concatenate(points))


def taut_m(ground: Ground, path_xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners (M, 2) of a path (N, 2) pulled taut; both are centers of cells (m)."""
    cells = np.floor(ground.occupancy.in_cells(path_xy_m)).astype(np.int64)
    return ground.occupancy.centers_of(taut(corners(cells), ground.passable))


def point_at(line: Line, along_m: float) -> tuple[float, float]:
    """Return the point at a distance along a line; its nearest end beyond them."""
    x_m, y_m = (float(np.interp(along_m, line.along_m, axis)) for axis in line.corners_m.T)
    return x_m, y_m


def free_m(ground: Ground, begin: tuple[float, float], toward: tuple[float, float]) -> float:
    """Return the length (m) of the straight line from a point on which the ground is passable."""
    step_m = _STEP * ground.occupancy.resolution_m
    rows, columns = ground.occupancy.shape
    most = 2 * (rows + columns)
    points = np.array(begin) + step_m * np.arange(most + 1)[:, None] * np.array(toward)
    cells = np.floor(ground.occupancy.in_cells(points)).astype(np.int64)
    inside = np.all((cells >= 0) & (cells < (rows, columns)), axis=1)
    free = inside.copy()
    free[inside] = ground.passable[tuple(cells[inside].T)]
    return max(int(np.argmin(free)) - 1, 0) * step_m  # the last point lies beyond the map
