"""What the robot does next: mission, replanning, checkers and recoveries as a state machine in the tick.

After Nav2's default trees: a plan each second, one contextual clearing for a planner or controller failure, then
the round of clear, spin, wait and back up, six times a goal at the most.
"""

import math
from typing import Any, Final

from vastflow.sim.nav.planning import plan
from vastflow.sim.nav.rpp import outline_hits, pursue
from vastflow.sim.nav.state import (
    ABORTED,
    BACK_UP,
    BACKING_UP,
    CLEAR_BOTH,
    CLEAR_GLOBAL,
    CLEAR_LOCAL,
    ENDED,
    EVENT_CONTROL_FAILED,
    EVENT_GOAL_MISSED,
    EVENT_GOAL_REACHED,
    EVENT_PLAN_FAILED,
    EVENT_RECOVERY,
    FOLLOW_WAYPOINTS,
    FOLLOWING,
    MAX_EVENTS,
    NAVIGATE_THROUGH_POSES,
    PAUSING,
    SPIN,
    SPINNING,
    STARTING,
    SUCCEEDED,
    TICK_S,
    WAIT,
    WAITING,
    Grids,
    Route,
)
from vastflow.sim.numeric import inner
from vastflow.sim.robot import wrapped

RETRIES: Final = 6
REPLAN_TICKS: Final = round(1.0 / TICK_S)
REPLAN_THROUGH_POSES_TICKS: Final = round(3.0 / TICK_S)
PAUSE_TICKS: Final = round(0.2 / TICK_S)
WAIT_TICKS: Final = round(5.0 / TICK_S)
ALLOWANCE_TICKS: Final = round(10.0 / TICK_S)
SPIN_RAD: Final = 1.57
BACK_UP_M: Final = 0.30
BACK_UP_MPS: Final = 0.15
LOOK_AHEAD_S: Final = 2.0

PATIENCE_EXCEEDED, FAILED_TO_MAKE_PROGRESS, NO_VALID_PATH = 104, 105, 208
"""Nav2's error codes of the controller and the planner."""


@inner
def behave(p: Any, m: Any, g: Grids, route: Route) -> Any:
    """The command (v, ω) of this tick."""
    if m.state == STARTING and m.first_scan == 0:
        _begin_goal(m)
    if m.state == PAUSING and m.tick >= m.until:
        _begin_goal(m)
    if m.state == FOLLOWING:
        return _follow(p, m, g, route)
    if m.state == SPINNING:
        return _spin(p, m, route.goals)
    if m.state == BACKING_UP:
        return _back_up(p, m, route.goals)
    if m.state == WAITING and m.tick >= m.until:
        _resume(m)
    return 0.0, 0.0


@inner
def note(m: Any, kind: int, what: int, value: float) -> None:
    """An event at the true pose; beyond the buffer's end they are dropped."""
    if m.events < MAX_EVENTS:
        event = m.event_rows[m.events]
        event[0], event[1], event[2], event[3] = m.tick * TICK_S, kind, m.true_x, m.true_y
        event[4], event[5] = what, value
        m.events += 1


@inner
def _begin_goal(m: Any) -> None:
    m.attempts, m.round_robin = 0, 0
    m.planned_goal = -1
    m.path_n = 0
    _resume(m)


@inner
def _resume(m: Any) -> None:
    """The pipeline from its beginning: plan at once, checkers and contextual retries afresh."""
    m.state = FOLLOWING
    m.replan_in = 0
    m.path_n = 0
    m.plan_retries = 0
    m.follow_retries = 0
    _reset_checkers(m)


@inner
def _reset_checkers(m: Any) -> None:
    m.base_x, m.base_y, m.base_tick = m.odom_x, m.odom_y, m.tick
    m.valid_tick = m.tick
    m.latched = 0


@inner
def _follow(p: Any, m: Any, g: Grids, route: Route) -> Any:
    if m.replan_in <= 0:
        if plan(p, m, g, route):
            m.plan_retries = 0
            m.replan_in = REPLAN_THROUGH_POSES_TICKS if p.mission == NAVIGATE_THROUGH_POSES else REPLAN_TICKS
        else:
            note(m, EVENT_PLAN_FAILED, NO_VALID_PATH, 0.0)
            if m.plan_retries == 1:
                return _recover(p, m, route.goals, NO_VALID_PATH)
            m.plan_retries = 1
            _clear(m, CLEAR_GLOBAL)
            m.replan_in = REPLAN_TICKS  # the cleared costmap is current again after its next update
    m.replan_in -= 1
    if m.path_n == 0:
        m.base_tick, m.valid_tick = m.tick, m.tick
        return 0.0, 0.0
    if _goal_reached(p, m):
        _goal_done(p, m, route.goals)
        return 0.0, 0.0
    if math.hypot(m.odom_x - m.base_x, m.odom_y - m.base_y) > p.required_movement_radius:
        m.base_x, m.base_y, m.base_tick = m.odom_x, m.odom_y, m.tick
    elif (m.tick - m.base_tick) * TICK_S > p.movement_time_allowance:
        return _control_failed(p, m, route.goals, FAILED_TO_MAKE_PROGRESS)
    valid, v, w = pursue(p, m, route.path)
    if valid:
        m.valid_tick = m.tick
        return v, w
    if (m.tick - m.valid_tick) * TICK_S > p.failure_tolerance:
        return _control_failed(p, m, route.goals, PATIENCE_EXCEEDED)
    return 0.0, 0.0


@inner
def _goal_reached(p: Any, m: Any) -> bool:
    """SimpleGoalChecker, stateful: the position once, then the yaw; a new path takes the latch back."""
    if m.latched == 0 and math.hypot(m.goal_x - m.x, m.goal_y - m.y) <= p.xy_goal_tolerance:
        m.latched = 1
    return bool(m.latched == 1 and abs(wrapped(m.goal_yaw - m.yaw)) <= p.yaw_goal_tolerance)


@inner
def _goal_done(p: Any, m: Any, goals: Any) -> None:
    note(m, EVENT_GOAL_REACHED, m.goal, 0.0)
    if p.mission == FOLLOW_WAYPOINTS:
        _next_waypoint(p, m, goals)
    else:
        m.state, m.status = ENDED, SUCCEEDED


@inner
def _next_waypoint(p: Any, m: Any, goals: Any) -> None:
    m.goal += 1
    if m.goal == goals.shape[0]:
        m.goal = 0
        m.loop += 1
        if m.loop > p.loops:
            m.goal = goals.shape[0] - 1
            m.state, m.status = ENDED, SUCCEEDED
            return
    m.state, m.until = PAUSING, m.tick + PAUSE_TICKS


@inner
def _control_failed(p: Any, m: Any, goals: Any, code: int) -> Any:
    note(m, EVENT_CONTROL_FAILED, code, 0.0)
    if m.follow_retries == 1:
        return _recover(p, m, goals, code)
    m.follow_retries = 1
    _clear(m, CLEAR_LOCAL)
    _reset_checkers(m)
    return 0.0, 0.0


@inner
def _clear(m: Any, what: int) -> None:
    m.recoveries += 1
    note(m, EVENT_RECOVERY, what, 0.0)
    m.clear_local = int(what != CLEAR_GLOBAL)
    m.clear_global = int(what != CLEAR_LOCAL)


@inner
def _recover(p: Any, m: Any, goals: Any, code: int) -> Any:
    """The next recovery of the round; the goal is given up when six have been used."""
    m.pending_code = code
    if m.attempts == RETRIES:
        return _give_up(p, m, goals)
    m.attempts += 1
    m.tried = 0
    return _next_recovery(p, m, goals)


@inner
def _next_recovery(p: Any, m: Any, goals: Any) -> Any:
    if m.tried == 4:
        return _give_up(p, m, goals)
    turn = m.round_robin
    m.round_robin = (turn + 1) % 4
    m.tried += 1
    m.path_n = 0
    m.done = 0.0
    m.last_x, m.last_y, m.last_yaw = m.odom_x, m.odom_y, m.odom_yaw
    if turn == 0:
        _clear(m, CLEAR_BOTH)
        _resume(m)
        return 0.0, 0.0
    m.recoveries += 1
    note(m, EVENT_RECOVERY, SPIN if turn == 1 else WAIT if turn == 2 else BACK_UP, 0.0)
    m.state = SPINNING if turn == 1 else WAITING if turn == 2 else BACKING_UP
    m.until = m.tick + (WAIT_TICKS if turn == 2 else ALLOWANCE_TICKS)
    return 0.0, 0.0


@inner
def _give_up(p: Any, m: Any, goals: Any) -> Any:
    if p.mission == FOLLOW_WAYPOINTS:
        m.missed += 1
        note(m, EVENT_GOAL_MISSED, m.goal, 0.0)
        _next_waypoint(p, m, goals)
    else:
        m.state, m.status, m.error_code = ENDED, ABORTED, m.pending_code
    return 0.0, 0.0


@inner
def _spin(p: Any, m: Any, goals: Any) -> Any:
    m.done += abs(wrapped(m.odom_yaw - m.last_yaw))
    m.last_yaw = m.odom_yaw
    remaining = SPIN_RAD - m.done
    if remaining <= 0.0:
        _resume(m)
        return 0.0, 0.0
    if m.tick >= m.until or outline_hits(p, m, m.odom_x, m.odom_y):
        return _next_recovery(p, m, goals)
    return 0.0, min(max(math.sqrt(2.0 * 3.2 * remaining), 0.4), 1.0)


@inner
def _back_up(p: Any, m: Any, goals: Any) -> Any:
    m.done = math.hypot(m.odom_x - m.last_x, m.odom_y - m.last_y)
    if m.done >= BACK_UP_M:
        _resume(m)
        return 0.0, 0.0
    if m.tick >= m.until:
        return _next_recovery(p, m, goals)
    ahead_m = min(LOOK_AHEAD_S * BACK_UP_MPS, BACK_UP_M - m.done)
    step = 0.0
    while step < ahead_m:
        step += p.resolution
        x, y = m.odom_x - step * math.cos(m.odom_yaw), m.odom_y - step * math.sin(m.odom_yaw)
        if outline_hits(p, m, x, y):
            return _next_recovery(p, m, goals)
    return -BACK_UP_MPS, 0.0
