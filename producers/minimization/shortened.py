"""Shorter paths: a start or a goal moves along the route between them."""

import math
from typing import Any

import numpy as np
from shapely.geometry import Point

from vastflow.producers.places.ground import MAP_KEY, Ground, ground_of
from vastflow.producers.places.route import shortest_leg
from vastflow.producers.places.stops import GOAL_KEY, GOALS_KEY, START_KEY
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.obstacle import obstacle_of
from vastflow.sim.model.pose import Pose, pose_of
from vastflow.sim.nav2.parameter_files.chosen import local_outline
from vastflow.sim.nav2.parameter_files.document import DocumentError


def shortened(values: dict[str, Any], key: str, share: float) -> None:
    """Leave a share of the first leg of the path, or of its last one; nothing changes where no route joins the two.

    Obstacles are not looked at, nor how the world differs from the map: the route is the robot's before it knows of them.

    Args:
        key: `start_pose`, which moves toward the first goal; or the key of the goals, of which the last moves back along its leg.

    Raises:
        ValueError: an obstacle stands where the path would begin or end, which would be another failure.
    """
    goals_key = key if key != START_KEY else next(each for each in (GOALS_KEY, GOAL_KEY) if each in values)
    found = values[goals_key]
    stops = [pose_of(each) for each in (values[START_KEY], *(found if goals_key == GOALS_KEY else [found]))]
    first, second = (0, 1) if key == START_KEY else (len(stops) - 2, len(stops) - 1)
    ground = _ground(values)
    along = None if ground is None else _along(ground, stops[first], stops[second])
    if ground is None or along is None:
        return
    pose = along[round((1.0 - share if key == START_KEY else share) * (len(along) - 1))]
    _check_free(values, pose, ground.robot_diameter_m / 2)
    moved = pose.value()
    if key == START_KEY:
        values[START_KEY] = moved
    else:
        values[goals_key] = [*found[:-1], moved] if goals_key == GOALS_KEY else moved


def _ground(values: dict[str, Any]) -> Ground | None:
    content = values.get(MAP_KEY)
    if not isinstance(content, FileContent):
        return None
    try:
        outline = local_outline({key: value for key, value in values.items() if not isinstance(value, list | dict)})
    except DocumentError:  # the run says what is wrong with it
        return None
    return ground_of(content, round(2 * float(np.hypot(*outline.T).max()), 3))


def _along(ground: Ground, start: Pose, end: Pose) -> list[Pose] | None:
    """Poses along the shortest route, the first at its start, each in the direction of the route."""
    cells = [ground.occupancy.cell_of(pose.x_m, pose.y_m) for pose in (start, end)]
    if not (ground.stands(start.x_m, start.y_m) and ground.stands(end.x_m, end.y_m)):
        return None
    leg = shortest_leg(ground, *cells)
    if leg is None or len(leg.cells) < 2:
        return None
    points = [ground.occupancy.center_of(int(row), int(column)) for row, column in leg.cells]
    ahead = max(1, round(0.5 / ground.occupancy.resolution_m))
    last = len(points) - 1
    poses = []
    for k, (x_m, y_m) in enumerate(points):
        i, j = (k, min(k + ahead, last)) if k < last else (max(k - ahead, 0), k)
        yaw_rad = math.atan2(points[j][1] - points[i][1], points[j][0] - points[i][0])
        poses.append(Pose(round(x_m, 3), round(y_m, 3), round(yaw_rad, 3)))
    return poses


def _check_free(values: dict[str, Any], pose: Pose, radius_m: float) -> None:
    entries = [entry for value in values.values() if isinstance(value, list | tuple) for entry in value]
    for entry in entries:
        if isinstance(entry, dict) and "spawn_pose" in entry:
            obstacle = obstacle_of(entry)
            if obstacle.footprint().distance(Point(pose.x_m, pose.y_m)) < radius_m:
                at = f"({pose.x_m:g}, {pose.y_m:g})"
                raise ValueError(f"the path would begin or end at {at}, where {obstacle.name} stands")
