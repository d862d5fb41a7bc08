"""The controller in use: a stack is compiled for the one it has, and no other."""

from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import OPTIONS
from vastflow.sim.nav.controllers import dwb, mppi, rpp
from vastflow.sim.nav.parameters.dwb import DwbParameters
from vastflow.sim.nav.parameters.mppi import MppiParameters
from vastflow.sim.nav.parameters.stack import NavParameters
from vastflow.sim.nav.record import record_of
from vastflow.sim.nav.window import Window


class Mppi(NamedTuple):
    """Model Predictive Path Integral control: its parameters, (1,) record, and its memory."""

    parameters: Any
    memory: Any


class Dwb(NamedTuple):
    """The dynamic window approach: its parameters, (1,) record, and its memory."""

    parameters: Any
    memory: Any


class Rpp(NamedTuple):
    """Regulated Pure Pursuit: its parameters, (1,) record, and its memory."""

    parameters: Any
    memory: Any


Controller: TypeAlias = Mppi | Dwb | Rpp


def controller_of(parameters: NavParameters, window: Window, stream: NDArray[np.uint64]) -> Controller:
    """The controller that the parameters name, for a local costmap, its random numbers from `stream` (1,)."""
    chosen = parameters.controller
    record = record_of(chosen)
    if isinstance(chosen, MppiParameters):
        return Mppi(record, mppi.new_memory(chosen, stream))
    if isinstance(chosen, DwbParameters):
        return Dwb(record, dwb.new_memory(chosen, *window.costs.shape))
    return Rpp(record, rpp.new_memory(parameters.goal_checker.xy_goal_tolerance))


def command(
    controller: Controller,
    window: Any,
    outline: Any,
    inscribed_radius_m: float,
    pose: Any,
    twist: Any,
    plan: Any,
    n: int,
    end_yaw_rad: float,
    goal: Any,
) -> Any:
    """The controller's (valid, v, ω); kernels call it, and the controller's type decides which one is compiled.

    Args:
        window: Local costmap.
        outline: (16, 2) padded footprint in the robot's frame.
        pose, twist: (x, y, yaw) in the odom frame and (v, ω) by odometry.
        plan: (M, 2) local plan in the odom frame, `n` points of it.
        end_yaw_rad, goal: Yaw of the local plan's end, and final pose (x, y, yaw) of the whole plan.
    """
    raise NotImplementedError("kernels call this")


def reset(controller: Controller) -> None:
    """Forget what one FollowPath action taught the controller; kernels call it."""
    raise NotImplementedError("kernels call this")


def take_new_path(controller: Controller) -> None:
    """Be told that the path is a new one: MPPI goes on as it was, the others forget; kernels call it."""
    raise NotImplementedError("kernels call this")


@overload(command, jit_options=OPTIONS)
def _command(
    controller: Any,
    window: Any,
    outline: Any,
    inscribed_radius_m: Any,
    pose: Any,
    twist: Any,
    plan: Any,
    n: Any,
    end_yaw_rad: Any,
    goal: Any,
) -> Any:
    of_this_type = _module_of(controller).command

    def call(
        controller: Any,
        window: Any,
        outline: Any,
        inscribed_radius_m: Any,
        pose: Any,
        twist: Any,
        plan: Any,
        n: Any,
        end_yaw_rad: Any,
        goal: Any,
    ) -> Any:
        q = controller.parameters[0]
        return of_this_type(
            q, controller.memory, window, outline, inscribed_radius_m, pose, twist, plan, n, end_yaw_rad, goal
        )

    return call


@overload(reset, jit_options=OPTIONS)
def _reset(controller: Any) -> Any:
    of_this_type = _module_of(controller).reset

    def call(controller: Any) -> None:
        of_this_type(controller.memory)

    return call


@overload(take_new_path, jit_options=OPTIONS)
def _take_new_path(controller: Any) -> Any:
    if controller.instance_class is not Mppi:
        return _reset(controller)

    def call(controller: Any) -> None:
        pass

    return call


def _module_of(controller: Any) -> Any:
    return {Mppi: mppi, Dwb: dwb, Rpp: rpp}[controller.instance_class]
