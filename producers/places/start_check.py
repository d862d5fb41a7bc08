"""The start check: does the robot's own footprint fit where a configuration begins and ends?"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import MultiPoint

from vastflow.producers.model.configuration import Fragment, Partial, RejectedInstance
from vastflow.producers.model.producer import ROOM_KEY, Producer, draws_of, may_list_obstacles
from vastflow.producers.places.ground import touched_cells
from vastflow.producers.places.stops import GOAL_KEY, GOALS_KEY, START_KEY
from vastflow.sim.model.digest import Value, canonical
from vastflow.sim.model.elementary import cos_sin
from vastflow.sim.model.faults import FileError, Got, Problem
from vastflow.sim.model.obstacle import Obstacle, obstacle_of
from vastflow.sim.model.polygon import circumscribed_radius_m
from vastflow.sim.model.pose import Pose, pose_of
from vastflow.sim.model.scenario import DIMENSION_OF_KEY
from vastflow.sim.system.keys import is_of_footprint
from vastflow.sim.system.robot import ROBOT_KEY
from vastflow.sim.system.system import system_of
from vastflow.sim.world.environment import world_files, world_of
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.world import World

LABEL: Final = "start_check"
"""Name of the start check in tables and reports."""
MOST_VALUES: Final = 10_000
"""Values of a producer that are looked at for the largest footprint."""


class StartCheck:
    """Rejects configurations with a start or goal too close to a wall for the local footprint.

    An obstacle that is there from the beginning counts at the start only: whether a goal can be occupied is for the mission to
    tell. A configuration without a world or without poses has nothing to check.
    """

    def __init__(self, family: str, overrides: Mapping[str, Value]) -> None:
        """Prepare to check a family's configurations, whose values `overrides` replace."""
        self._family = family
        self._overrides = overrides
        self._outlines: dict[str, NDArray[np.float64] | None] = {}
        self._known: dict[str, str | None] = {}

    def touched_by(self, producer: Producer[Any]) -> bool:
        """Whether its quantities can depend on a producer's keys."""
        return any(
            may_list_obstacles(key, tag)
            or (tag or DIMENSION_OF_KEY.get(key)) in ("environment", "task")
            or key == START_KEY
            or key.startswith(GOAL_KEY)
            or is_of_footprint(key)
            for key, tag in producer.writes.items()
            if key != ROOM_KEY
        )

    def rejected(self, partial: Partial) -> RejectedInstance | None:
        """Why the robot can't begin or end there; None where it can."""
        partial = replace(partial, values={**partial.values, **self._overrides}) if self._overrides else partial
        files = world_files(partial.values)
        stops = dict(stops_of(partial))
        if not stops or not files:
            return None
        system = {key: value for key, value in partial.values.items() if is_of_footprint(key)}
        standing = [*_standing(partial)] if START_KEY in stops else []
        poses = {key: pose.value() for key, pose in stops.items()}
        content = canonical([files, poses, system, [*map(str, standing)]])
        if content not in self._known and (world := world_of(files)):
            self._known[content] = self._reason(world, stops, system, standing)
        reason = self._known[content]
        inputs: dict[str, Value] = {**dict([*files.items()][:1]), **poses}
        return RejectedInstance(self._family, partial.name, LABEL, reason, {}, inputs) if reason else None

    def _reason(
        self,
        world: World,
        stops: Mapping[str, Pose],
        system: Mapping[str, Value],
        standing: Sequence[Obstacle],
    ) -> str | None:
        walls = world.walls
        for key, pose in stops.items():
            if is_beyond(world, key, pose):
                continue
            if not walls.contains(*walls.cell_of(pose.x_m, pose.y_m)):
                x0, y0, x1, y1 = world.bounds_m
                ground = "the map" if world.map else f"the world, from ({x0:g}, {y0:g}) to ({x1:g}, {y1:g})"
                return f"{key} ({pose.x_m:g}, {pose.y_m:g}) lies outside of {ground}"
            parameters = canonical(dict(system))
            if parameters not in self._outlines:
                self._outlines[parameters] = _outline(system)
            if (outline := self._outlines[parameters]) is None:
                continue
            (c, s), (x, y) = cos_sin(pose.yaw_rad), outline.T
            corners = np.column_stack((c * x - s * y + pose.x_m, s * x + c * y + pose.y_m))
            area = MultiPoint(corners).convex_hull
            into = next((o.name for o in standing if key == START_KEY and area.intersects(o.footprint())), None)
            if walls.occupied[tuple(touched_cells(walls, area).T)].any():
                into = "a wall"
            if into:
                has_body = f"{ROBOT_KEY}.radius" in system or f"{ROBOT_KEY}.polygon" in system
                what = f"{'robot or the ' if has_body else ''}local costmap's footprint"
                reach = f"it reaches {circumscribed_radius_m(outline):.3f} m from its center, into {into}"
                return f"the {what} does not fit at {key} ({pose.x_m:g}, {pose.y_m:g}): {reach}"
        return None


def room_m(values: Mapping[str, Value], producers: Iterable[Producer[Any]]) -> float:
    """Return the greatest distance (m) of a family's outlines from the robot's center, as far as known.

    That is so for what is fixed and for what producers write that read nothing, such as a list of radii.
    """
    widest = {key: value for key, value in values.items() if is_of_footprint(key)}
    for producer in producers:
        keys = [key for key in producer.writes if is_of_footprint(key)]
        if not keys or producer.reads:
            continue
        for item in islice(producer.produce({}, draws_of(producer, {})), MOST_VALUES):
            written = item.values if isinstance(item, Fragment) else {}
            for key in keys:
                if key in written and _size(written[key]) > _size(widest.get(key)):
                    widest[key] = written[key]
    outline = _outline(widest)
    return 0.0 if outline is None else circumscribed_radius_m(outline)


def _outline(system: Mapping[str, Value]) -> NDArray[np.float64] | None:
    try:
        return system_of(system).start_outline
    except FileError:  # the run says what is wrong with it
        return None


def _size(value: Value) -> float:
    """A number, or one as text, as launch files have them; for anything else less than every number."""
    try:
        return float(value) if isinstance(value, int | float | str) else -math.inf
    except ValueError:
        return -math.inf


def stops_of(partial: Partial) -> Iterator[tuple[str, Pose]]:
    """Yield key and pose of the start, the goals and other poses of the task.

    Goals are `goal_pose` and `goal_poses`. One of `goal_pose1` and so on counts if it is tagged as the task's: that they are goals is
    a reading of ours, and a robot that can't reach one of several shows it in the run.
    """
    of_task = (key for key, tag in partial.dimensions.items() if tag == "task")
    for key in dict.fromkeys((START_KEY, GOAL_KEY, GOALS_KEY, *of_task)):
        value = partial.values.get(key)
        if isinstance(value, Mapping):
            yield from _pose(key, value)
        elif isinstance(value, Sequence) and not isinstance(value, str):
            for i, item in enumerate(value):
                yield from _pose(f"{key}[{i}]", item)


def _pose(key: str, value: Value) -> Iterator[tuple[str, Pose]]:
    try:
        yield key, pose_of(value)
    except ValueError:
        return


def _standing(partial: Partial) -> Iterator[Obstacle]:
    """Yield the obstacles present from the start; invalid ones are left to the simulator."""
    for where, entry in partial.obstacles():
        if "spawn_trigger" not in entry:
            with suppress(ValueError):
                yield obstacle_of(entry, where)


def is_beyond(world: World, key: str, pose: Pose) -> bool:
    """Whether a goal lies beyond the bodies of a world without a map, where nothing stands."""
    is_open = world.map is None and world.bodies is not None
    return is_open and key != START_KEY and not world.walls.contains(*world.walls.cell_of(pose.x_m, pose.y_m))


def pose_complaints(
    occupancy: OccupancyMap, stops: Mapping[str, Pose], radius_m: float
) -> Iterator[tuple[str, Problem, str]]:
    """Yield name, problem, and expectation of each pose that a robot of the radius can't reach.

    The robot passes where its center is more than its radius from the center of every wall's cell, over unknown cells as well. A pose
    that is nearer to a wall counts as the nearest place where the robot passes.
    """
    from scipy import ndimage

    cells = {name: occupancy.cell_of(pose.x_m, pose.y_m) for name, pose in stops.items()}
    inside = {name: cell for name, cell in cells.items() if occupancy.contains(*cell)}
    passable = np.ones(occupancy.shape, dtype=np.bool_)
    if occupancy.occupied.any():
        passable = ndimage.distance_transform_edt(~occupancy.occupied) > radius_m / occupancy.resolution_m
    rows, columns = ndimage.distance_transform_edt(~passable, return_distances=False, return_indices=True)
    regions = ndimage.label(passable, np.ones((3, 3)))[0][rows, columns]
    first = next((name for name, cell in inside.items() if not occupancy.occupied[cell]), "")
    for name, pose in stops.items():
        given = f"({pose.x_m:g}, {pose.y_m:g}), which"
        if name not in inside:
            yield name, Got(f"{given} lies outside the map"), "a pose on the map"
        elif occupancy.occupied[cells[name]]:
            yield name, Got(f"{given} lies in a wall"), "a pose off the map's walls"
        elif regions[cells[name]] != regions[cells[first]]:
            robot = f"a robot of {radius_m:g} m radius"
            yield name, Got(f"{given} {robot} can't reach from {first}"), "a pose to which the map has a path"
