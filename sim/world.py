"""The physical world of one run: walls, obstacles and the robot's body in pymunk."""

import math
from collections.abc import Sequence

import pymunk

from vastflow.sim.obstacle import Obstacle
from vastflow.sim.pose import Pose
from vastflow.sim.recording import Event
from vastflow.sim.robot import Robot
from vastflow.sim.walls import WallIndex

ROBOT, WALL, OBSTACLE = 1, 2, 3


class World:
    """Bodies and contacts. A fresh one for every run, so that a run in a batch is a run alone.

    Walls join the space tile by tile as the robot comes near them; where it drives is all that decides which.
    """

    def __init__(self, robot: Robot, start: Pose, walls: WallIndex, obstacles: Sequence[Obstacle]) -> None:
        self._space = pymunk.Space()
        self._space.collision_slop = 0.0005
        # A step moves the body by its commanded velocity before contacts are solved, so an overlap has to be undone
        # within one step: at the default rate a robot that drives on stands 8 cm deep in the wall.
        self._space.collision_bias = 0.0
        self._walls = walls
        self._present: set[int] = set()
        self._tile: tuple[int, int] | None = None
        self._time_s = 0.0
        self._names: dict[pymunk.Shape, str] = {}
        self.contacts: list[Event] = []
        self.robot = pymunk.Body(robot.mass_kg, float("inf"))
        self.robot.position = (start.x_m, start.y_m)
        self.robot.angle = start.yaw_rad
        body = pymunk.Circle(self.robot, robot.radius_m)
        body.collision_type = ROBOT
        self._space.add(self.robot, body)
        for obstacle in obstacles:
            shape = self._obstacle(obstacle)
            self._names[shape] = obstacle.name
            self._space.add(shape)
        self._space.on_collision(ROBOT, WALL, begin=self._touch)
        self._space.on_collision(ROBOT, OBSTACLE, begin=self._touch)
        self._approach()

    def drive(self, velocities: Sequence[tuple[float, float]], dt_s: float) -> None:
        """Move by one (speed, yaw rate) per physics step; walls and obstacles block what they block.

        The velocity of a step points along the chord of the arc, so that free motion is the exact arc.
        """
        robot, space = self.robot, self._space
        for v_mps, w_radps in velocities:
            half_turn = 0.5 * w_radps * dt_s
            chord_mps = v_mps * (math.sin(half_turn) / half_turn if abs(half_turn) > 1e-6 else 1.0)
            middle = robot.angle + half_turn
            robot.velocity = (chord_mps * math.cos(middle), chord_mps * math.sin(middle))
            robot.angular_velocity = w_radps
            space.step(dt_s)
            self._time_s += dt_s
        self._approach()

    def _approach(self) -> None:
        tile = self._walls.tile_of(*self.robot.position)
        if tile == self._tile:
            return
        self._tile = tile
        for index in self._walls.around(tile):
            if index not in self._present:
                self._present.add(index)
                x0, y0, x1, y1 = self._walls.rectangles[index].tolist()
                wall = pymunk.Poly(self._space.static_body, [(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
                wall.collision_type = WALL
                self._space.add(wall)

    def _obstacle(self, obstacle: Obstacle) -> pymunk.Shape:
        shape: pymunk.Shape
        if obstacle.shape == "cylinder":
            centre = (obstacle.pose.x_m, obstacle.pose.y_m)
            shape = pymunk.Circle(self._space.static_body, obstacle.length_m / 2, centre)
        else:
            shape = pymunk.Poly(self._space.static_body, list(obstacle.footprint().exterior.coords)[:-1])
        shape.collision_type = OBSTACLE
        return shape

    def _touch(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: object) -> None:
        x_m, y_m = self.robot.position
        normal = arbiter.normal
        velocity = self.robot.velocity
        closing_mps = abs(velocity.x * normal.x + velocity.y * normal.y)
        partner = self._names.get(arbiter.shapes[1], "wall")
        self.contacts.append(Event(round(self._time_s, 3), "contact", x_m, y_m, partner, closing_mps))
