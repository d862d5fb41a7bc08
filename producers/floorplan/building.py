"""The building a floor plan describes: every floor, wall, obstacle and opening in the world, in meters."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from vastflow.producers.floorplan.geometry import (
    IDENTITY,
    SMALLEST_M,
    Outline,
    Transform,
    clipped,
    edges,
    sharp_corner,
    wall_frame,
    wall_outlines,
)
from vastflow.producers.floorplan.plan import (
    FeatureKind,
    FloorPlan,
    Opening,
    OpeningKind,
    PlanFrame,
    PlanSpace,
)
from vastflow.producers.floorplan.reading import plan_of
from vastflow.producers.floorplan.syntax import PlanText
from vastflow.sim.model.elementary import dist
from vastflow.sim.model.faults import Fault, FileError, Place, Problem
from vastflow.sim.model.files import TextPlace

ROUNDING_M: Final = 1e-9
"""Tolerance of sums of a user's decimal numbers."""

LEAST_OVERLAP_M2: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Room:
    """The floor of a space: `outline` has the corners in the plan's order."""

    name: str
    outline: Outline


@dataclass(frozen=True, slots=True)
class Wall:
    """The wall along one edge of a room.

    Attributes:
        name: `<space>-wall-<number>`.
        outline: Outer start, outer end, inner end, inner start.
        length_m: Length of its inner face.
        frame: Origin in the middle of its inner face, x along it, y into the wall.
    """

    name: str
    outline: Outline
    height_m: float
    length_m: float
    thickness_m: float
    frame: Transform


@dataclass(frozen=True, slots=True)
class SolidBlock:
    """A column or divider, solid from the floor to its height."""

    name: str
    kind: FeatureKind
    outline: Outline
    height_m: float


@dataclass(frozen=True, slots=True)
class Hole:
    """An entryway or window.

    Attributes:
        walls: The names of those it cuts; nothing else is cut.
        shape: (x, z) in `frame`, that of the first wall: x along it from its middle, z up from the floor. It goes
            `depth_m` deep into that wall's +y.
        outline: Outline of all it takes away, seen from above.
        bottom_m, top_m: Lowest and highest point of the shape; a bottom below the floor is as good as 0.
    """

    name: str
    kind: OpeningKind
    walls: tuple[str, ...]
    shape: Outline
    depth_m: float
    frame: Transform
    outline: Outline
    bottom_m: float
    top_m: float

    @property
    def reach(self) -> tuple[float, float]:
        """Lowest and highest x of the shape."""
        return _span(x for x, _ in self.shape)

    def section(self, z_m: float) -> tuple[tuple[float, float], ...]:
        """The intervals of x that are open at a height, in increasing order."""
        if not self.bottom_m <= z_m <= self.top_m:
            return ()
        inset = (self.top_m - self.bottom_m) * 1e-9  # at the very top or bottom, what is open just beside it
        z = min(max(z_m, self.bottom_m + inset), self.top_m - inset)
        crossings = sorted(
            x0 + (z - z0) * (x1 - x0) / (z1 - z0) for (x0, z0), (x1, z1) in edges(self.shape) if (z0 > z) != (z1 > z)
        )
        return tuple(zip(crossings[::2], crossings[1::2], strict=True))

    def footprint(self, x0: float, x1: float, margin_m: float = 0.0) -> Outline:
        """An interval of x through the whole depth, and `margin_m` beyond both faces, seen from above."""
        y0, y1 = -margin_m, self.depth_m + margin_m
        return self.frame.outline(((x0, y1), (x1, y1), (x1, y0), (x0, y0)))


@dataclass(frozen=True, slots=True)
class Building:
    """All geometry of a floor plan.

    Attributes:
        file: The plan's name for messages.
        notes: Notes for the plan's author.
    """

    name: str
    file: str
    rooms: tuple[Room, ...]
    walls: tuple[Wall, ...]
    obstacles: tuple[SolidBlock, ...]
    holes: tuple[Hole, ...]
    notes: tuple[Fault, ...] = ()

    @property
    def floor_bounds(self) -> tuple[float, float, float, float]:
        """Lowest x and y, highest x and y of the rooms' corners."""
        return _bounds(self.rooms)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Lowest x and y, highest x and y of everything."""
        return _bounds([*self.rooms, *self.walls, *self.obstacles])


def _bounds(parts: Iterable[Room | Wall | SolidBlock]) -> tuple[float, float, float, float]:
    xs, ys = zip(*(point for part in parts for point in part.outline), strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def build(text: PlanText, drawn: Mapping[int, float] | None = None) -> Building:
    """The building of a plan.

    Args:
        drawn: Numbers that take the place of those in the text, by where these begin.

    Raises:
        FileError: every fault in the text; else spaces placed by each other in a circle, or a too sharp corner.
    """
    return _Builder(plan_of(text, drawn)).building()


class _Builder:
    def __init__(self, plan: FloorPlan) -> None:
        self._plan = plan
        self._spaces = {space.name: space for space in plan.spaces}
        self._poses: dict[str, Transform] = {}
        self._notes = list(plan.notes)

    def building(self) -> Building:
        plan = self._plan
        for space in plan.spaces:
            self._place(space)
        sharp = [(space, k) for space in plan.spaces if (k := sharp_corner(space.outline)) is not None]
        if sharp:
            corners = ((space, "({:g}, {:g})".format(*space.outline[k])) for space, k in sharp)
            what = "the corner at {} is sharper than 1°, where no walls can meet"
            right = "make the angle wider"
            raise FileError(self._fault(space, space.place, what.format(at), right) for space, at in corners)
        rooms = tuple(Room(space.name, self._poses[space.name].outline(space.outline)) for space in plan.spaces)
        walls = {wall.name: wall for space in plan.spaces for wall in self._walls(space)}
        count = Counter(feature.name for feature in plan.features)
        obstacles = tuple(
            SolidBlock(
                each.name if count[each.name] == 1 else f"{each.space or 'world'}.{each.name}",
                each.kind,
                self._frame(each.wrt).then(each.offset).outline(each.outline),
                each.height_m,
            )
            for each in plan.features
        )
        holes = tuple(hole for opening in plan.openings if (hole := self._hole(opening, walls)) is not None)
        self._note_misses(holes, walls)
        return Building(plan.name, plan.file, rooms, tuple(walls.values()), obstacles, holes, tuple(self._notes))

    def _fault(self, space: PlanSpace, place: TextPlace, what: Problem, right: str) -> Fault:
        return Fault(Place(self._plan.file, *place, f"Space {space.name}"), what, right)

    def _note(self, opening: Opening, what: Problem, right: str) -> None:
        where = f"{opening.kind} {opening.name}"
        self._notes.append(Fault(Place(self._plan.file, *opening.place, where), what, right, "warning"))

    def _place(self, space: PlanSpace) -> None:
        chain: dict[str, PlanSpace] = {}
        while space.name not in self._poses:
            if space.name in chain:
                *_, last = chain.values()
                names = list(chain)
                what = f"they are placed in a circle: {' by '.join([*names[names.index(space.name) :], space.name])}"
                raise FileError([self._fault(last, last.wrt.place, what, "place one of them in the world")])
            chain[space.name] = space
            if space.wrt.space is None:
                break
            space = self._spaces[space.wrt.space]
        for each in reversed(chain.values()):
            self._poses[each.name] = self._placed(each)

    def _placed(self, space: PlanSpace) -> Transform:
        """The world pose of a space relative to its placed `wrt`: W · T(x, y, a) · O⁻¹."""
        x_m, y_m, yaw_rad = space.offset
        if space.wrt.wall is not None and space.of_wall is not None:
            if space.spaced:
                y_m += space.thickness_m + self._spaces[space.wrt.space or ""].thickness_m
            if space.aligned:
                yaw_rad += math.pi
        own = IDENTITY if space.of_wall is None else wall_frame(space.outline, space.of_wall)
        return self._frame(space.wrt).then(Transform(x_m, y_m, yaw_rad)).then(own.inverse())

    def _frame(self, frame: PlanFrame) -> Transform:
        if frame.space is None:
            return IDENTITY
        pose = self._poses[frame.space]
        return pose if frame.wall is None else pose.then(wall_frame(self._spaces[frame.space].outline, frame.wall))

    def _walls(self, space: PlanSpace) -> Iterator[Wall]:
        pose, corners, thickness_m = self._poses[space.name], space.outline, space.thickness_m
        for k, (edge, outline) in enumerate(zip(edges(corners), wall_outlines(corners, thickness_m), strict=True)):
            name, frame = wall_name(space.name, k), pose.then(wall_frame(corners, k))
            yield Wall(name, pose.outline(outline), space.height_m, dist(*edge), thickness_m, frame)

    def _hole(self, opening: Opening, walls: Mapping[str, Wall]) -> Hole | None:
        """Return the part of the first wall that an opening removes, or None."""
        cut = [walls[wall_name(frame.space or "", frame.wall or 0)] for frame in opening.walls]
        first, half_m, height_m = opening.walls[0], cut[0].length_m / 2, max(wall.height_m for wall in cut)
        (x0, x1), (z0, z1) = map(_span, zip(*opening.outline, strict=True))
        along = f"it reaches from {x0:g} m to {x1:g} m along {first}, which has {-half_m:g} m to {half_m:g} m"
        if min(x1, half_m) - max(x0, -half_m) < SMALLEST_M:
            self._note(opening, f"it cuts nothing, as {along}", f"put part of it within ±{half_m:g} m")
            return None
        if z1 <= 0.0 or z0 >= height_m:
            what = f"it cuts nothing, being {'below the floor' if z1 <= 0.0 else 'above the wall'}"
            right = f"it reaches from {z0:g} m to {z1:g} m, and the wall from 0 m to {height_m:g} m"
            self._note(opening, what, right)
            return None
        shape = opening.outline
        if max(-x0, x1) > half_m + ROUNDING_M:
            self._note(opening, f"{along}", "it is cut to that")
            shape, x0, x1 = clipped(shape, -half_m, half_m), max(x0, -half_m), min(x1, half_m)
            z0, z1 = _span(z for _, z in shape)
        if z1 > height_m + ROUNDING_M:
            self._note(opening, f"it reaches up to {z1:g} m", f"it is cut to its wall of {height_m:g} m")
        frame, depth_m = cut[0].frame, math.fsum(wall.thickness_m for wall in cut)
        footprint = frame.outline(((x0, depth_m), (x1, depth_m), (x1, 0.0), (x0, 0.0)))
        names = tuple(wall.name for wall in cut)
        return Hole(opening.name, opening.kind, names, shape, depth_m, frame, footprint, z0, z1)

    def _note_misses(self, holes: Iterable[Hole], walls: Mapping[str, Wall]) -> None:
        """Say which openings do not reach the second wall they name, or go past its end."""
        openings = {opening.name: opening for opening in self._plan.openings}
        pairs = [(hole, openings[hole.name]) for hole in holes if hole.walls[1:]]
        if not pairs:
            return
        taken = shapely.polygons([hole.outline for hole, _ in pairs])
        second = shapely.polygons([walls[hole.walls[1]].outline for hole, _ in pairs])
        missed = shapely.area(shapely.intersection(taken, second)) < LEAST_OVERLAP_M2
        for k in np.flatnonzero(missed):
            hole, opening = pairs[k]
            what = f"it does not reach {opening.walls[1]}, {hole.depth_m:g} m deep as it is"
            self._note(opening, what, f"name walls that touch, or {opening.walls[0]} alone")


def wall_name(space: str, wall: int) -> str:
    """Name of a wall in every output."""
    return f"{space}-wall-{wall}"


def _span(values: Iterable[float]) -> tuple[float, float]:
    found = list(values)
    return min(found), max(found)
