"""The controller's contract, as checks that a controller's author can call in a test."""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.binding import Bound
from vastflow.sim.kernels.conformance import REPEATED, SEED, allocations_of, guarded, least_us, must_at
from vastflow.sim.kernels.numeric import njit
from vastflow.sim.nav2.controllers.binding import RunningController, compute_velocity, reset, running, set_plan
from vastflow.sim.nav2.controllers.controller import PERIOD_S, Controller, ControllerInput, Setting
from vastflow.sim.nav2.costmaps.inflation import LETHAL, UNKNOWN, inflate
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, padded_outline
from vastflow.sim.nav2.costmaps.window import Window, outline_hits
from vastflow.sim.world.motion import arc

MOST_US: Final = 2000.0
"""CPU time of a call that a campaign can bear: 20 calls a second, and a simulated second then takes 40 ms."""

CELLS: Final = 60
RESOLUTION_M: Final = 0.05
OUTLINE: Final = padded_outline(0.22, 0.01)
_CYCLES: Final = 160
"""8 s, in which every controller that does not stop has gone farther than the walls are away."""


@dataclass(frozen=True, slots=True)
class PathMoment:
    """A moment on a path.

    Attributes:
        pose: (x, y, yaw) in the odom frame, and `twist` (v, ω).
        plan: (N, 2) path ahead; its last point is the goal, at `goal_yaw_rad`.
        boxes: Lethal (x0, y0, x1, y1), seen where the local costmap has them.
        unknown: Whether nothing is known of the cells round the robot.
    """

    name: str
    plan: NDArray[np.float64]
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    twist: tuple[float, float] = (0.0, 0.0)
    goal_yaw_rad: float = 0.0
    boxes: tuple[tuple[float, float, float, float], ...] = ()
    unknown: bool = False

    def given(self, pose: tuple[float, float, float] | None = None, twist: tuple[float, float] | None = None) -> Any:
        """Return the controller's input, by default at the moment's own pose and speed.

        The path begins at the nearest point.
        """
        pose, twist = pose or self.pose, twist or self.twist
        # On a cell grid that is fixed in the odom frame, as in a run.
        corner = [math.floor(at / RESOLUTION_M) * RESOLUTION_M - CELLS / 2 * RESOLUTION_M for at in pose[:2]]
        costs = np.full((CELLS, CELLS), UNKNOWN if self.unknown else 0, dtype=np.uint8)
        for x0, y0, x1, y1 in self.boxes:
            corners = (np.array([[x0, y0], [x1, y1]]) - corner) / RESOLUTION_M
            (left, below), (right, above) = np.clip(np.rint(corners), 0, CELLS).astype(int)
            costs[below:above, left:right] = LETHAL
        if self.boxes:
            costs = inflate(costs, RESOLUTION_M, inscribed_radius_m(OUTLINE), 0.7, 3.0)
        window = Window(costs, np.array([*corner, RESOLUTION_M]))
        first = int(np.argmin(np.hypot(*(self.plan - pose[:2]).T)))
        plan = np.column_stack([self.plan[first:], np.zeros(len(self.plan) - first)])
        plan[-1, 2] = self.goal_yaw_rad
        goal = (*self.plan[-1].tolist(), self.goal_yaw_rad)
        radius_m = inscribed_radius_m(OUTLINE)
        return ControllerInput(window, OUTLINE, radius_m, pose, twist, plan, self.goal_yaw_rad, goal, PERIOD_S, 0.0)


def line(length_m: float) -> NDArray[np.float64]:
    """A path along +x from the origin, a point every 5 cm."""
    points = np.arange(0.0, length_m + 1e-9, RESOLUTION_M)
    return np.column_stack([points, np.zeros_like(points)])


def sample_situations() -> tuple[PathMoment, ...]:
    """Situations that controllers often get wrong.

    At the goal, with the goal behind, off the path, closed in, and on a path of one point.
    """
    angles = np.linspace(0.0, math.pi / 2, 25)
    bend = np.column_stack([np.sin(angles), 1.0 - np.cos(angles)])
    box = (0.6, -1.0, 0.8, 1.0)
    return (
        PathMoment("a straight path", line(1.4)),
        PathMoment("a straight path at full speed", line(1.4), twist=(0.5, 0.1)),
        PathMoment("a bend", bend, goal_yaw_rad=math.pi / 2),
        PathMoment("off the path", line(1.4), (0.0, 0.4, -1.0)),
        PathMoment("a path behind", -line(1.4), goal_yaw_rad=math.pi),
        PathMoment("at the goal", line(0.1), (0.1, 0.0, 2.0)),
        PathMoment("on the goal", line(0.0), goal_yaw_rad=-3.0),
        PathMoment("one point, ahead", np.array([[0.3, 0.0]])),
        PathMoment("a wall across the path", line(1.4), boxes=(box,)),
        PathMoment("in a lethal cell", line(1.4), boxes=((-0.1, -0.1, 0.1, 0.1),)),
        PathMoment("nothing known", line(1.4), unknown=True),
    )


def check_controller(controller: Controller, situations: Sequence[PathMoment] | None = None) -> None:
    """Run all `CHECKS` on `controller`; raise an `AssertionError` with place, actual, and expected behavior.

    Args:
        situations: By default `sample_situations`. Add those that matter to it.
    """
    chosen = sample_situations() if situations is None else situations
    for check in CHECKS:
        check(controller, chosen)


def check_kernels(controller: Controller, situations: Sequence[PathMoment]) -> None:
    """Its parameters and memory are what kernels take, and its kernels compile and return what they should."""
    _started(controller)
    _must(controller.plan_ahead_m > 0.0, controller, f"plan_ahead_m must be > 0 m, not {controller.plan_ahead_m!r}")


def check_commands(controller: Controller, situations: Sequence[PathMoment]) -> None:
    """It raises nothing, and its commands are finite."""
    for situation in situations:
        found = _started(controller)
        for _ in range(REPEATED):
            valid, v_mps, w_radps = _commanded(found, situation.given())
            right = f"must give a finite command, or none, in {situation.name!r}, got {v_mps} m/s and {w_radps} rad/s"
            _must(not valid or (math.isfinite(v_mps) and math.isfinite(w_radps)), controller, right)


def check_determinism(controller: Controller, situations: Sequence[PathMoment]) -> None:
    """Equal memories, random numbers, and situations give equal commands to the bit, whatever ran in between."""
    alone = _drawn(_started(controller), situations)
    one, other = _started(controller), _started(controller, seed=SEED + 1)
    together = []
    for situation in situations:
        _commanded(other, situations[0].given())
        together.append(_commanded(one, situation.given()))
    right = "must command the same again. It keeps something outside of its memory, or draws from elsewhere than its stream."
    again = _drawn(_started(controller), situations)
    _must(repr(alone) == repr(together) == repr(again), controller, right)  # texts, for which NaN is NaN


def check_inputs_are_kept(controller: Controller, situations: Sequence[PathMoment]) -> None:
    """It leaves costmap, footprint and path as they are: the rest of the stack reads them."""
    for situation in situations:
        given = situation.given()
        arrays = given.window.costs, given.window.place, given.outline, given.plan
        before = [array.copy() for array in arrays]
        _commanded(_started(controller), given)
        kept = all(map(np.array_equal, before, arrays))
        _must(kept, controller, f"must not change what it is given in {situation.name!r}")


def check_allocations(controller: Controller, situations: Sequence[PathMoment]) -> None:
    """A call allocates nothing: its memory has all the room it needs."""
    for situation in situations:
        found, given = _started(controller), situation.given()
        each = allocations_of(lambda times, found=found, given=given: _commanded(found, given, times))  # type: ignore[misc]
        right = f"must allocate nothing in a call, got {each:g} allocations in {situation.name!r}. Keep arrays in its memory."
        _must(each == 0, controller, right)


def check_time(controller: Controller, situations: Sequence[PathMoment], most_us: float = MOST_US) -> None:
    """A call takes at most `most_us` of CPU time, the fastest of several."""
    for situation in situations:
        found, given = _started(controller), situation.given()
        took_us = least_us(lambda found=found, given=given: _commanded(found, given))  # type: ignore[misc]
        right = f"must take at most {most_us:g} µs a call, took {took_us:.0f} in {situation.name!r}"
        _must(took_us <= most_us, controller, right)


def check_obstacles(controller: Controller, situations: Sequence[PathMoment]) -> None:
    """Check that it never commands the footprint into a lethal cell.

    It is driven along a path into a wall, and along one too close past a corner.
    """
    for scene in (
        PathMoment("a wall across the path", line(3.0), boxes=((1.2, -2.0, 1.4, 2.0),)),
        PathMoment("a corner beside the path", line(3.0), boxes=((1.0, -1.0, 1.3, -0.1),)),
    ):
        found, pose, twist = _started(controller), scene.pose, scene.twist
        for _ in range(_CYCLES):
            given = scene.given(pose, twist)
            valid, v_mps, w_radps = _commanded(found, given)
            twist = (v_mps, w_radps) if valid else (0.0, 0.0)
            x_m, y_m, yaw_rad = arc(*pose, *twist, PERIOD_S)
            right = (
                f"must not drive into {scene.name}: v = {twist[0]:.2f} m/s, ω = {twist[1]:.2f} rad/s at x = {x_m:.2f} m"
            )
            _must(not _hits(given.window, OUTLINE, x_m, y_m, yaw_rad), controller, right)
            pose = (x_m, y_m, yaw_rad)


CHECKS: Final[tuple[Callable[[Controller, Sequence[PathMoment]], None], ...]] = (
    check_kernels,
    check_commands,
    check_determinism,
    check_inputs_are_kept,
    check_allocations,
    check_time,
    check_obstacles,
)
"""All checks, for a test that is parametrized with them and reports each on its own."""


@njit
def _repeated(bound: Bound, given: ControllerInput, times: int) -> Any:
    set_plan(bound)
    valid, v, w, _ = compute_velocity(bound, given)
    for _ in range(1, times):
        set_plan(bound)
        valid, v, w, _ = compute_velocity(bound, given)
    return valid, v, w


@njit
def _ended(bound: Bound) -> None:
    reset(bound)


@njit
def _hits(window: Window, outline: Any, x_m: float, y_m: float, yaw_rad: float) -> bool:
    return outline_hits(window, outline, x_m, y_m, yaw_rad)


def _started(controller: Controller, seed: int = SEED) -> RunningController:
    setting = Setting(CELLS, CELLS, RESOLUTION_M, 0.25, 0.25, np.array([seed], dtype=np.uint64), PERIOD_S)
    found = guarded(controller, "compute_velocity", lambda: running(controller, setting))
    guarded(controller, "reset", lambda: _ended(found.bound))
    return found


def _commanded(found: RunningController, given: ControllerInput, times: int = 1) -> tuple[bool, float, float]:
    valid, v_mps, w_radps = guarded(found.plug_in, "compute_velocity", lambda: _repeated(found.bound, given, times))
    return bool(valid), float(v_mps), float(w_radps)


def _drawn(found: RunningController, situations: Sequence[PathMoment]) -> list[tuple[bool, float, float]]:
    return [_commanded(found, situation.given()) for situation in situations]


_must = functools.partial(must_at, "compute_velocity")
