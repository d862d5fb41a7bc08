"""Obstacles, which are not on the robot's map, and their form in configuration values."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

import shapely

from vastflow.sim.model.digest import Value
from vastflow.sim.model.pose import GridFrame, Pose, pose_of
from vastflow.sim.model.shape import Box, Disc, outline_at

Model: TypeAlias = Literal["box", "cylinder"]

MASS_KG: Final = 5.0
FRICTION: Final = 0.4
"""Defaults of an obstacle that appears: a carton that the robot can just push."""


@dataclass(frozen=True, slots=True)
class Trigger:
    """Condition of an appearance: the robot comes within `distance_m` of a point, and `delay_s` passes."""

    x_m: float
    y_m: float
    distance_m: float
    delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A box or cylinder: fixed from the start without a trigger, appearing and pushable with one.

    Attributes:
        mass_kg, friction: Properties of one that appears; friction with the floor.
    """

    name: str
    shape: Disc | Box
    pose: Pose
    trigger: Trigger | None = None
    mass_kg: float = MASS_KG
    friction: float = FRICTION

    def in_grid(self, frame: GridFrame) -> "Obstacle":
        """Return the obstacle in the frame of a map's grid."""
        if frame.yaw_rad == 0.0:
            return self
        trigger = self.trigger
        if trigger is not None:
            x_m, y_m = frame.to_grid(trigger.x_m, trigger.y_m)
            trigger = replace(trigger, x_m=x_m, y_m=y_m)
        return replace(self, pose=frame.pose_to_grid(self.pose), trigger=trigger)

    @property
    def model(self) -> Model:
        """Common name of its shape."""
        return "cylinder" if isinstance(self.shape, Disc) else "box"

    @property
    def length_m(self) -> float:
        """Extent along its own x; a cylinder's diameter."""
        return 2 * self.shape.radius_m if isinstance(self.shape, Disc) else self.shape.length_m

    @property
    def width_m(self) -> float:
        """Extent along its own y; a cylinder's diameter."""
        return self.length_m if isinstance(self.shape, Disc) else self.shape.width_m

    def footprint(self) -> shapely.Polygon:
        """Return the outline in the map frame (m)."""
        return outline_at(self.shape, self.pose)


DEFAULT_SIZE_M: Final = 0.5
"""Edge or diameter that the models have by default."""

ARGUMENTS: Final[Mapping[Model, tuple[str, ...]]] = {
    "box": ("width", "length", "height", "box_width", "box_length", "box_height", "mass", "friction"),
    "cylinder": ("diameter", "radius", "width", "length", "height", "mass", "friction"),
}
"""Arguments of a model; heights, and a cylinder's length, which is one, are ignored."""

TRIGGER_POINT_KEY: Final = "spawn_trigger_point"
TRIGGER_THRESHOLD_KEY: Final = "spawn_trigger_threshold"


def lists_obstacles(value: object) -> bool:
    """True if a value is a list with obstacles."""
    return any(_entries(value))


def _entries(value: object) -> Iterator[Mapping[str, Value]]:
    if isinstance(value, Sequence) and not isinstance(value, str):
        yield from (entry for entry in value if isinstance(entry, Mapping) and "spawn_pose" in entry)


def obstacles_of(environment: Mapping[str, Value]) -> tuple[Obstacle, ...]:
    """Return the obstacles of an environment: entries with a `spawn_pose` of any list-valued key, in key order.

    An entry with a trigger, a point and a distance from it (m), appears during the run:

    - `spawn_trigger: {point: …, threshold: …, delay: …}` in the entry, each a value or a key of the environment; the delay (s) is optional.
    - Otherwise `spawn_trigger_point` and `spawn_trigger_threshold` of the environment for entries at that point, as
      `ObstacleVariationWithDistanceTrigger` writes them.

    Raises:
        ValueError: an entry whose pose, size or trigger can't be read.
    """
    obstacles = [
        obstacle_of(entry, f"{key}[{i}]", environment)
        for key in sorted(environment)
        for i, entry in enumerate(_entries(environment[key]))
    ]
    if TRIGGER_POINT_KEY in environment:
        point, threshold = environment[TRIGGER_POINT_KEY], environment.get(TRIGGER_THRESHOLD_KEY)
        trigger = _trigger_of(point, threshold, TRIGGER_POINT_KEY, TRIGGER_THRESHOLD_KEY)
        there = [o.trigger is None and (o.pose.x_m, o.pose.y_m) == (trigger.x_m, trigger.y_m) for o in obstacles]
        known = any(o.trigger is not None and replace(o.trigger, delay_s=0.0) == trigger for o in obstacles)
        if not known and not any(there):
            raise ValueError(f"{TRIGGER_POINT_KEY}: expected the position of an obstacle, got {point!r}")
        obstacles = [replace(o, trigger=trigger) if meant else o for o, meant in zip(obstacles, there, strict=True)]
    return tuple(obstacles)


def obstacle_of(
    entry: Mapping[str, Value], where: str = "obstacle", environment: Mapping[str, Value] | None = None
) -> Obstacle:
    """Read `{entity_name, model, spawn_pose, xacro_arguments}` (vast format) and its trigger, see `obstacles_of`.

    The shape follows from the model's file name, size, mass (kg), and friction from its arguments, such as `width:=0.5, mass:=5.0`.

    Raises:
        ValueError: a pose, a size or a trigger that can't be read, or an argument that the model does not have.
    """
    model = str(entry.get("model") or "box")
    is_cylinder = "cylinder" in model.rsplit("/", 1)[-1].lower()
    numbers = _arguments(str(entry.get("xacro_arguments") or ""), "cylinder" if is_cylinder else "box", where)
    pose = pose_of(entry["spawn_pose"], f"{where}.spawn_pose")
    shape: Disc | Box
    if is_cylinder:
        radius_m = numbers.get("radius", numbers.get("width", DEFAULT_SIZE_M) / 2)
        shape = Disc(numbers.get("diameter", 2 * radius_m) / 2)
    else:
        width_m = numbers.get("width", numbers.get("box_width", DEFAULT_SIZE_M))
        shape = Box(numbers.get("length", numbers.get("box_length", width_m)), width_m)
    name, trigger = str(entry.get("entity_name") or where), _trigger(entry, where, environment or {})
    mass_kg, friction = numbers.get("mass", MASS_KG), numbers.get("friction", FRICTION)
    return Obstacle(name, shape, pose, trigger, mass_kg, friction)


def _trigger(entry: Mapping[str, Value], where: str, environment: Mapping[str, Value]) -> Trigger | None:
    if "spawn_trigger" not in entry:
        return None
    found = entry["spawn_trigger"]
    if not isinstance(found, Mapping) or set(found) - {"delay"} != {"point", "threshold"}:
        raise ValueError(
            f"{where}.spawn_trigger: expected {{point: …, threshold: …}} and perhaps delay: … (s), got {found!r}"
        )
    point, threshold, delay = (
        environment.get(value, value) if isinstance(value, str) else value
        for value in (found["point"], found["threshold"], found.get("delay", 0.0))
    )
    place = f"{where}.spawn_trigger"
    delay_s = _not_negative(delay, f"{place}.delay", "time in seconds")
    return _trigger_of(point, threshold, f"{place}.point", f"{place}.threshold", delay_s)


def _trigger_of(point: Value, distance: Value, point_where: str, distance_where: str, delay_s: float = 0.0) -> Trigger:
    at = pose_of(point, point_where)
    return Trigger(at.x_m, at.y_m, _not_negative(distance, distance_where, "distance in meters"), delay_s)


def _not_negative(value: Value, where: str, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise ValueError(f"{where}: expected a {what}, 0 or more, got {value!r}")
    return float(value)


def _arguments(text: str, model: Model, where: str) -> dict[str, float]:
    sizes: dict[str, float] = {}
    for part in text.replace(",", " ").split():
        key, found, number = part.partition(":=")
        try:
            sizes[key] = float(number)
        except ValueError:
            found = ""
        if not found or not sizes[key] > 0 or not math.isfinite(sizes[key]):
            raise ValueError(f"{where}: expected a size greater than 0, such as width:=0.5, got {part!r}")
        if key not in ARGUMENTS[model]:
            raise ValueError(f"{where}: a {model} has no argument {key!r}. It has {', '.join(ARGUMENTS[model])}")
    return sizes
