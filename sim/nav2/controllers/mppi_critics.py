"""MPPI's critics (nav2_mppi_controller, Jazzy): what each adds to the cost of the samples.

The first ones judge a group of samples while its track is at hand, those of the plan all groups after that, since they ask
how far along the plan any sample gets. Positions are in cells of the cost frame.
"""

import math
from typing import Any, Final, NamedTuple

from vastflow.sim.kernels.lanes import (
    WIDTH,
    any_below,
    either,
    gather,
    higher,
    load,
    lower,
    root,
    size,
    splat,
    store,
    store_cells,
    store_whole,
    whole,
)
from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.controllers.mppi_samples import BINS, ROW, SIDE, STEP, Space, rows_of
from vastflow.sim.nav2.costmaps.inflation import INSCRIBED, UNKNOWN
from vastflow.sim.nav2.costmaps.window import Window, cost_at

COLLISION: Final = 2.0**40
"""Above all costs, and the same number in 32 bits: 1e12 is greater than itself there."""
FAR: Final = 1e6
"""Coordinate of plan points that are not free (cells)."""
STRAIGHT_RADPS: Final = 1e-6
"""Slower turns count as this one."""


class Frame(NamedTuple):
    """The local costmap with a border of collision, as CostCritic or ObstaclesCritic counts it."""

    left_m: float  # left_m, bottom_m: Corner of the border, in the odom frame.
    bottom_m: float
    resolution_m: float
    columns: int
    rows: int
    column: int  # column, row: Where that lies in the window.
    row: int


@inner
def add_cost(space: Space, first: int, cost: Any) -> None:
    """Add to the costs of a group of samples."""
    store(space.costs, first, load(space.costs, first) + cost)


@inner
def cost_values(q: Any, values: Any, goal_m: float) -> None:
    """Write CostCritic's value of each cell cost."""
    # Near the goal only what is critical or collides counts, as in Nav2: goals often lie inside of the inflation.
    near_goal = goal_m < q.near_goal_distance
    # What collides by its outline is found by that.
    collides_from = INSCRIBED if q.consider_footprint == 0 else UNKNOWN
    # A table of all cell costs: the critics then read one number a point in place of branching on it.
    for cost in range(256):
        value = 0.0 if near_goal else float(cost)
        if cost > 0 and cost >= q.near_collision_cost:
            value = q.critical_cost
        values[cost] = COLLISION if cost >= collides_from else value


@inner
def obstacle_values(q: Any, values: Any, goal_m: float, steps: int) -> None:
    """Write ObstaclesCritic's value of each cell cost, which grows toward obstacles."""
    values[0] = 0.0
    for cost in range(1, 256):
        value = 0.0
        if q.inflation_radius > 0.0 and q.cost_scaling_factor > 0.0:
            # Nav2 stores no distances: the inflation layer's cost is solved for the distance to the nearest obstacle.
            away_m = math.log(INSCRIBED / cost) / q.cost_scaling_factor
            value = q.critical_weight * max(q.collision_margin_distance - away_m, 0.0)
            if goal_m >= q.near_goal_distance:
                # Nav2 takes the mean of the repulsion over the steps, but the sum of what is critical.
                value += q.repulsion_weight * (q.inflation_radius - away_m) / steps
        values[cost] = COLLISION if cost >= INSCRIBED else value


@inner
def lay_frame(out: Any, values: Any, window: Window, pose: Any) -> Frame:
    """Write the value of each cell and of a border into `out`; crop a large window round the robot."""
    left_m, bottom_m, resolution_m = window.place[0], window.place[1], window.place[2]
    # Two cells less than the frame's edge, for the border: a point off the window then reads a collision without a
    # test.
    rows, columns = min(window.costs.shape[0], SIDE - 2), min(window.costs.shape[1], SIDE - 2)
    row, column = int((pose[1] - bottom_m) / resolution_m), int((pose[0] - left_m) / resolution_m)
    row = min(max(row - rows // 2, 0), window.costs.shape[0] - rows)
    column = min(max(column - columns // 2, 0), window.costs.shape[1] - columns)
    width = columns + 2
    for c in range(width):
        out[c] = COLLISION
        out[(rows + 1) * width + c] = COLLISION
    for r in range(rows):
        begin = (r + 1) * width
        out[begin] = COLLISION
        for c in range(columns):
            out[begin + 1 + c] = values[window.costs[row + r, column + c]]
        out[begin + 1 + columns] = COLLISION
    column, row = column - 1, row - 1
    left_m, bottom_m = left_m + column * resolution_m, bottom_m + row * resolution_m
    return Frame(left_m, bottom_m, resolution_m, width, rows + 2, column, row)


@inner
def judge_cells(space: Space, first: int, points: int, stride: int, frame: Frame, weight: float, crash: float) -> None:
    """CostCritic or ObstaclesCritic: the values at `points` points of each sample, `stride` steps apart.

    A point's value of 1 adds `weight`, a collision `crash`.
    """
    track, cells = space.track, space.cells
    for p in range(points):
        k = p * stride * STEP
        store_cells(cells, p * WIDTH, load(track, k), load(track, k + ROW), frame.columns, frame.rows)
    total = splat(0.0)
    for p in range(points):
        total = total + gather(space.frame, cells, p * WIDTH)
    # A collision is far greater than all other sums in 32 bits: one comparison finds it, and it tells `_sample` as
    # well.
    store(space.touched, first, total)
    add_cost(space, first, either(total, splat(COLLISION), total * splat(weight), splat(crash)))


@inner
def judge_turns(space: Space, first: int, steps: int, scale: float, min_radius_m: float, weight: float) -> None:
    """ConstraintCritic of an Ackermann model: the excess of the samples' curvature over the maximum.

    In a step 1 m/s goes `scale` cells, and 1 m costs `weight`.
    """
    track, turns = space.track, space.turns
    # Nav2's ConstraintCritic divides the speed by the yaw rate; `least` keeps a straight step from dividing by zero.
    per_cell, least, most, none = splat(1.0 / scale), splat(STRAIGHT_RADPS), splat(min_radius_m), splat(0.0)
    x, y = load(track, 0), load(track, ROW)
    tighter = none
    for t in range(steps - 1):
        next_x, next_y = load(track, (t + 1) * STEP), load(track, (t + 1) * STEP + ROW)
        dx, dy = next_x - x, next_y - y
        x, y = next_x, next_y
        speed = root(dx * dx + dy * dy) * per_cell
        tighter = tighter + higher(most - speed / higher(size(load(turns, t * ROW)), least), none)
    add_cost(space, first, tighter * splat(weight))


@inner
def judge_goal(space: Space, first: int, steps: int, goal: Any, weight: float) -> None:
    """GoalCritic: the distances of the samples' track to the goal."""
    track = space.track
    x, y = splat(goal[0]), splat(goal[1])
    total = splat(0.0)
    for k in range(0, steps * STEP, STEP):
        dx, dy = load(track, k) - x, load(track, k + ROW) - y
        total = total + root(dx * dx + dy * dy)
    add_cost(space, first, total * splat(weight))


@inner
def judge_goal_angle(space: Space, first: int, steps: int, dt_s: float, off_rad: float, weight: float) -> None:
    """GoalAngleCritic: the angles between the samples' headings and the goal's, the first of them `off_rad`."""
    dt, off = splat(dt_s), splat(off_rad)
    # The first heading is that after the step by the measured twist, which all samples share.
    total = size(off)
    for k in range(0, (steps - 1) * ROW, ROW):
        off = off + load(space.turns, k) * dt
        total = total + size(_wrapped(off))
    add_cost(space, first, total * splat(weight))


@inner
def _wrapped(angle_rad: Any) -> Any:
    """Angles within half a turn; no robot turns 1000 times in a horizon."""
    # A whole number of turns is added before rounding, which is towards zero.
    rounds = whole(angle_rad * splat(0.5 / math.pi) + splat(1000.5)) - splat(1000.0)
    return angle_rad - rounds * splat(2.0 * math.pi)


@inner
def judge_twirling(space: Space, first: int, steps: int, w_radps: float, weight: float, power: int) -> None:
    """TwirlingCritic: the mean absolute yaw rate of the samples, the measured one included."""
    # Nav2's first control is the measured twist, which belongs to the mean.
    total = splat(abs(w_radps))
    for k in range(0, (steps - 1) * ROW, ROW):
        total = total + size(load(space.turns, k))
    add_cost(space, first, raised(total * splat(weight / steps), power))


@inner
def raised(cost: Any, power: int) -> Any:
    """The cost to a power from 1 on."""
    found = cost
    for _ in range(power - 1):
        found = found * cost
    return found


@inner
def mark(space: Space, first: int, points: int, stride: int) -> None:
    """Keep the points that PathAlignCritic compares with the plan, and how far along the track each is."""
    track, marks = space.track, space.marks
    out = rows_of(first, 3 * points)
    x, y = load(track, 0), load(track, ROW)
    # Nav2 compares by the way that the sample has gone, not by its index: slow samples meet an earlier part of the
    # plan.
    along = splat(0.0)
    for p in range(1, points + 1):
        k = p * stride * STEP
        next_x, next_y = load(track, k), load(track, k + ROW)
        dx, dy = next_x - x, next_y - y
        x, y = next_x, next_y
        along = along + root(dx * dx + dy * dy)
        store(marks, out, x)
        store(marks, out + ROW, y)
        store(marks, out + 2 * ROW, along)
        out += 3 * ROW


@inner
def mark_headings(space: Space, first: int, points: int, stride: int, yaw_rad: float, dt_s: float) -> None:
    """Keep the headings of the points of `mark`; the track's first one is `yaw_rad`."""
    out, heading, dt = rows_of(first, points), splat(yaw_rad), splat(dt_s)
    for p in range(points):
        for t in range(p * stride, (p + 1) * stride):
            heading = heading + load(space.turns, t * ROW) * dt
        store(space.headings, out + p * ROW, heading)


@inner
def lay_plan(out: Any, free: Any, window: Window, frame: Frame, plan: Any, n: int) -> None:
    """The local plan in cells, and which of its points but the last are free."""
    for i in range(n):
        out[2 * i] = (plan[i, 0] - frame.left_m) / frame.resolution_m
        out[2 * i + 1] = (plan[i, 1] - frame.bottom_m) / frame.resolution_m
    for i in range(n - 1):
        # The last point is left out, as Nav2's `findPathCosts` leaves it out.
        free[i] = cost_at(window, plan[i, 0], plan[i, 1]) < INSCRIBED


@inner
def furthest_point(space: Space, samples: int, n: int) -> int:
    """The furthest point of the plan nearest to some sample's end, sought from the furthest so far."""
    plan, ends = space.plan, space.ends
    furthest = 0
    for first in range(0, samples, WIDTH):
        end = rows_of(first, 4)
        x, y = load(ends, end), load(ends, end + ROW)
        dx, dy = splat(plan[2 * furthest]) - x, splat(plan[2 * furthest + 1]) - y
        # The furthest so far only moves on: most groups of samples end short of it, and one comparison spares all of
        # their points.
        here = dx * dx + dy * dy
        beyond = here
        for i in range(furthest + 1, n):
            dx, dy = splat(plan[2 * i]) - x, splat(plan[2 * i + 1]) - y
            beyond = lower(beyond, dx * dx + dy * dy)
        if any_below(beyond, here):
            for sample in range(first, min(first + WIDTH, samples)):
                furthest = _nearest(space, sample, furthest, n)
    return furthest


@inner
def _nearest(space: Space, sample: int, begin: int, n: int) -> int:
    """The point of the plan nearest to a sample's end, from a point on."""
    at = rows_of(sample, 4)
    x, y = space.ends[at], space.ends[at + ROW]
    nearest, found = math.inf, begin
    for i in range(begin, n):
        dx, dy = space.plan[2 * i] - x, space.plan[2 * i + 1] - y
        square = dx * dx + dy * dy
        if square < nearest:
            nearest, found = square, i
    return found


@inner
def lay_table(q: Any, space: Space, poses: Any, free: Any, lengths: Any, furthest: int) -> float:
    """The plan's first `furthest` points by the length along it, for PathAlignCritic: entries per cell, 0 where it is off."""
    if q.enabled == 0 or furthest < q.offset_from_furthest or furthest < 1:
        return 0.0
    blocked = 0
    for i in range(furthest):
        if not free[i]:
            blocked += 1
        # Nav2 gives up on aligning along a path that dynamic obstacles block; two points are let pass as noise.
        if blocked > 2 and blocked > q.max_path_occupancy_ratio * furthest:
            return 0.0
    plan = space.plan
    lengths[0] = 0.0
    for i in range(1, furthest):
        dx, dy = plan[2 * i] - plan[2 * i - 2], plan[2 * i + 1] - plan[2 * i - 1]
        lengths[i] = lengths[i - 1] + math.sqrt(dx * dx + dy * dy)
    # A table by length replaces Nav2's binary search for each mark, which would branch differently in each lane.
    entries = BINS * (furthest - 1) + 1
    scale = (entries - 1) / lengths[furthest - 1] if lengths[furthest - 1] > 0.0 else 1.0
    i, per_entry = 0, 1.0 / scale
    for entry in range(entries):
        middle = (entry + 0.5) * per_entry
        while i < furthest - 1 and middle >= 0.5 * (lengths[i] + lengths[i + 1]):
            i += 1
        # Nav2 skips points that are not free: `FAR` says so without a second table, see `judge_alignment`.
        space.table_x[entry] = plan[2 * i] if free[i] else FAR
        space.table_y[entry] = plan[2 * i + 1]
        if q.use_path_orientations != 0:
            space.table_yaw[entry] = poses[i, 2]
    return float(scale)


@inner
def judge_alignment(
    space: Space, first: int, points: int, furthest: int, scale: float, weight: float, per_rad: float
) -> None:
    """PathAlignCritic: the mean distance of the samples' marks to the plan's free points as far along it.

    A radian between their headings counts as `per_rad` cells; 0 where headings do not count.
    """
    marks, entries = space.marks, space.cells
    at = rows_of(first, 3 * points)
    # Marks beyond the furthest point are compared with it, as in Nav2.
    per_cell, last = splat(scale), splat(float(BINS * (furthest - 1)))
    for p in range(points):
        store_whole(entries, p * WIDTH, lower(load(marks, at + (3 * p + 2) * ROW) * per_cell, last))
    far, one, none = splat(0.5 * FAR), splat(1.0), splat(0.0)
    total, count = none, none
    for p in range(points):
        dx = load(marks, at + 3 * p * ROW) - gather(space.table_x, entries, p * WIDTH)
        dy = load(marks, at + (3 * p + 1) * ROW) - gather(space.table_y, entries, p * WIDTH)
        square = dx * dx + dy * dy
        if per_rad > 0.0:
            headings = rows_of(first, points) + p * ROW
            turned = _wrapped(load(space.headings, headings) - gather(space.table_yaw, entries, p * WIDTH))
            turned = turned * splat(per_rad)
            square = square + turned * turned
        # Half of FAR tells skipped points from all real distances, so that they enter neither sum nor count.
        away = root(square)
        total = total + either(away, far, away, none)
        count = count + either(away, far, one, none)
    add_cost(space, first, total / higher(count, one) * splat(weight))


@inner
def followed_point(q: Any, free: Any, furthest: int, n: int) -> int:
    """The point that PathFollowCritic wants to be near: some points beyond the furthest, and free."""
    i = min(furthest + q.offset_from_furthest, n - 1)
    # Nav2 stops at the last point but one whether that is free or not.
    while i < n - 2 and not free[i]:
        i += 1
    return int(i)


@inner
def judge_following(space: Space, first: int, point: int, weight: float) -> None:
    """PathFollowCritic: the distance of the samples' ends to a point of the plan."""
    ends = space.ends
    end = rows_of(first, 4)
    dx = load(ends, end) - splat(space.plan[2 * point])
    dy = load(ends, end + ROW) - splat(space.plan[2 * point + 1])
    add_cost(space, first, root(dx * dx + dy * dy) * splat(weight))


@inner
def judge_bearing(space: Space, first: int, point: int, mode: int, facing_rad: float, weight: float) -> None:
    """PathAngleCritic: the angle between the samples' last headings and the bearing of a point of the plan.

    With mode 2 the bearing or its opposite counts, whichever is nearer to the plan's heading there, `facing_rad`.
    """
    ends = space.ends
    end = rows_of(first, 4)
    dx = splat(space.plan[2 * point]) - load(ends, end)
    dy = splat(space.plan[2 * point + 1]) - load(ends, end + ROW)
    c, s = load(ends, end + 2 * ROW), load(ends, end + 3 * ROW)
    if mode == 2:
        along = dx * splat(math.cos(facing_rad)) + dy * splat(math.sin(facing_rad))
        dx, dy = either(along, splat(0.0), splat(0.0) - dx, dx), either(along, splat(0.0), splat(0.0) - dy, dy)
    ahead, aside = c * dx + s * dy, size(c * dy - s * dx)
    # Nav2's mode 1 has no preference: the rear is as good as the front.
    if mode == 1:
        ahead = size(ahead)
    # The angle of (ahead, aside) by the arc tangent of a slope of at most 1 (Abramowitz and Stegun 4.4.49, 1e-5 rad).
    none = splat(0.0)
    slope = lower(size(ahead), aside) / higher(higher(size(ahead), aside), splat(1e-20))
    square = slope * slope
    angle = splat(-0.0851330) + square * splat(0.0208351)
    angle = splat(0.1801410) + square * angle
    angle = splat(-0.3302995) + square * angle
    angle = slope * (splat(0.9998660) + square * angle)
    angle = either(size(ahead), aside, splat(0.5 * math.pi) - angle, angle)
    angle = either(ahead, none, splat(math.pi) - angle, angle)
    add_cost(space, first, angle * splat(weight))
