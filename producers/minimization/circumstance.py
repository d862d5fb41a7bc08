"""Circumstances: what of a scenario can be taken away, brought nearer to its default, or shortened."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, Literal, TypeAlias

from shapely.geometry import Point

from vastflow.producers.campaign_file.scenario_values import LOOPS_KEY
from vastflow.producers.places.ground import Ground, ground_of
from vastflow.producers.places.route import shortest_leg
from vastflow.producers.places.stops import GOAL_KEY, GOALS_KEY, START_KEY
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.elementary import atan2, hypots
from vastflow.sim.model.faults import FileError
from vastflow.sim.model.obstacle import TRIGGER_POINT_KEY, TRIGGER_THRESHOLD_KEY, obstacle_of
from vastflow.sim.model.pose import Pose, pose_of
from vastflow.sim.model.scenario import Dimension
from vastflow.sim.system.keys import FILE_KEY
from vastflow.sim.system.system import system_of
from vastflow.sim.world.environment import WORLD_KEY, ground_file

LEVELS: Final = 8
"""Parts into which the distance of a value from its default is divided."""


WORLD_PARTS: Final[Mapping[str, str]] = {"wall_offset": "moved walls", "missing_furniture": "missing furniture"}
"""Parts in which a world differs from the map; without both it is the map."""

Kind: TypeAlias = Literal["obstacle", "world", "waypoint", "parameter", "path"]


@dataclass(frozen=True, slots=True)
class Circumstance:
    """One thing about a scenario that its failure may need.

    Attributes:
        key: Key among the scenario's values.
        item: Place in the list, or name in the mapping that stands there; None for the value as a whole.
        default: The number toward which its levels go; None where it has none. For a path it is a length of 0.
    """

    kind: Kind
    key: str
    item: int | str | None
    text: str
    default: float | None = None

    @property
    def can_be_left_out(self) -> bool:
        """Whether it can be taken away; a path can only be shorter."""
        return self.kind != "path"


Levels: TypeAlias = Mapping[Circumstance, int]
"""Remaining distances of circumstances from their defaults, in eighths."""


@dataclass(frozen=True)
class Subject:
    """A scenario that fails: value and dimension of each key, maps as `FileContent`."""

    values: Mapping[str, Value]
    dimensions: Mapping[str, Dimension] = field(repr=False)

    @cached_property
    def circumstances(self) -> tuple[Circumstance, ...]:
        """All circumstances, obstacles first."""
        return tuple(each for kind in (self._objects, self._world, self._task, self._system) for each in kind())

    def reduced(self, kept: Collection[Circumstance], levels: Levels) -> dict[str, Value]:
        """The values with these circumstances alone, some nearer to their default; raises as `shortened` does."""
        values = dict(self.values)
        nearer = [each for each in self.circumstances if each in levels]  # in an order that is always the same
        for each in nearer:
            if each.kind != "path":
                _bring_nearer(values, each, levels[each] / LEVELS)
        gone = [each for each in self.circumstances if each.can_be_left_out and each not in kept]
        for key in {each.key for each in gone}:
            _leave_out(values, key, {each.item for each in gone if each.key == key})
        _drop_idle_trigger(values)
        for each in nearer:
            if each.kind == "path":
                shortened(values, each.key, levels[each] / LEVELS)
        return values

    def _objects(self) -> Iterator[Circumstance]:
        for key, value in self.values.items():
            for k, entry in _obstacles(value) if self.dimensions[key] == "environment" else ():
                at = pose_of(entry["spawn_pose"])
                name = entry.get("entity_name") or f"{key}[{k}]"
                yield Circumstance("obstacle", key, k, f"obstacle {name} at ({at.x_m:.2f}, {at.y_m:.2f})")

    def _world(self) -> Iterator[Circumstance]:
        world = self.values.get(WORLD_KEY)
        known = world if isinstance(world, Mapping) else {}
        for name, text in WORLD_PARTS.items():
            if isinstance(found := known.get(name), int | float) and found > 0:
                yield Circumstance("world", WORLD_KEY, name, f"{text} ({name} {found:g})", 0.0)

    def _task(self) -> Iterator[Circumstance]:
        goals = self.values.get(GOALS_KEY)
        for k, goal in enumerate(_listed(goals)[:-1]):
            at = pose_of(goal)
            yield Circumstance("waypoint", GOALS_KEY, k, f"waypoint {k + 1} at ({at.x_m:.2f}, {at.y_m:.2f})")
        if self.values.get(LOOPS_KEY):
            yield Circumstance("waypoint", LOOPS_KEY, None, f"{LOOPS_KEY} {self.values[LOOPS_KEY]}")
        goal_key = GOALS_KEY if _listed(goals) else GOAL_KEY
        if START_KEY in self.values and goal_key in self.values:
            yield Circumstance("path", goal_key, None, "the end of the path", 0.0)
            yield Circumstance("path", START_KEY, None, "the beginning of the path", 0.0)

    def _system(self) -> Iterator[Circumstance]:
        for key, value in self.values.items():
            if self.dimensions[key] == "system":
                yield Circumstance("parameter", key, None, f"{key} {_shown(value)}", _default(key, value))


def _shown(value: Value) -> str:
    if isinstance(value, FileContent):
        return value.path.rpartition("/")[2]
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _default(key: str, value: Value) -> float | None:
    """The number that a parameter has where nothing is given; None where it or the value is no number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or key == FILE_KEY:
        return None
    return system_of({}).usual(key)


def _bring_nearer(values: dict[str, Any], circumstance: Circumstance, share: float) -> None:
    found = values[circumstance.key]
    number = found if circumstance.item is None else found[circumstance.item]
    default = circumstance.default or 0.0
    level = default + share * (number - default)
    nearer = round(level) if isinstance(number, int) and float(default).is_integer() else float(f"{level:.4g}")
    values[circumstance.key] = nearer if circumstance.item is None else {**found, circumstance.item: nearer}


def _leave_out(values: dict[str, Any], key: str, items: Collection[int | str | None]) -> None:
    found = values[key]
    if None in items:
        del values[key]
    elif isinstance(found, Mapping):
        values[key] = {name: item for name, item in found.items() if name not in items}
        if key == WORLD_KEY and not any(values[key].get(part) for part in WORLD_PARTS):
            del values[key]
    else:
        values[key] = [item for k, item in enumerate(found) if k not in items]


def _obstacles(value: Any) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Yield the obstacles in a list with their places; nothing for another value."""
    for k, entry in enumerate(_listed(value)):
        if isinstance(entry, Mapping) and "spawn_pose" in entry:
            yield k, entry


def _drop_idle_trigger(values: dict[str, Any]) -> None:
    """Remove a trigger without an obstacle at its point."""
    if TRIGGER_POINT_KEY not in values:
        return
    point = pose_of(values[TRIGGER_POINT_KEY])
    at = [pose_of(each["spawn_pose"]) for value in values.values() for _, each in _obstacles(value)]
    if (point.x_m, point.y_m) not in {(pose.x_m, pose.y_m) for pose in at}:
        del values[TRIGGER_POINT_KEY]
        values.pop(TRIGGER_THRESHOLD_KEY, None)


def _listed(value: Any) -> Sequence[Any]:
    """The entries of a list; empty for another value."""
    return value if isinstance(value, list | tuple) else ()


def shortened(values: dict[str, Any], key: str, share: float) -> None:
    """Leave a share of the path's first or last leg; without a route nothing changes.

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
    content = ground_file(values)
    if content is None:
        return None
    try:
        plain = {key: value for key, value in values.items() if not isinstance(value, list | dict)}
        outline = system_of(plain).start_outline
    except FileError:  # the run says what is wrong with it
        return None
    return ground_of(content, round(2 * float(hypots(*outline.T).max()), 3))


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
        (x0, y0), (x1, y1) = (points[i] for i in ((k, min(k + ahead, last)) if k < last else (max(k - ahead, 0), k)))
        poses.append(Pose(round(x_m, 3), round(y_m, 3), round(atan2(y1 - y0, x1 - x0), 3)))
    return poses


def _check_free(values: dict[str, Any], pose: Pose, radius_m: float) -> None:
    for _, entry in (found for value in values.values() for found in _obstacles(value)):
        obstacle = obstacle_of(entry)
        if obstacle.footprint().distance(Point(pose.x_m, pose.y_m)) < radius_m:
            at = f"({pose.x_m:g}, {pose.y_m:g})"
            raise ValueError(f"the path would begin or end at {at}, where {obstacle.name} stands")
