"""The physical world of one run in pymunk: walls, obstacles and the robot's body.

A robot away from everything solid needs no engine (`vastflow.sim.world.motion`); the world is used while contacts are possible, and
until bodies come to rest.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
import pymunk
import shapely
from numpy.typing import NDArray
from pymunk._chipmunk_cffi import ffi

from vastflow.sim.model.elementary import cos_sin, dist, hypot
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import Event
from vastflow.sim.model.shape import Box, Disc, Vertices
from vastflow.sim.world.bodies import Body
from vastflow.sim.world.motion import FREE, MOVING, TOUCHING, chord_mps
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Robot

ROBOT, WALL, OBSTACLE = 1, 2, 3

GRAVITY_MPS2: Final = 9.81
TRACTION: Final = 0.8
"""Friction of the robot's tires, which limits its acceleration after a contact."""

AT_REST_MPS, AT_REST_RADPS, AT_REST_M = 1e-3, 1e-3, 1e-6
"""A slower box is at rest, and so is a robot that moved less in a tick."""

NOTED: Final = 5e-4
"""Motion (m, rad) since an obstacle's last event that makes another."""


def wall_rectangles(occupancy: OccupancyMap) -> NDArray[np.float64]:
    """Return rectangles (N, 4) as x0, y0, x1, y1 (m) that together cover the border of occupied cells.

    Cells without a free neighbor, which nothing can reach, are left out. Runs of cells in a row are merged with equal runs in the rows above.
    """
    framed = np.pad(occupancy.occupied, 1, constant_values=True)
    across = framed[:, :-2] & framed[:, 1:-1] & framed[:, 2:]
    shell = occupancy.occupied & ~(across[:-2] & across[1:-1] & across[2:])
    edges = np.diff(np.pad(shell.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, first = np.nonzero(edges == 1)
    last = np.nonzero(edges == -1)[1]
    order = np.lexsort((row, last, first))
    row, first, last = row[order], first[order], last[order]
    new = np.ones(len(row), dtype=np.bool_)
    new[1:] = (np.diff(first) != 0) | (np.diff(last) != 0) | (np.diff(row) != 1)
    begins = np.flatnonzero(new)
    ends = np.append(begins[1:], len(row))[: len(begins)] - 1
    cells = np.column_stack([first[begins], row[begins], last[begins], row[ends] + 1]).astype(np.float64)
    return np.asarray(cells * occupancy.resolution_m + np.tile(np.asarray(occupancy.origin_xy_m), 2))


class WallIndex:
    """Walls and bodies of a world by tile, so that physics gets only those near the robot.

    Attributes:
        rectangles: (N, 4) x0, y0, x1, y1 (m): of a map's walls, or the bounds of bodies.
    """

    TILE_M = 2.0

    def __init__(self, occupancy: OccupancyMap, bodies: Sequence[Body] = ()) -> None:
        self._outlines = [*_outlines(occupancy, bodies)]
        bounds = [
            (*points.min(axis=0) - radius_m, *points.max(axis=0) + radius_m) for points, radius_m in self._outlines
        ]
        self.rectangles = np.array(bounds) if bodies else wall_rectangles(occupancy)
        self._tiles: dict[tuple[int, int], list[int]] = {}
        spans = np.floor(self.rectangles / self.TILE_M).astype(np.int64)
        for index, (x0, y0, x1, y1) in enumerate(spans.tolist()):
            for x in range(x0, x1 + 1):
                for y in range(y0, y1 + 1):
                    self._tiles.setdefault((x, y), []).append(index)

    def wall(self, index: int, body: pymunk.Body) -> pymunk.Shape:
        """Return the shape of a rectangle, or of what is in it."""
        if self._outlines:
            points, radius_m = self._outlines[index]
            return (
                pymunk.Circle(body, radius_m, tuple(points[0].tolist()))
                if radius_m
                else pymunk.Poly(body, points.tolist())
            )
        x0, y0, x1, y1 = self.rectangles[index].tolist()
        return pymunk.Poly(body, [(x0, y0), (x1, y0), (x1, y1), (x0, y1)])

    def tile_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        return math.floor(x_m / self.TILE_M), math.floor(y_m / self.TILE_M)

    def around(self, tile: tuple[int, int]) -> list[int]:
        """Return rectangles in a tile and its eight neighbors, in increasing order."""
        x, y = tile
        near = {index for dx in (-1, 0, 1) for dy in (-1, 0, 1) for index in self._tiles.get((x + dx, y + dy), ())}
        return sorted(near)


class Physics:
    """Bodies and contacts of one run. Walls join the space tile by tile as a body comes near them.

    Args:
        obstacles: Obstacles that move, that stand from the start, that appear, and that are added later; they are numbered in
            this sequence.
        movers: (T, M, 3) poses of the first M at each tick, see `vastflow.sim.world.motion.Body`.

    Attributes:
        events: `contact` of the robot with a wall or an obstacle (value: closing speed, m/s), `spawned`, `obstacle_moved` and
            `deleted` at an obstacle's center (value: its yaw, rad), in the order they happened.
    """

    def __init__(
        self, robot: Robot, walls: WallIndex, obstacles: Sequence[Obstacle], movers: NDArray[np.float64]
    ) -> None:
        self._space = pymunk.Space()
        self._space.collision_slop = 0.0005
        # A step moves the body before contacts are solved, so an overlap must be undone within one step: at the default rate a
        # robot stands 8 cm deep in the wall.
        self._space.collision_bias = 0.0
        self._walls = walls
        self._present: set[int] = set()
        self._tiles: set[tuple[int, int]] = set()
        self._time_s = 0.0
        self._names: dict[pymunk.Shape, str] = {}
        self._obstacles, self._movers = obstacles, movers
        self._fixed: dict[int, pymunk.Body] = {}
        self._appeared: dict[int, pymunk.Body] = {}
        self._moving: set[int] = set()
        self._noted: dict[int, tuple[float, float, float]] = {}
        self._touching = Counter[pymunk.Shape]()  # what is touched, by how many parts of the robot
        self._displaced = False
        self.events: list[Event] = []
        # Contacts without friction can't turn a disc.
        inertia = pymunk.moment_for_poly(robot.mass_kg, robot.vertices) if robot.vertices else math.inf
        self._robot = pymunk.Body(robot.mass_kg, inertia)
        self._radius_m = robot.radius_m
        shapes = _robot_shapes(robot, self._robot)
        if robot.vertices:
            _turn_by_own_functions(self._robot)
        for shape in shapes:
            shape.collision_type = ROBOT
        self._space.add(self._robot, *shapes)
        for index, obstacle in enumerate(obstacles):
            if obstacle.trigger is None:
                self._fix(index, pymunk.Body.KINEMATIC if index < movers.shape[1] else pymunk.Body.STATIC)
        for partner in (WALL, OBSTACLE):
            self._space.on_collision(ROBOT, partner, begin=self._touch, separate=self._part)

    @property
    def hold(self) -> int:
        """State of the engine after the last tick: FREE, TOUCHING or MOVING."""
        # A mover pushes what can be pushed wherever the robot is.
        pushing = bool(self._appeared) and self._movers.shape[1] > 0
        if self._moving or pushing or (self._touching and self._displaced):
            return MOVING
        return TOUCHING if self._touching else FREE

    def drive(self, pose: NDArray[Any], velocities: Sequence[Sequence[float]], dt_s: float, t_s: float) -> None:
        """Move the robot from `pose` (3,), in place, by (speed, yaw rate, speed to the left) of each physics step.

        The velocity of a step points along the chord of the arc, so that free motion is the exact arc.
        """
        robot, space = self._robot, self._space
        self._time_s = t_s
        robot.position = float(pose[0]), float(pose[1])
        robot.angle = float(pose[2])
        self._approach(robot.position)
        self._carry(round(t_s / TICK_S))
        for v_mps, w_radps, vy_mps in velocities:
            wanted = pymunk.Vec2d(*chord_mps(v_mps, w_radps, vy_mps, robot.angle, dt_s))
            robot.velocity = self._with_traction(wanted, dt_s) if self._touching else wanted
            robot.angular_velocity = self._turning(w_radps, dt_s) if self._touching else w_radps
            glides = [
                (body, body.position + body.velocity * dt_s, body.angle + body.angular_velocity * dt_s)
                for body in self._appeared.values()
            ]
            space.step(dt_s)
            for body, position, angle in glides:
                # The engine undoes overlaps without friction, by which the robot would shift any box: a box that friction holds
                # is put back.
                if _at_rest(body):
                    body.position, body.angle = position, angle
            self._time_s += dt_s
        x_m, y_m = robot.position
        self._displaced = hypot(x_m - pose[0], y_m - pose[1]) > AT_REST_M
        pose[0], pose[1], pose[2] = x_m, y_m, robot.angle
        for index, body in self._appeared.items():
            if _at_rest(body):
                body.velocity, body.angular_velocity = (0.0, 0.0), 0.0
                self._moving.discard(index)
            else:
                self._moving.add(index)
                self._approach(body.position)

    def appear(self, index: int, t_s: float) -> None:
        """Let obstacle `index` appear at its pose; a robot in its place is pushed out."""
        obstacle = self._obstacles[index]
        body = pymunk.Body(obstacle.mass_kg, _inertia(obstacle))
        body.position, body.angle = (obstacle.pose.x_m, obstacle.pose.y_m), obstacle.pose.yaw_rad
        if isinstance(obstacle.shape, Box):
            _turn_by_own_functions(body)
        grip_n = obstacle.friction * obstacle.mass_kg * GRAVITY_MPS2
        slide = pymunk.PivotJoint(self._space.static_body, body, (0.0, 0.0), (0.0, 0.0))
        slide.max_force = grip_n
        turn = pymunk.GearJoint(self._space.static_body, body, 0.0, 1.0)
        turn.max_force = grip_n * obstacle.shape.mean_radius_m
        for joint in (slide, turn):
            joint.max_bias = 0.0  # friction only takes speed away
        self._space.add(body, self._shape(obstacle, body), slide, turn)
        self._appeared[index] = body
        self._displaced = True  # a robot at rest may stand in it
        self._approach(body.position)
        self._note("spawned", index, t_s)

    def add(self, index: int, t_s: float, pushable: bool) -> None:
        if pushable:
            self.appear(index, t_s)
        else:
            self._fix(index)
            self._displaced = True
            self._note("spawned", index, t_s)

    def remove(self, index: int, t_s: float) -> None:
        self._note("deleted", index, t_s)
        body = self._appeared.pop(index, None) or self._fixed.pop(index)
        self._moving.discard(index)
        for shape in body.shapes:
            self._names.pop(shape, None)
        self._space.remove(*body.constraints, *body.shapes, body)

    def pose_of(self, index: int) -> tuple[float, float, float]:
        """Return x, y and yaw of an obstacle in the world."""
        body = self._appeared.get(index) or self._fixed[index]
        return body.position.x, body.position.y, body.angle

    @property
    def appeared(self) -> tuple[int, ...]:
        """Numbers of obstacles that have appeared, in order."""
        return tuple(self._appeared)

    def note_moves(self, t_s: float) -> None:
        """Add an event for each obstacle that moved since its last event."""
        for index in self._appeared:
            if dist(self._noted[index], self.pose_of(index)) > NOTED:
                self._note("obstacle_moved", index, t_s)

    def _with_traction(self, wanted: pymunk.Vec2d, dt_s: float) -> pymunk.Vec2d:
        change = wanted - self._robot.velocity
        most = TRACTION * GRAVITY_MPS2 * dt_s
        length = hypot(*change)
        return wanted if length <= most else self._robot.velocity + change * (most / length)

    def _turning(self, wanted_radps: float, dt_s: float) -> float:
        """Limit the yaw rate of a body that a contact can turn: the tires act at its rim."""
        if math.isinf(self._robot.moment):
            return wanted_radps
        most = TRACTION * GRAVITY_MPS2 * dt_s * self._robot.mass * self._radius_m / self._robot.moment
        own = self._robot.angular_velocity
        return min(max(wanted_radps, own - most), own + most)

    def _approach(self, place: pymunk.Vec2d) -> None:
        tile = self._walls.tile_of(*place)
        if tile in self._tiles:
            return
        self._tiles.add(tile)
        for index in self._walls.around(tile):
            if index not in self._present:
                self._present.add(index)
                wall = self._walls.wall(index, self._space.static_body)
                wall.collision_type = WALL
                self._space.add(wall)

    def _carry(self, tick: int) -> None:
        """Place the movers as they are at a tick, and let them go to where they are at the next."""
        for k in range(self._movers.shape[1]):
            body, (here, there) = self._fixed[k], self._movers[tick : tick + 2, k].tolist()
            body.position, body.angle = (here[0], here[1]), here[2]
            body.velocity = (there[0] - here[0]) / TICK_S, (there[1] - here[1]) / TICK_S
            body.angular_velocity = math.remainder(there[2] - here[2], math.tau) / TICK_S

    def _fix(self, index: int, kind: int = pymunk.Body.STATIC) -> None:
        obstacle = self._obstacles[index]
        body = pymunk.Body(body_type=kind)
        body.position, body.angle = (obstacle.pose.x_m, obstacle.pose.y_m), obstacle.pose.yaw_rad
        _turn_by_own_functions(body)
        self._space.add(body, self._shape(obstacle, body))
        self._fixed[index] = body

    def _shape(self, obstacle: Obstacle, body: pymunk.Body) -> pymunk.Shape:
        shape: pymunk.Shape
        match obstacle.shape:
            case Disc(radius_m):
                shape = pymunk.Circle(body, radius_m)
            case Box(length_m, width_m):
                shape = pymunk.Poly.create_box(body, (length_m, width_m))
        shape.collision_type = OBSTACLE
        self._names[shape] = obstacle.name
        return shape

    def _note(self, kind: str, index: int, t_s: float) -> None:
        self._noted[index] = self.pose_of(index)
        x_m, y_m, yaw_rad = (round(part, 4) for part in self._noted[index])
        self.events.append(Event(round(t_s, 3), kind, x_m, y_m, self._obstacles[index].name, yaw_rad))

    def _touch(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: object) -> None:
        touched = arbiter.shapes[1]
        self._touching[touched] += 1
        if self._touching[touched] == 1:
            body, partner = arbiter.bodies
            closing_mps = abs((body.velocity - partner.velocity).dot(arbiter.normal))
            what = self._names.get(touched, "wall")
            event = Event(round(self._time_s, 3), "contact", *self._robot.position, what, closing_mps)
            self.events.append(event)

    def _part(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: object) -> None:
        touched = arbiter.shapes[1]
        self._touching[touched] -= 1
        if not self._touching[touched]:
            del self._touching[touched]


def _at_rest(body: pymunk.Body) -> bool:
    return hypot(*body.velocity) <= AT_REST_MPS and abs(body.angular_velocity) <= AT_REST_RADPS


_TRANSFORM: Final = 17
"""Offset of the transform in a body of Chipmunk, in doubles."""


def _turn_by_own_functions(body: pymunk.Body) -> None:
    """Make a body use `cos_sin` for its rotation, for which Chipmunk calls the C library."""
    transform = ffi.cast("double *", body._body)[_TRANSFORM : _TRANSFORM + 4]

    def turn() -> None:
        c, s = cos_sin(body.angle)
        transform[0:4] = [c, s, -s, c]

    def move(body: pymunk.Body, dt_s: float) -> None:
        pymunk.Body.update_position(body, dt_s)
        turn()

    found = body.rotation_vector
    if list(transform) != [found.x, found.y, -found.y, found.x]:
        raise RuntimeError(f"pymunk {pymunk.version}: a body has its transform in another place")
    turn()
    if body.body_type != pymunk.Body.STATIC:
        body.position_func = move


def _robot_shapes(robot: Robot, body: pymunk.Body) -> list[pymunk.Shape]:
    if not robot.vertices:
        return [pymunk.Circle(body, robot.radius_m)]
    return [pymunk.Poly(body, part) for part in _convex_parts(shapely.Polygon(robot.vertices), robot.vertices)]


def _convex_parts(whole: shapely.Polygon, vertices: Vertices) -> list[Vertices]:
    if whole.convex_hull.area - whole.area <= 1e-9:
        return [vertices]
    triangles = shapely.constrained_delaunay_triangles(whole)
    return [tuple(part.exterior.coords)[:-1] for part in triangles.geoms]


def _outlines(occupancy: OccupancyMap, bodies: Sequence[Body]) -> Iterator[tuple[NDArray[np.float64], float]]:
    """Yield points (N, 2) and radius of each convex part of bodies in the grid's frame (m)."""
    for body in bodies:
        if isinstance(body.shape, Disc):
            yield occupancy.frame.points_to_grid(np.array([(body.pose.x_m, body.pose.y_m)])), body.shape.radius_m
        else:
            whole = shapely.transform(body.outline, occupancy.frame.points_to_grid)
            for part in _convex_parts(whole, tuple(whole.exterior.coords)[:-1]):
                yield np.array(part), 0.0


def _inertia(obstacle: Obstacle) -> float:
    match obstacle.shape:
        case Disc(radius_m):
            return float(pymunk.moment_for_circle(obstacle.mass_kg, 0.0, radius_m))
        case Box(length_m, width_m):
            return float(pymunk.moment_for_box(obstacle.mass_kg, (length_m, width_m)))
