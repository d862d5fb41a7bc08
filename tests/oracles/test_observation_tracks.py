"""Tracks of obstacles from the events of a recording, and clearances from them."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.observation.obstacle_tracks import obstacle_tracks_of
from vastflow.oracles.observation.situation import Situation
from vastflow.sim.model.obstacle import Obstacle, Trigger
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run

AWAY = (math.inf, math.inf)
HERE = (3.0, 0.0)


def carton(name="carton", x_m=3.0, *, appears=True):
    return Obstacle(name, "box", Pose(x_m, 0.0), 0.5, 0.5, Trigger(x_m, 0.0, 1.0) if appears else None)


def event(t_s, kind, x_m=3.0, y_m=0.0, what="carton", value=0.0):
    return Event(t_s, kind, x_m, y_m, what, value)


def found(obstacles, *events):
    run = Run(0, "1", "succeeded", 0, "", 10.0, 5.0, 0, 0, events)
    return obstacle_tracks_of(Situation(None, (), tuple(obstacles)), run)


def places(track, t_s):
    return [tuple(xy) for xy in track.at(np.array([round(t * 1000) for t in t_s], dtype=np.int32)).tolist()]


STANDS, APPEARS, SPAWNED = carton(appears=False), carton(), event(2.0, "spawned")


@each_row(
    ("obstacle", "events", "t_s", "at", "appears_s"),
    [
        (STANDS, [], (0.0, 9.0), [HERE, HERE], None),
        (APPEARS, [SPAWNED], (0.0, 1.9, 2.0, 9.0), [AWAY, AWAY, HERE, HERE], 2.0),
        (APPEARS, [event(0.0, "spawned")], (0.0,), [HERE], None),  # from the start
        (APPEARS, [event(2.0, "contact", value=0.2)], (0.0, 9.0), [AWAY, AWAY], None),  # never appeared
        (
            APPEARS,
            [SPAWNED, event(3.1, "obstacle_moved", 3.05), event(3.2, "obstacle_moved", 3.1)],
            (3.0, 3.1, 3.2, 8.0),
            [HERE, (3.05, 0.0), (3.1, 0.0), (3.1, 0.0)],
            2.0,
        ),
        (
            STANDS,
            [event(1.0, "deleted"), event(4.0, "spawned", 1.0, 1.0), event(5.0, "deleted", 1.0, 1.0)],
            (0.9, 1.0, 4.0, 5.0),
            [HERE, AWAY, (1.0, 1.0), AWAY],
            None,
        ),
        (APPEARS, [SPAWNED, event(2.0, "obstacle_moved", 3.2)], (1.9, 2.0), [AWAY, (3.2, 0.0)], 2.0),  # at one time
    ],
)
def test_track_follows_events(obstacle, events, t_s, at, appears_s):
    (track,) = found([obstacle], *events)
    assert (places(track, t_s), track.appears_s) == (at, appears_s)
    assert track.was_there == any(place != AWAY for place in at)


def test_events_mean_obstacle_of_their_name_or_nearest_one():
    other = [event(1.0, "spawned", 6.0, what="other"), event(2.0, "obstacle_moved", 6.5, what="other")]
    first, second = found([STANDS, carton("other", 6.0)], *other)
    assert (places(first, [3.0]), places(second, [3.0])) == ([HERE], [(6.5, 0.0)])
    events = event(1.0, "spawned", 6.0), SPAWNED, event(3.0, "obstacle_moved", 5.9)
    first, second = found([APPEARS, carton(x_m=6.0)], *events)
    assert places(first, (1.0, 2.0, 3.0)) == [AWAY, HERE, HERE]
    assert places(second, (1.0, 2.0, 3.0)) == [(6.0, 0.0), (6.0, 0.0), (5.9, 0.0)]
    with pytest.raises(ValueError, match=r"'spawned' at 2 s: expected .* \('carton'\), got 'crate'"):
        found([APPEARS], event(2.0, "spawned", what="crate"))


@given(st.lists(st.tuples(st.integers(0, 200), st.integers(-50, 50), st.booleans()), max_size=30))
def test_obstacle_is_where_last_event_puts_it(moves):
    moves.sort(key=lambda move: move[0])
    kinds = {True: "deleted", False: "obstacle_moved"}
    events = [event(k * 0.05, kinds[gone], x * 0.1) for k, x, gone in moves]
    (track,) = found([STANDS], *events)
    rows_s = np.arange(100) * 0.1
    for t_s, xy_m in zip(rows_s, places(track, rows_s), strict=True):
        before = [event for event in events if event.t_s <= t_s + 1e-9]
        last = before[-1] if before else event(0.0, "obstacle_moved")
        assert xy_m == (AWAY if last.kind == "deleted" else (last.x_m, last.y_m))


def clearances(obstacle, *events, at, t_s=1.0):
    (track,) = found([obstacle], *events)
    return track.clearance_m(np.full(len(at), round(t_s * 1000), dtype=np.int32), np.array(at)).tolist()


PUSHED = event(1.0, "spawned"), event(2.0, "obstacle_moved", 3.5, value=math.pi / 4)
TURNED = Obstacle("carton", "box", Pose(3.0, 0.0, math.pi / 4), 0.5, 0.5)
DRUM = Obstacle("drum", "cylinder", Pose(3.0, 0.0), 0.5, 0.5)
CORNER_M = 0.25 * math.sqrt(2)


@each_row(
    ("obstacle", "events", "at", "t_s", "clearance_m"),
    [
        (STANDS, (), [(2.0, 0.0), (3.0, 1.25), (3.55, 0.65), (3.1, 0.1)], 1.0, [0.75, 1.0, 0.5, 0.0]),
        (TURNED, (), [(2.0, 0.0)], 1.0, [1.0 - CORNER_M]),
        *(
            (APPEARS, PUSHED, [(2.0, 0.0)], t_s, [m])
            for t_s, m in ((0.5, math.inf), (1.0, 0.75), (2.0, 1.5 - CORNER_M))
        ),
        (DRUM, (), [(2.4, 0.8), (3.1, 0.0)], 1.0, [0.75, 0.0]),
    ],
)
def test_clearance_is_to_outline(obstacle, events, at, t_s, clearance_m):
    assert clearances(obstacle, *events, at=at, t_s=t_s) == pytest.approx(clearance_m)


@given(st.floats(-math.pi, math.pi), st.floats(-3, 3), st.floats(-3, 3), st.sampled_from(["box", "cylinder"]))
def test_clearance_agrees_with_shapely(yaw_rad, x_m, y_m, shape):
    obstacle = Obstacle("it", shape, Pose(0.5, -0.5, yaw_rad), 0.8, 0.4 if shape == "box" else 0.8)
    (clearance_m,) = clearances(obstacle, at=[(x_m, y_m)])
    assert clearance_m == pytest.approx(obstacle.footprint().distance(shapely.Point(x_m, y_m)), abs=1e-3)
