"""The site of obstacles in a configuration: its map, its path, and obstacles that stand there already."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from vastflow.producers.model.configuration import REQUESTED, Rejection
from vastflow.producers.model.producer import ROOM_KEY
from vastflow.producers.places.cells import shortest_path
from vastflow.producers.places.clearance import shortest_path_properties
from vastflow.producers.places.ground import ground_of, map_key, map_of, room_of
from vastflow.producers.places.placement import Site
from vastflow.producers.places.stops import (
    GOAL_KEY,
    GOALS_KEY,
    PATH_KEY,
    PATH_LENGTH_KEY,
    START_KEY,
    given_goals,
    given_start,
    goals_key,
    start_key,
)
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.obstacle import Obstacle, obstacle_of
from vastflow.sim.model.pose import Pose

LIST_KEY: Final = "static_objects"
"""The usual key of a list of obstacles."""
LISTS_KEY: Final = "_obstacles"
"""Key to list of the obstacles that producers placed so far, for those that place more."""


@dataclass(frozen=True, slots=True)
class SiteRequest:
    """The inputs of a producer of obstacles.

    Attributes:
        name: Key of the list that it writes. What is in there already stays.
        start, goals: Keys of the path's ends, or the poses themselves.
    """

    name: str
    map_file: FileContent | str | None
    robot_diameter_m: float
    start: str | Pose = START_KEY
    goals: str | tuple[Pose, ...] = GOALS_KEY

    @property
    def reads(self) -> tuple[str, ...]:
        """The keys of the map, the path, start and goals, and of the lists of obstacles that are there already."""
        stops = (start_key(self.start), goals_key(self.goals), GOAL_KEY, GOALS_KEY)
        lists = (LISTS_KEY, LIST_KEY, self.name)
        return tuple(dict.fromkeys((map_key(self.map_file), ROOM_KEY, PATH_KEY, PATH_LENGTH_KEY, *stops, *lists)))

    def site(self, inputs: Mapping[str, Value]) -> Site | str:
        """Return the site, or why there is no path or an obstacle can't be read."""
        map_file = map_of(inputs, self.map_file)
        if isinstance(map_file, Rejection):
            return map_file.reason
        try:
            start = given_start(inputs, self.start)
            goals = next(filter(None, (given_goals(inputs, key) for key in (self.goals, GOALS_KEY, GOAL_KEY))), ())
            standing = _standing(self._lists(inputs))
        except ValueError as error:
            return str(error)
        ground = ground_of(map_file, self.robot_diameter_m, room_of(inputs))
        stops = [(pose.x_m, pose.y_m) for pose in ((start, *goals) if start is not None and goals else ())]
        for stop in stops:
            if not ground.occupancy.contains(*ground.occupancy.cell_of(*stop)):
                return f"the start or a goal, ({stop[0]:g}, {stop[1]:g}), lies beyond the map"
        given = isinstance(self.start, Pose) or isinstance(self.goals, tuple)
        if PATH_KEY in inputs and PATH_LENGTH_KEY in inputs and not given:
            path_xy_m, length_m = np.array(inputs[PATH_KEY], dtype=np.float64), float(inputs[PATH_LENGTH_KEY])  # type: ignore[arg-type]
            stops = stops or [tuple(path_xy_m[0]), tuple(path_xy_m[-1])]
            return Site(ground, path_xy_m, length_m, stops, standing)
        if not stops:
            return f"there is no path to place obstacles at: no {START_KEY} with {GOAL_KEY} or {GOALS_KEY} was written before"
        path = shortest_path(ground.occupancy, ground.passable, np.array(stops))
        if path is None:
            return f"there is no path from the start to the goals for a robot {ground.robot_diameter_m:g} m across"
        return Site(ground, *path, stops, standing)

    def written(
        self, inputs: Mapping[str, Value], site: Site, entries: Sequence[Value], requested: Mapping[str, Value]
    ) -> dict[str, Value]:
        """Return the list with `entries` at its end, notes on it and on `requested`, and the path's surroundings."""
        lists = self._lists(inputs)
        mine = [*lists.get(self.name, ()), *entries]
        placed = _standing({self.name: list(entries)})
        is_known = PATH_KEY in inputs and not placed and not site.standing
        around = {} if is_known else shortest_path_properties(site, placed)
        # A second producer of the same list does not overwrite what was requested of the first.
        note = f"{REQUESTED}{self.name}{'+' if self.name in lists else ''}"
        return {self.name: mine, LISTS_KEY: {**lists, self.name: mine}, note: {**requested}, **around}

    def _lists(self, inputs: Mapping[str, Value]) -> dict[str, list[Value]]:
        noted = inputs.get(LISTS_KEY)
        found = dict(noted) if isinstance(noted, Mapping) else {}
        found |= {key: inputs[key] for key in (LIST_KEY, self.name) if key in inputs}
        return {key: _list_of(entries, key) for key, entries in found.items()}


def _list_of(value: Value, key: str) -> list[Value]:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return list(value)
    raise ValueError(f"{key}: expected a list of obstacles, got {value!r}")


def _standing(lists: Mapping[str, Sequence[Value]]) -> tuple[Obstacle, ...]:
    """Every obstacle of the lists, those that will appear too: a later one must leave them their place."""
    return tuple(
        obstacle_of({name: value for name, value in entry.items() if name != "spawn_trigger"}, f"{key}[{i}]")
        for key, entries in lists.items()
        for i, entry in enumerate(entries)
        if isinstance(entry, Mapping) and "spawn_pose" in entry
    )
