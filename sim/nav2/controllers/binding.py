"""The seam between the loop and a controller."""

from typing import Any, Final, TypeAlias

import numba
import numpy as np
from numba import types
from numba.core import cgutils

from vastflow.sim.kernels.binding import Bound, Running, Seam, calling, forwarding
from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.controllers.controller import Controller, ControllerInput, Setting
from vastflow.sim.nav2.costmaps.window import Window

RunningController: TypeAlias = Running[Controller]


_POSE: Final = (0.0, 0.0, 0.0)
_WINDOW: Final = Window(np.zeros((1, 1), dtype=np.uint8), np.zeros(3))
_GIVEN: Final = numba.typeof(
    ControllerInput(_WINDOW, np.zeros((1, 2)), 0.0, _POSE, (0.0, 0.0), np.zeros((1, 2)), 0.0, _POSE, 0.0, 0.0)
)
_COMMAND: Final = types.Tuple((types.boolean, types.float64, types.float64, types.float64))


def _whole_command(context: Any, builder: Any, kind: Any, found: Any, command: Any) -> Any:
    """Extend a command of three numbers by a lateral speed of zero."""
    given = cgutils.unpack_tuple(builder, found, len(kind))
    parts = [context.cast(builder, *each) for each in zip(given, kind, command, strict=False)]
    missing = [context.get_constant(types.float64, 0.0)] * (len(command) - len(kind))
    return context.make_tuple(builder, command, [*parts, *missing])


def _is_command(found: Any) -> bool:
    if not isinstance(found, types.BaseTuple) or len(found) not in (3, 4):
        return False
    valid, *speeds = (types.unliteral(each) for each in found)
    return valid == types.boolean and all(isinstance(each, types.Integer | types.Float) for each in speeds)


_call: Final = calling(_COMMAND, _GIVEN)
_call_memory: Final = calling(types.none)
_forward: Final = forwarding(0, _COMMAND, _GIVEN, convert=_whole_command)
_forward_reset: Final = forwarding(1, types.none)
_forward_set_plan: Final = forwarding(2, types.none)


def _compute_entry(layout: Any, given: Any) -> Any:
    return _forward(layout, given)


def _reset_entry(layout: Any) -> None:
    _forward_reset(layout)


def _set_plan_entry(layout: Any) -> None:
    _forward_set_plan(layout)


_SEAM: Final = Seam(
    "compute_velocity",
    _GIVEN,
    _is_command,
    "(valid, v, ω): a flag and two numbers",
    compute_velocity=_compute_entry,
    reset=_reset_entry,
    set_plan=_set_plan_entry,
)


def running(controller: Controller, setting: Setting) -> RunningController:
    """Return a controller with the memory of one run; raises `ContractError` as `Seam.running` does."""
    return _SEAM.running(controller, controller.memory(setting))


@inner
def compute_velocity(bound: Bound, given: ControllerInput) -> Any:
    """The controller's (valid, v, ω, vy); the loop calls it."""
    return _call(bound.entries[0], bound.table, given)


@inner
def reset(bound: Bound) -> None:
    """Tell the controller that a FollowPath action is over."""
    _call_memory(bound.entries[1], bound.table)


@inner
def set_plan(bound: Bound) -> None:
    """Tell the controller that the path is a new one."""
    _call_memory(bound.entries[2], bound.table)
