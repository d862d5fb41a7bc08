"""Tracks of obstacles, as a recording's events tell them."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from vastflow.oracles.observation.obstacle_tracks import ObstacleTrack, obstacle_tracks_of
from vastflow.oracles.observation.situation import Situation
from vastflow.sim.model.obstacle import Obstacle, Trigger
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run

NOWHERE = (math.inf, math.inf)


def carton(name: str = "carton", x_m: float = 3.0, *, appears: bool = True) -> Obstacle:
    return Obstacle(name, "box", Pose(x_m, 0.0), 0.5, 0.5, Trigger(x_m, 0.0, 1.0) if appears else None)


def found(obstacles: list[Obstacle], *events: Event) -> tuple[ObstacleTrack, ...]:
    run = Run(0, "1", "succeeded", 0, "", 10.0, 5.0, 0, 0, events)
    return obstacle_tracks_of(Situation(None, (), tuple(obstacles)), run)


def places(track: ObstacleTrack, *t_s: float) -> list[tuple[float, ...]]:
    return [tuple(xy) for xy in track.at(np.array([round(t * 1000) for t in t_s], dtype=np.int32)).tolist()]


def test_what_stands_from_the_start_is_where_it_was_put() -> None:
    (track,) = found([carton(appears=False)])
    assert places(track, 0.0, 9.0) == [(3.0, 0.0), (3.0, 0.0)]


def test_what_appears_is_there_from_the_row_of_its_event_on() -> None:
    (track,) = found([carton()], Event(2.0, "spawned", 3.0, 0.0, "carton"))
    assert places(track, 0.0, 1.9, 2.0, 9.0) == [NOWHERE, NOWHERE, (3.0, 0.0), (3.0, 0.0)]
    assert track.was_there


def test_what_never_appeared_was_never_there() -> None:
    (track,) = found([carton()], Event(2.0, "contact", 3.0, 0.0, "carton", 0.2))
    assert places(track, 0.0, 9.0) == [NOWHERE, NOWHERE]
    assert not track.was_there


def test_what_is_pushed_stays_at_each_place_until_the_next_event() -> None:
    pushes = [Event(3.0 + 0.1 * k, "obstacle_moved", 3.0 + 0.05 * k, 0.0, "carton", 0.1) for k in (1, 2)]
    (track,) = found([carton()], Event(2.0, "spawned", 3.0, 0.0, "carton"), *pushes)
    assert places(track, 3.0, 3.1, 3.2, 8.0) == [(3.0, 0.0), (3.05, 0.0), (3.1, 0.0), (3.1, 0.0)]


def test_what_is_deleted_is_gone_until_it_is_spawned_anew() -> None:
    events = [
        Event(1.0, "deleted", 3.0, 0.0, "carton"),
        Event(4.0, "spawned", 1.0, 1.0, "carton"),
        Event(5.0, "deleted", 1.0, 1.0, "carton"),
    ]
    (track,) = found([carton(appears=False)], *events)
    assert places(track, 0.9, 1.0, 4.0, 5.0) == [(3.0, 0.0), NOWHERE, (1.0, 1.0), NOWHERE]


def test_of_two_events_at_one_time_the_later_one_counts() -> None:
    events = Event(2.0, "spawned", 3.0, 0.0, "carton"), Event(2.0, "obstacle_moved", 3.2, 0.0, "carton")
    (track,) = found([carton()], *events)
    assert places(track, 1.9, 2.0) == [NOWHERE, (3.2, 0.0)]


def test_obstacles_of_different_names_go_their_own_ways() -> None:
    events = Event(1.0, "spawned", 6.0, 0.0, "other"), Event(2.0, "obstacle_moved", 6.5, 0.0, "other")
    first, second = found([carton(appears=False), carton("other", 6.0)], *events)
    assert places(first, 3.0) == [(3.0, 0.0)]
    assert places(second, 3.0) == [(6.5, 0.0)]


def test_of_obstacles_of_one_name_an_event_is_about_the_nearest() -> None:
    events = [
        Event(1.0, "spawned", 6.0, 0.0, "carton"),
        Event(2.0, "spawned", 3.0, 0.0, "carton"),
        Event(3.0, "obstacle_moved", 5.9, 0.0, "carton"),
    ]
    first, second = found([carton(), carton(x_m=6.0)], *events)
    assert places(first, 1.0, 2.0, 3.0) == [NOWHERE, (3.0, 0.0), (3.0, 0.0)]
    assert places(second, 1.0, 2.0, 3.0) == [(6.0, 0.0), (6.0, 0.0), (5.9, 0.0)]


def test_event_of_an_obstacle_that_the_scenario_does_not_have_is_refused() -> None:
    with pytest.raises(ValueError, match=r"'spawned' at 2 s: expected .* \('carton'\), got 'crate'"):
        found([carton()], Event(2.0, "spawned", 3.0, 0.0, "crate"))


@given(st.lists(st.tuples(st.integers(0, 200), st.integers(-50, 50), st.booleans()), max_size=30))
def test_at_any_row_an_obstacle_is_where_the_last_event_before_it_says(moves: list[tuple[int, int, bool]]) -> None:
    moves.sort(key=lambda move: move[0])
    kinds = {True: "deleted", False: "obstacle_moved"}
    events = [Event(k * 0.05, kinds[gone], x * 0.1, 0.0, "carton") for k, x, gone in moves]
    (track,) = found([carton(appears=False)], *events)
    rows_s = np.arange(100) * 0.1
    for t_s, xy_m in zip(rows_s, places(track, *rows_s), strict=True):
        before = [event for event in events if event.t_s <= t_s + 1e-9]
        last = before[-1] if before else Event(0.0, "obstacle_moved", 3.0, 0.0, "carton")
        assert xy_m == (NOWHERE if last.kind == "deleted" else (last.x_m, last.y_m))


# clearance


def clearances(obstacle: Obstacle, *events: Event, at: list[tuple[float, float]], t_s: float = 1.0) -> list[float]:
    (track,) = found([obstacle], *events)
    t_ms = np.full(len(at), round(t_s * 1000), dtype=np.int32)
    return [float(value) for value in track.clearance_m(t_ms, np.array(at))]


def test_clearance_of_a_box_is_to_its_outline_and_nought_inside() -> None:
    at = [(2.0, 0.0), (3.0, 1.25), (3.25 + 0.3, 0.25 + 0.4), (3.1, 0.1)]
    assert clearances(carton(appears=False), at=at) == pytest.approx([0.75, 1.0, 0.5, 0.0])


def test_clearance_of_a_turned_box_is_to_its_corner() -> None:
    turned = Obstacle("carton", "box", Pose(3.0, 0.0, math.pi / 4), 0.5, 0.5)
    assert clearances(turned, at=[(2.0, 0.0)]) == pytest.approx([1.0 - 0.25 * math.sqrt(2)])


def test_clearance_follows_a_box_that_is_pushed_and_turned() -> None:
    events = [
        Event(1.0, "spawned", 3.0, 0.0, "carton"),
        Event(2.0, "obstacle_moved", 3.5, 0.0, "carton", math.pi / 4),
    ]
    assert clearances(carton(), *events, at=[(2.0, 0.0)], t_s=0.5) == [math.inf]
    assert clearances(carton(), *events, at=[(2.0, 0.0)], t_s=1.0) == pytest.approx([0.75])
    assert clearances(carton(), *events, at=[(2.0, 0.0)], t_s=2.0) == pytest.approx([1.5 - 0.25 * math.sqrt(2)])


def test_clearance_of_a_cylinder_is_to_its_circle() -> None:
    drum = Obstacle("drum", "cylinder", Pose(3.0, 0.0), 0.5, 0.5)
    assert clearances(drum, at=[(2.4, 0.8), (3.1, 0.0)]) == pytest.approx([0.75, 0.0])


@given(st.floats(-math.pi, math.pi), st.floats(-3, 3), st.floats(-3, 3), st.sampled_from(["box", "cylinder"]))
def test_clearance_is_the_distance_to_the_footprint(yaw_rad: float, x_m: float, y_m: float, shape: str) -> None:
    width_m = 0.4 if shape == "box" else 0.8
    obstacle = Obstacle("it", shape, Pose(0.5, -0.5, yaw_rad), 0.8, width_m)  # type: ignore[arg-type]
    (clearance_m,) = clearances(obstacle, at=[(x_m, y_m)])
    assert clearance_m == pytest.approx(obstacle.footprint().distance(shapely.Point(x_m, y_m)), abs=1e-3)


def test_what_stands_from_the_start_never_appears() -> None:
    at_start = Event(0.0, "spawned", 3.0, 0.0, "carton")
    later = Event(2.0, "spawned", 3.0, 0.0, "carton")
    assert found([carton(appears=False)])[0].appears_s is None
    assert found([carton()], at_start)[0].appears_s is None
    assert found([carton()], later)[0].appears_s == 2.0
    assert found([carton()])[0].appears_s is None
