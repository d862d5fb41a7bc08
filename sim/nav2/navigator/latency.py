"""Latency of odometry to the stack, and of the controller's commands to the velocity smoother.

Times are counted in physics steps of 10 ms. All draws are from a stream of their own, and a stack without latency draws nothing.
"""

import math
from typing import Any, Final

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.streams import LATENCY, uniform
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.nav2.navigator.state import ODOMETRY_STEPS, SUBSTEPS
from vastflow.sim.system.robot import OLDEST_S, PHYSICS_HZ

STEP_S: Final = TICK_S / SUBSTEPS

TWIST_STEPS: Final = 3
"""Odometry reports the mean of its last steps, about 30 ms."""


@inner
def draw_phases(p: Any, m: Any) -> None:
    """When in a tick the smoother runs, and when odometry is sampled."""
    q = p.latency
    if q.odometry_rate < PHYSICS_HZ:
        m.odometry_phase = uniform(m.streams[LATENCY]) * PHYSICS_HZ / q.odometry_rate
    if q.smoother_in_step == 0:
        m.smoother_step = int(uniform(m.streams[LATENCY]) * SUBSTEPS)


@inner
def delay(m: Any, least_s: float, jitter_s: float) -> float:
    """An age drawn: at least `least_s`, and `OLDEST_S` at the most."""
    if jitter_s > 0.0:
        least_s -= jitter_s * math.log(1.0 - uniform(m.streams[LATENCY]))
    return min(least_s, OLDEST_S)


@inner
def _steps(duration_s: float) -> int:
    return math.ceil(duration_s / STEP_S - 1e-9)


@inner
def count_step(m: Any, step: int, v_mps: float, w_radps: float, vy_mps: float) -> None:
    row = m.odometry[step % ODOMETRY_STEPS]
    row[0], row[1], row[2] = m.counted_x, m.counted_y, m.counted_yaw
    row[3], row[4], row[5] = v_mps, w_radps, vy_mps


@inner
def receive_odometry(p: Any, m: Any, step: int) -> None:
    """The newest sample that has arrived after so many steps is the stack's odometry; samples don't overtake each other."""
    q = p.latency
    period = PHYSICS_HZ / q.odometry_rate
    arrived = step - _steps(delay(m, q.tf_age, q.tf_jitter))
    number = math.ceil((arrived + 1 - m.odometry_phase) / period) - 1
    sampled = math.floor(number * period + m.odometry_phase)
    m.odometry_step = max(m.odometry_step, sampled)
    row = m.odometry[m.odometry_step % ODOMETRY_STEPS]
    m.odom_x, m.odom_y, m.odom_yaw = row[0], row[1], row[2]
    m.odom_v, m.odom_w, m.odom_vy = 0.0, 0.0, 0.0
    for k in range(TWIST_STEPS):
        row = m.odometry[(m.odometry_step + 1 - TWIST_STEPS + k) % ODOMETRY_STEPS]
        m.odom_v += row[3] / TWIST_STEPS
        m.odom_w += row[4] / TWIST_STEPS
        m.odom_vy += row[5] / TWIST_STEPS


@inner
def order(m: Any, v_mps: float, w_radps: float) -> None:
    """Command at once, without lateral speed; drop the controller's pending command."""
    m.command_v, m.command_w, m.command_vy, m.command_tick = v_mps, w_radps, 0.0, m.tick
    m.pending_step = -1


@inner
def order_when_computed(m: Any, v_mps: float, w_radps: float, vy_mps: float) -> None:
    """Command as soon as the controller has computed: now, if that takes no time."""
    if m.busy_step <= m.tick * SUBSTEPS:
        order(m, v_mps, w_radps)
        m.command_vy = vy_mps
        return
    m.pending_v, m.pending_w, m.pending_vy, m.pending_step = v_mps, w_radps, vy_mps, m.busy_step


@inner
def receive_command(m: Any, step: int) -> None:
    """The velocity smoother gets the command that the controller has computed after so many steps of the run."""
    if m.pending_step >= 0 and m.pending_step <= step:
        order(m, m.pending_v, m.pending_w)
        m.command_vy = m.pending_vy


@inner
def cycle_begins(p: Any, m: Any) -> bool:
    """True if the controller begins a cycle in this tick.

    A cycle that is due during computation begins right after it.
    """
    if m.tick % p.control_ticks == 0:
        m.cycle_due = 1
    if m.cycle_due == 0 or m.tick * SUBSTEPS < m.busy_step:
        return False
    receive_command(m, m.tick * SUBSTEPS)
    m.cycle_due = 0
    if p.late == 0:
        return True
    q = p.latency
    if q.missed_cycles > 0.0 and uniform(m.streams[LATENCY]) < q.missed_cycles:
        return False
    m.busy_step = m.tick * SUBSTEPS + _steps(delay(m, q.controller_time, q.controller_jitter))
    return True
