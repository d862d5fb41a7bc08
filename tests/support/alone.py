"""A controller alone: its kernel in handmade situations, and drives of an ideal unicycle."""

import math

import numpy as np

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.nav2.controllers import binding
from vastflow.sim.nav2.controllers.controller import ControllerInput, Setting
from vastflow.sim.nav2.costmaps.inflation import inflate
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, padded_outline
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.nav2.navigator.kernels import with_kernels
from vastflow.sim.world.motion import arc

CELLS, RESOLUTION_M = 60, 0.05
OUTLINE = padded_outline(0.22, 0.01)
INSCRIBED_M = inscribed_radius_m(OUTLINE)


@njit
def _commanded(bound, given):
    return binding.compute_velocity(bound, given)


@njit
def _ended(bound):
    binding.reset(bound)


def straight(length_m=1.4, bearing=0.0, start=(0.0, 0.0), spacing_m=0.025):
    """Points of a straight path."""
    along = np.arange(0.0, length_m, spacing_m)
    return np.column_stack([start[0] + along * math.cos(bearing), start[1] + along * math.sin(bearing)])


def walls(*boxes):
    """Inflated costs of a window with lethal cells in boxes (row0, row1, column0, column1)."""
    costs = np.zeros((CELLS, CELLS), dtype=np.uint8)
    for row0, row1, column0, column1 in boxes:
        costs[row0:row1, column0:column1] = 254
    return inflate(costs, RESOLUTION_M, INSCRIBED_M, 0.7, 3.0)


class Alone:
    """A controller with its memory; `corner` is that of its window of 3 × 3 m in the odom frame."""

    def __init__(self, parameters, corner=(-1.5, -1.5), seed=7, outline=OUTLINE, inscribed_m=INSCRIBED_M):
        stream = np.array([seed], dtype=np.uint64)
        setting = Setting(CELLS, CELLS, RESOLUTION_M, 0.25, 0.25, stream)
        self.running = binding.running(with_kernels(parameters), setting)
        self.memory, self.outline, self.inscribed_m = self.running.memory, outline, inscribed_m
        self.window = Window(np.zeros((CELLS, CELLS), dtype=np.uint8), np.array([*corner, RESOLUTION_M]))

    def reset(self):
        _ended(self.running.bound)

    def given(self, plan, costs=None, pose=(0.0, 0.0, 0.0), twist=(0.0, 0.0), goal=None, end_yaw=None, lateral=0.0):
        """The controller's input; the plan ends at the goal, and with its heading, unless told otherwise."""
        window = self.window if costs is None else self.window._replace(costs=costs)
        goal = tuple(map(float, (*plan[-1][:2], 0.0) if goal is None else goal))
        pose, twist = tuple(map(float, pose)), tuple(map(float, twist))
        end_yaw = float(goal[2] if end_yaw is None else end_yaw)
        plan = np.ascontiguousarray(plan, dtype=float)
        return ControllerInput(window, self.outline, self.inscribed_m, pose, twist, plan, end_yaw, goal, 0.05, lateral)

    def command(self, *arguments, **values):
        """(valid, v, ω, vy) in a situation, see `given`."""
        return _commanded(self.running.bound, self.given(*arguments, **values))

    def drive(self, path, pose, seconds, goal_yaw=0.0, lethal=lambda x, y: np.zeros(x.shape, dtype=bool)):
        """Rows (x, y, yaw, valid, v, ω) at 20 Hz, until the goal checker of Nav2's defaults is content.

        `lethal` says of the centers (x, y) of cells whether they are.
        """
        rows, twist = [], (0.0, 0.0)
        centers = (np.arange(CELLS) + 0.5) * RESOLUTION_M
        for tick in range(int(seconds * 20)):
            if tick % 4 == 0:
                corner = [(math.floor(at / RESOLUTION_M) - CELLS // 2) * RESOLUTION_M for at in pose[:2]]
                costs = np.where(lethal(*np.meshgrid(corner[0] + centers, corner[1] + centers)), 254, 0)
                costs = inflate(costs.astype(np.uint8), RESOLUTION_M, self.inscribed_m, 0.55, 3.0)
                self.window = Window(costs, np.array([*corner, RESOLUTION_M]))
            nearest = int(np.argmin(np.hypot(*(path - pose[:2]).T)))
            near = np.hypot(*(path[nearest:] - pose[:2]).T) < 1.4
            end = nearest + (len(near) if near.all() else max(int(np.argmin(near)), 1))
            end_yaw = goal_yaw if end == len(path) else 0.0
            valid, *twist, _ = self.command(
                path[nearest:end], pose=pose, twist=twist, goal=(*path[-1], goal_yaw), end_yaw=end_yaw
            )
            rows.append((*pose, valid, *twist))
            pose = arc(*pose, *twist, 0.05)
            if math.dist(pose[:2], path[-1]) <= 0.25 and abs(math.remainder(goal_yaw - pose[2], math.tau)) <= 0.25:
                break
        return np.array(rows, dtype=float)
