"""State of the MPPI controller from cycle to cycle, and its working space."""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.nav2.controllers.mppi_critics import BINS, SIDE
from vastflow.sim.nav2.controllers.mppi_samples import ROW, aligned, lateral_noise, noise
from vastflow.sim.nav2.parameters.mppi import MppiParameters

PLAN_POINTS: Final = 1024


class MppiMemory(NamedTuple):
    """State and working space of the controller, of steps T.

    Attributes:
        sequence: (2, T) float64, the control sequence: v and ω. (3, T) of an omni model: vy as well.
        history: (2, 4) or (3, 4) float64, the last commands.
        stream: (1,) uint64.
        next_noise: (1,) int64, where the next cycle's noise may begin.
        noise, lateral_noise: (N,) uint32 and float32, read-only and shared; none of the second but of an omni model.
        values: (256,) float32, cost by the costmap's cost.
        lengths, free: (n,) float64 and bool: of the plan's points the length so far, and whether they are free.
        line: (T + 8,) float64, what is smoothed.
        circumscribed_cost: (1,) float64, see `Setting`.
        near, lethal, yaws: See `mppi_outlines.Room`; empty where no outline is looked at.
        min_turning_radius_m: (1,) float64 of an Ackermann model; 0 of one that turns on the spot.
        goal_tolerance_m: (1,) float64, the goal checker's `xy_goal_tolerance`.
        unlimited_mps: (3,) float64, `vx_min`, `vx_max` and `vy_max` without a speed limit.

    The others are `mppi_samples.Space`.
    """

    sequence: Any
    history: Any
    stream: Any
    next_noise: Any
    noise: Any
    values: Any
    lengths: Any
    free: Any
    line: Any
    circumscribed_cost: Any
    near: Any
    lethal: Any
    yaws: Any
    min_turning_radius_m: Any
    goal_tolerance_m: Any
    unlimited_mps: Any
    lateral_noise: Any
    lateral_center: Any
    lateral_sums: Any
    center: Any
    turns: Any
    track: Any
    ends: Any
    marks: Any
    cells: Any
    frame: Any
    touched: Any
    costs: Any
    weights: Any
    plan: Any
    table_x: Any
    table_y: Any
    sums: Any
    headings: Any
    table_yaw: Any


def new_memory(
    parameters: MppiParameters,
    stream: NDArray[np.uint64],
    circumscribed_cost: float = 0.0,
    goal_tolerance_m: float = 0.0,
) -> MppiMemory:
    """Memory of a controller that draws from `stream` (1,).

    Args:
        circumscribed_cost: See `Setting`; every outline is looked at where it is 0.
        goal_tolerance_m: See `MppiMemory`.
    """
    steps, groups = parameters.time_steps, math.ceil(parameters.batch_size / ROW)
    is_ackermann = parameters.motion_model == "Ackermann"
    min_turning_radius_m = parameters.AckermannConstraints.min_turning_r if is_ackermann else 0.0
    is_omni = parameters.motion_model == "Omni"
    frame_cells = SIDE * SIDE if parameters.CostCritic.consider_footprint else 0
    axes, lateral_steps = (3, steps) if is_omni else (2, 0)
    marks = (steps - 1) // parameters.PathAlignCritic.trajectory_point_step
    oriented = int(parameters.PathAlignCritic.use_path_orientations)
    stride = 1 if parameters.ObstaclesCritic.enabled else parameters.CostCritic.trajectory_point_step
    cells = (steps - 1) // stride + 1

    def rows(count: int) -> NDArray[np.float32]:
        return aligned(ROW * count, np.float32)

    return MppiMemory(
        sequence=np.zeros((axes, steps)),
        history=np.zeros((axes, 4)),
        stream=stream,
        next_noise=np.zeros(1, dtype=np.int64),
        noise=noise(ROW * steps * groups, parameters.vx_std, parameters.wz_std),
        lateral_noise=lateral_noise(ROW * lateral_steps * groups, parameters.vy_std),
        lateral_center=aligned(2 * lateral_steps, np.float32),
        lateral_sums=rows(lateral_steps),
        values=np.zeros(256, dtype=np.float32),
        lengths=np.zeros(PLAN_POINTS),
        free=np.zeros(PLAN_POINTS, dtype=np.bool_),
        line=np.zeros(steps + 8),
        circumscribed_cost=np.array([circumscribed_cost]),
        near=np.zeros(frame_cells, dtype=np.uint8),
        lethal=np.zeros(frame_cells, dtype=np.int32),
        yaws=rows(cells),
        min_turning_radius_m=np.array([min_turning_radius_m]),
        goal_tolerance_m=np.array([goal_tolerance_m]),
        unlimited_mps=np.array([parameters.vx_min, parameters.vx_max, parameters.vy_max]),
        center=aligned(4 * steps, np.float32),
        turns=rows(steps),
        track=rows(2 * steps),
        ends=rows(4 * groups),
        marks=rows(3 * marks * groups),
        cells=aligned(ROW * max(cells, marks), np.uint16),
        frame=np.zeros(SIDE * SIDE, dtype=np.float32),
        touched=rows(groups),
        costs=rows(groups),
        weights=rows(groups),
        plan=aligned(2 * PLAN_POINTS, np.float32),
        table_x=aligned(BINS * PLAN_POINTS, np.float32),
        table_y=aligned(BINS * PLAN_POINTS, np.float32),
        sums=rows(2 * steps),
        headings=rows(oriented * marks * groups),
        table_yaw=aligned(oriented * BINS * PLAN_POINTS, np.float32),
    )
