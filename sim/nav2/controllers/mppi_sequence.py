"""MPPI's control sequence: limited, steered, smoothed and shifted (nav2_mppi_controller, Jazzy)."""

from typing import Any, Final

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.world.motion import steered

UNSMOOTHED: Final = 20
"""A sequence of no more steps than this is left as it is."""


@inner
def limit(q: Any, sequence: Any) -> None:
    """Limit the speeds of the sequence, and their changes from step to step."""
    rise, fall, turn = q.model_dt * q.ax_max, -q.model_dt * q.ax_min, q.model_dt * q.az_max
    last_v, last_w = 0.0, 0.0
    for t in range(sequence.shape[1]):
        v = min(max(sequence[0, t], q.vx_min), q.vx_max)
        w = min(max(sequence[1, t], -q.wz_max), q.wz_max)
        if t > 0:
            slower, faster = (fall, rise) if last_v > 0.0 else (rise, fall)
            v = min(max(v, last_v - slower), last_v + faster)
            w = min(max(w, last_w - turn), last_w + turn)
        sequence[0, t], sequence[1, t] = v, w
        last_v, last_w = v, w


@inner
def limit_lateral(q: Any, sequence: Any) -> None:
    """Limit an omni model's speed to the left, see `limit`."""
    rise, fall = q.model_dt * q.ay_max, -q.model_dt * q.ay_min
    last = 0.0
    for t in range(sequence.shape[1]):
        vy = min(max(sequence[2, t], -q.vy_max), q.vy_max)
        if t > 0:
            slower, faster = (fall, rise) if last > 0.0 else (rise, fall)
            vy = min(max(vy, last - slower), last + faster)
        sequence[2, t] = vy
        last = vy


@inner
def steer(sequence: Any, min_turning_radius_m: float) -> None:
    """AckermannMotionModel: no step of the sequence turns tighter than the least radius."""
    for t in range(sequence.shape[1]):
        sequence[1, t] = steered(sequence[0, t], sequence[1, t], min_turning_radius_m)


@inner
def smooth(sequence: Any, history: Any, line: Any, shift: int) -> None:
    """Savitzky-Golay (9 points, quadratic) over all steps but the last, and the command that comes of it into `history`.

    On their left stand the last four commands, on their right the last step as often as needed.
    """
    count = sequence.shape[1] - 1
    if count < UNSMOOTHED:
        return
    for axis in range(sequence.shape[0]):
        for i in range(4):
            line[i] = history[axis, i]
        for t in range(count + 4):
            line[t + 4] = sequence[axis, min(t, count)]
        for t in range(count):
            total = 59.0 * line[t + 4] + 54.0 * (line[t + 3] + line[t + 5]) + 39.0 * (line[t + 2] + line[t + 6])
            total += 14.0 * (line[t + 1] + line[t + 7]) - 21.0 * (line[t] + line[t + 8])
            sequence[axis, t] = total / 231.0
        for i in range(3):
            history[axis, i] = history[axis, i + 1]
        history[axis, 3] = sequence[axis, shift]


@inner
def shifted(sequence: Any) -> None:
    """Move the sequence on by a step, its last one stands twice."""
    for axis in range(sequence.shape[0]):
        for t in range(1, sequence.shape[1]):
            sequence[axis, t - 1] = sequence[axis, t]
