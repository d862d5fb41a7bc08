"""The robot's behavior: mission, replanning, checkers and recoveries as a state machine in the tick.

After Nav2's default trees: a plan each second, one contextual clearing for a planner or controller failure, then
the round of clear, spin, wait and back up, six times a goal at the most.
"""

import math
from typing import Any, Final

from vastflow.sim.kernels.binding import Bound
from vastflow.sim.kernels.numeric import inner
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.nav2.controllers import rotation_shim
from vastflow.sim.nav2.controllers.binding import compute_velocity, reset, set_plan
from vastflow.sim.nav2.controllers.controller import ControllerInput
from vastflow.sim.nav2.controllers.local_plan import local_plan, renew
from vastflow.sim.nav2.costmaps.window import outline_hits
from vastflow.sim.nav2.navigator import state
from vastflow.sim.nav2.navigator.latency import cycle_begins, order, order_when_computed
from vastflow.sim.nav2.navigator.state import Grids, Local, Route
from vastflow.sim.nav2.planners.binding import compute_path
from vastflow.sim.nav2.planners.navfn import cell, on_map
from vastflow.sim.nav2.planners.planner import GOAL_OUTSIDE, START_OUTSIDE, TIMEOUT, PlannerInput
from vastflow.sim.world.motion import wrapped

PASSED_M: Final = 0.7
"""RemovePassedGoals' radius in the through-poses tree."""

RETRIES: Final = 6
REPLAN_TICKS: Final = round(1.0 / TICK_S)
REPLAN_THROUGH_POSES_TICKS: Final = round(3.0 / TICK_S)
WAIT_TICKS: Final = round(5.0 / TICK_S)
ALLOWANCE_TICKS: Final = round(10.0 / TICK_S)
BEHAVIOR_TICKS: Final = 2
"""Spin and BackUp run at 10 Hz."""

CYCLE_S: Final = BEHAVIOR_TICKS * TICK_S
SPIN_RAD: Final = 1.57
BACK_UP_M: Final = 0.30
BACK_UP_MPS: Final = 0.15

INVALID_PATH, PATIENCE_EXCEEDED, FAILED_TO_MAKE_PROGRESS, CONTROLLER_TIMED_OUT = 103, 104, 105, 107
"""Nav2's error codes of FollowPath; 103 and 107 are not among those that a recovery is tried for."""

THROUGH_POSES: Final = 100
"""Offset of ComputePathThroughPoses' error codes from ComputePathToPose's."""


@inner
def behave(p: Any, m: Any, g: Grids, local: Local, route: Route, controller: Bound) -> None:
    """Set the command of this tick; between the cycles of a slower behavior the last one stands."""
    if (m.state == state.STARTING and m.first_scan == 0) or (m.state == state.PAUSING and m.tick >= m.until):
        m.attempts, m.round_robin = 0, 0
        m.planner_code, m.controller_code = 0, 0
        _resume(m)
    if m.state == state.FOLLOWING:
        _follow(p, m, g, local, route, controller)
    elif m.state == state.SPINNING and m.tick % BEHAVIOR_TICKS == 0:
        _spin(p, m, local, route.goals)
    elif m.state == state.BACKING_UP and m.tick % BEHAVIOR_TICKS == 0:
        _back_up(p, m, local, route.goals)
    elif m.state == state.WAITING and m.tick >= m.until:
        _resume(m)


@inner
def note(m: Any, kind: int, what: int, value: float) -> None:
    """An event at the true pose; beyond the buffer's end they are dropped."""
    if m.events < state.MAX_EVENTS:
        event = m.event_rows[m.events]
        event[0], event[1], event[2], event[3] = m.tick * TICK_S, kind, m.true_x, m.true_y
        event[4], event[5] = what, value
        m.events += 1


@inner
def _resume(m: Any) -> None:
    """The pipeline from its beginning: plan at once, checkers and contextual retries afresh."""
    m.state = state.FOLLOWING
    m.replan_in, m.path_n, m.plan_tick = 0, 0, m.tick
    m.plan_retries, m.follow_retries = 0, 0
    _reset_checkers(m)
    order(m, 0.0, 0.0)


@inner
def _reset_checkers(m: Any) -> None:
    _reset_progress(m)
    m.valid_tick, m.follow_tick = m.tick, m.tick
    m.latched = 0


@inner
def _reset_progress(m: Any) -> None:
    m.base_x, m.base_y, m.base_yaw, m.base_tick = m.odom_x, m.odom_y, m.odom_yaw, m.tick


@inner
def _follow(p: Any, m: Any, g: Grids, local: Local, route: Route, controller: Bound) -> None:
    """One cycle of the pipeline: replan when it is time, then the controller server's loop."""
    if m.path_n == 0:
        m.follow_tick = m.tick
    if m.replan_in > 0:
        # Nav2's RateController ticks its child anew once its period is over, counted from the last success.
        m.replan_in -= 1
    elif (m.global_current == 1 or _waited(m, m.plan_tick, p.planner_server.costmap_update_timeout)) and not _replan(
        p, m, g, route, controller
    ):
        reset(controller)
        _recover(p, m, route.goals)
        return
    if m.path_n > 0 and p.controller_server.refusal != 0:
        _control_failed(p, m, route.goals, controller, p.controller_server.refusal)
        return
    # The controller server waits for a plan, and after a clearing for the local costmap's next update.
    if m.path_n == 0 or m.local_current == 0:
        m.base_tick, m.valid_tick = m.tick, m.tick
        if m.path_n > 0 and _waited(m, m.follow_tick, p.controller_server.costmap_update_timeout):
            _control_failed(p, m, route.goals, controller, CONTROLLER_TIMED_OUT)
        return
    if not cycle_begins(p, m):
        return
    checker = p.progress_checker
    # In the odom frame, as Nav2 checks it: a jump of the localization is no progress.
    moved_m, turned_rad = math.hypot(m.odom_x - m.base_x, m.odom_y - m.base_y), wrapped(m.odom_yaw - m.base_yaw)
    if moved_m > checker.required_movement_radius or abs(turned_rad) > checker.required_movement_angle:
        _reset_progress(m)
    elif (m.tick - m.base_tick) * TICK_S > checker.movement_time_allowance:
        _control_failed(p, m, route.goals, controller, FAILED_TO_MAKE_PROGRESS)
        return
    n, end_yaw = local_plan(p, m, local.window, route.path, route.ahead)
    if n == 0:
        _control_failed(p, m, route.goals, controller, INVALID_PATH)
        return
    # Nav2 computes a command first, too; here the noise that this would draw changes all later legs of a mission.
    if _goal_reached(p, m):
        reset(controller)
        order(m, 0.0, 0.0)
        m.controller_code = 0
        note(m, state.EVENT_GOAL_REACHED, m.goal, 0.0)
        if p.mission == state.FOLLOW_WAYPOINTS:
            m.until = m.tick + round(p.waypoint_follower.waypoint_pause_duration * 1e-3 / TICK_S)
            _next_waypoint(p, m, route.goals)
        else:
            m.state, m.status = state.ENDED, state.SUCCEEDED
        return
    valid, v, w, vy = controlled(p, m, local, route, n, end_yaw, controller)
    if valid:
        m.valid_tick = m.tick
        order_when_computed(m, v, w, vy)
    elif (m.tick - m.valid_tick) * TICK_S > p.controller_server.failure_tolerance:
        _control_failed(p, m, route.goals, controller, PATIENCE_EXCEEDED)
    else:
        order(m, 0.0, 0.0)


@inner
def _waited(m: Any, since_tick: int, timeout_s: float) -> bool:
    """Whether a server has waited for a costmap until its timeout; an update in this tick was in time."""
    return bool((m.tick - since_tick) * TICK_S > timeout_s - 1e-9)


@inner
def _replan(p: Any, m: Any, g: Grids, route: Route, controller: Bound) -> bool:
    """ComputePath with its one contextual clearing; false when the pipeline has failed by it."""
    through_poses = p.mission == state.NAVIGATE_THROUGH_POSES
    code = p.planner_server.refusal
    if code == 0:
        code = plan(p, m, g, route) if m.global_current == 1 else TIMEOUT
    if code == 0:
        set_plan(controller)
        renew(p, m, route.path)
        rotation_shim.renew(p, m)
        m.planner_code, m.plan_retries = 0, 0
        m.replan_in = (REPLAN_THROUGH_POSES_TICKS if through_poses else REPLAN_TICKS) - 1
        return True
    m.planner_code = code + THROUGH_POSES if through_poses else code
    note(m, state.EVENT_PLAN_FAILED, m.planner_code, 0.0)
    if m.plan_retries == 1 or not _recoverable(m.planner_code):
        return False
    # The robot follows the path it has until the cleared costmap is current again and the planner answers.
    m.plan_retries, m.plan_tick = 1, m.tick
    _clear(m, state.CLEAR_GLOBAL)
    return True


@inner
def plan(p: Any, m: Any, g: Grids, route: Route) -> int:
    """Plan from the estimate through the remaining goals into `path`: 0, or ComputePathToPose's error code.

    A path that there was stays where planning fails.
    """
    last = m.goal
    if p.mission == state.NAVIGATE_THROUGH_POSES:
        last = route.goals.shape[0] - 1
        while m.goal < last and math.hypot(route.goals[m.goal, 0] - m.x, route.goals[m.goal, 1] - m.y) <= PASSED_M:
            m.goal += 1
    column, row = cell(g.place, m.x, m.y)
    if not on_map(g.costs, column, row):
        return START_OUTSIDE
    for k in range(m.goal, last + 1):
        goal_column, goal_row = cell(g.place, route.goals[k, 0], route.goals[k, 1])
        if not on_map(g.costs, goal_column, goal_row):
            return GOAL_OUTSIDE
    planned, start = 0, (m.x, m.y, m.yaw)
    changed = (m.changed_row0, m.changed_row1, m.changed_column0, m.changed_column1)
    m.changed_row1 = 0
    for k in range(m.goal, last + 1):
        goal = (route.goals[k, 0], route.goals[k, 1], route.goals[k, 2])
        first = max(planned - int(p.leg_overlap), 0)
        # Only a path through several goals has several legs.
        leg = k if p.mission == state.NAVIGATE_THROUGH_POSES else 0
        given = PlannerInput(g.costs, g.place, m.outline[: m.vertices], start, goal, route.draft[first:], leg, changed)
        n = compute_path(route.planner, given)
        if n < 0:
            return -n
        planned, start = first + n, goal
        route.draft[planned - 1, 2] = goal[2]
    m.end_x, m.end_y = route.draft[planned - 1, 0], route.draft[planned - 1, 1]
    for i in range(planned):
        for k in range(3):
            route.path[i, k] = route.draft[i, k]
    m.path_n, m.path_i = planned, 0
    m.goal_x, m.goal_y, m.goal_yaw = m.end_x, m.end_y, route.goals[last, 2]
    m.latched = 0
    return 0


@inner
def controlled(p: Any, m: Any, local: Local, route: Route, n: int, end_yaw: float, controller: Bound) -> Any:
    """The controller's (valid, v, ω, vy) for the local plan."""
    c, s = math.cos(m.map_odom_yaw), math.sin(m.map_odom_yaw)
    dx, dy = m.goal_x - m.map_odom_x, m.goal_y - m.map_odom_y
    goal = (c * dx + s * dy, c * dy - s * dx, wrapped(m.goal_yaw - m.map_odom_yaw))
    v, w, vy = _twist(p, m)
    pose = (m.odom_x, m.odom_y, m.odom_yaw)
    outline, dt_s = m.outline[: m.vertices], p.control_ticks * TICK_S
    if p.rotation_shim.enabled != 0:
        turns, rate = rotation_shim.turn(p, m, local.window, route.path, w, dt_s)
        if turns:
            return True, 0.0, rate, 0.0
    given = ControllerInput(
        local.window, outline, p.inscribed_radius, pose, (v, w), route.ahead[:n], end_yaw, goal, dt_s, vy
    )
    ordered = compute_velocity(controller, given)
    m.shim_w = ordered[2]
    return ordered


@inner
def _twist(p: Any, m: Any) -> Any:
    """(v, ω, vy) by odometry, with zero below the controller server's thresholds."""
    v = m.odom_v if abs(m.odom_v) > p.controller_server.min_x_velocity_threshold else 0.0
    w = m.odom_w if abs(m.odom_w) > p.controller_server.min_theta_velocity_threshold else 0.0
    vy = m.odom_vy if abs(m.odom_vy) > p.controller_server.min_y_velocity_threshold else 0.0
    return v, w, vy


@inner
def _goal_reached(p: Any, m: Any) -> bool:
    """StoppedGoalChecker: the position once, then the yaw, and the robot's rest; a new path takes the latch back."""
    q = p.goal_checker
    near = math.hypot(m.goal_x - m.x, m.goal_y - m.y) <= abs(q.xy_goal_tolerance)
    # A robot that has been near need only turn and rest; otherwise the jitter of the estimate would send it back and
    # forth.
    if near and q.stateful:
        m.latched = 1
    if not (near or m.latched == 1) or abs(wrapped(m.goal_yaw - m.yaw)) > q.yaw_goal_tolerance:
        return False
    v, w, vy = _twist(p, m)
    return bool(math.hypot(v, vy) <= q.trans_stopped_velocity and abs(w) <= q.rot_stopped_velocity)


@inner
def _next_waypoint(p: Any, m: Any, goals: Any) -> None:
    m.goal += 1
    m.state = state.PAUSING
    if m.goal == goals.shape[0]:
        m.goal = 0
        m.loop += 1
        if m.loop > p.loops:
            m.goal = goals.shape[0] - 1
            m.state, m.status = state.ENDED, state.SUCCEEDED


@inner
def _control_failed(p: Any, m: Any, goals: Any, controller: Bound, code: int) -> None:
    """FollowPath has failed; once in a pipeline the local costmap is cleared for it, then it counts."""
    reset(controller)
    order(m, 0.0, 0.0)
    m.controller_code = code
    note(m, state.EVENT_CONTROL_FAILED, code, 0.0)
    if m.follow_retries == 1 or not _recoverable(code):
        _recover(p, m, goals)
        return
    # Nav2's RecoveryNode round FollowPath has one retry; what fails after it is the pipeline's failure.
    m.follow_retries = 1
    _clear(m, state.CLEAR_LOCAL)
    _reset_checkers(m)


@inner
def _recoverable(code: int) -> bool:
    """Whether the default trees try a recovery for an error: UNKNOWN, PATIENCE, PROGRESS, NO_VALID_CONTROL; no path, timeout."""
    # What WouldAControllerRecoveryHelp, WouldAPlannerRecoveryHelp, and their like in Nav2's default trees ask for.
    return code in (100, 104, 105, 106, 200, 207, 208, 300, 307, 308)


@inner
def _clear(m: Any, what: int) -> None:
    m.recoveries += 2 if what == state.CLEAR_BOTH else 1
    note(m, state.EVENT_RECOVERY, what, 0.0)
    m.clear_local = int(what != state.CLEAR_GLOBAL)
    m.clear_global = int(what != state.CLEAR_LOCAL)


@inner
def _recover(p: Any, m: Any, goals: Any) -> None:
    """The next recovery of the round; the goal is given up when six have been used or none could help."""
    order(m, 0.0, 0.0)
    if m.attempts == RETRIES or not (_recoverable(m.controller_code) or _recoverable(m.planner_code)):
        _give_up(p, m, goals)
        return
    m.attempts += 1
    m.tried = 0
    _next_recovery(p, m, goals)


@inner
def _next_recovery(p: Any, m: Any, goals: Any) -> None:
    """Start the next recovery of the round robin, past those that fail at once."""
    order(m, 0.0, 0.0)
    if m.tried == 4:
        _give_up(p, m, goals)
        return
    # Nav2's RoundRobin goes on where it stopped, so the second failure of a mission gets another recovery than the
    # first.
    turn = m.round_robin
    m.round_robin = (turn + 1) % 4
    m.tried += 1
    m.path_n, m.done = 0, 0.0
    m.last_x, m.last_y, m.last_yaw = m.odom_x, m.odom_y, m.odom_yaw
    if turn == 0:
        _clear(m, state.CLEAR_BOTH)
        _resume(m)
        return
    m.recoveries += 1
    note(m, state.EVENT_RECOVERY, state.SPIN if turn == 1 else state.WAIT if turn == 2 else state.BACK_UP, 0.0)
    m.state = state.SPINNING if turn == 1 else state.WAITING if turn == 2 else state.BACKING_UP
    m.until = m.tick + (WAIT_TICKS if turn == 2 else ALLOWANCE_TICKS)


@inner
def _give_up(p: Any, m: Any, goals: Any) -> None:
    if p.mission == state.FOLLOW_WAYPOINTS:
        m.missed += 1
        note(m, state.EVENT_GOAL_MISSED, m.goal, 0.0)
        if p.waypoint_follower.stop_on_failure == 0:
            m.until = m.tick
            _next_waypoint(p, m, goals)
            return
    m.state, m.status = state.ENDED, state.ABORTED
    # Nav2 reports the smallest code on the blackboard that is not 0; a code stays there until its action succeeds.
    codes = m.planner_code, m.controller_code
    m.error_code = max(codes) if min(codes) == 0 else min(codes)


@inner
def _spin(p: Any, m: Any, local: Local, goals: Any) -> None:
    q = p.behavior_server
    m.done += wrapped(m.odom_yaw - m.last_yaw)
    m.last_yaw = m.odom_yaw
    # Summed over cycles, not measured from the start: a turn beyond π would look like a short one the other way.
    remaining = SPIN_RAD - abs(m.done)
    if remaining < 1e-6:
        _resume(m)
        return
    # The rate from which the robot just stops at the angle with the acceleration limit (v² = 2 a s).
    rate = math.sqrt(2.0 * q.rotational_acc_lim * remaining)
    rate = min(max(rate, q.min_rotational_vel), q.max_rotational_vel)
    if m.tick >= m.until or _spin_collides(m, local, rate, q.simulate_ahead_time):
        _next_recovery(p, m, goals)
    else:
        order(m, 0.0, rate)


@inner
def _spin_collides(m: Any, local: Local, rate: float, ahead_s: float) -> bool:
    """Nav2 looks ahead no farther than the robot has turned already, so the first look sees nothing."""
    for cycle in range(int(ahead_s / CYCLE_S)):
        change = rate * cycle * CYCLE_S
        if abs(m.done) - change <= 0.0:
            return False
        if outline_hits(local.published, m.outline[: m.vertices], m.odom_x, m.odom_y, m.odom_yaw + change):
            return True
    return False


@inner
def _back_up(p: Any, m: Any, local: Local, goals: Any) -> None:
    # The straight distance, as in Nav2's DriveOnHeading.
    m.done = math.hypot(m.odom_x - m.last_x, m.odom_y - m.last_y)
    if m.done >= BACK_UP_M:
        _resume(m)
    elif m.tick >= m.until or _back_up_collides(m, local, p.behavior_server.simulate_ahead_time):
        _next_recovery(p, m, goals)
    else:
        order(m, -BACK_UP_MPS, 0.0)


@inner
def _back_up_collides(m: Any, local: Local, ahead_s: float) -> bool:
    c, s = math.cos(m.odom_yaw), math.sin(m.odom_yaw)
    outline = m.outline[: m.vertices]
    for cycle in range(int(ahead_s / CYCLE_S)):
        change = BACK_UP_MPS * cycle * CYCLE_S
        if BACK_UP_M - m.done - change <= 0.0:
            return False
        if outline_hits(local.published, outline, m.odom_x - change * c, m.odom_y - change * s, m.odom_yaw):
            return True
    return False
