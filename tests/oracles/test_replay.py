"""Pictures of a replay, and its words, times, and highlights."""

import math
import subprocess
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from imageio_ffmpeg import get_ffmpeg_exe
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image
from table import each_row

from vastflow.oracles.figures.film import FilmError, write_film
from vastflow.oracles.figures.style import COLORS, GOAL_COLOR, INK
from vastflow.oracles.query.scene import Zones
from vastflow.oracles.replay import still, story
from vastflow.oracles.replay.bands import bands
from vastflow.oracles.replay.close_up import BELIEF_COLOR, draw_close_up, draw_timeline, ground
from vastflow.oracles.replay.story import FOLLOWED_M, Story, view_of
from vastflow.sim.loop.event_words import event_words
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run
from vastflow.sim.replay import Box, Moment, Patch, TickSnapshot
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Robot

GOAL = Pose(3.0, 1.0)
BOX = Box(0.0, 0.0, 4.0, 4.0)
WALL, FREE, UNKNOWN = (58, 63, 71), (255, 255, 255), (226, 229, 232)


@pytest.fixture(scope="module")
def occupancy():
    """A room of 4 m × 4 m, its walls one cell thick, unknown above 3.5 m."""
    cells = np.zeros((80, 80), dtype=np.int8)
    cells[70:] = -1
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    return OccupancyMap(cells, 0.05, (0.0, 0.0))


def a_moment(tick, **changes):
    x_m = 1.0 + 0.01 * tick
    said = {"activity": "following", "true": Pose(x_m, 2.0), "estimate": Pose(x_m, 2.1), "stopped": False}
    said |= {"speed_mps": 0.2, "yaw_rate_radps": 0.0, "planned": True, "no_command_s": 0.0, "no_progress_s": 0.0}
    return Moment(tick=tick, **{**said, "recoveries": 0, "goal": 0, **changes})


def a_snapshot(tick, **changes):
    costs = np.zeros((80, 80), dtype=np.uint8)
    costs[70:] = 255
    costs[20:25, 20:25], costs[30, 30] = 253, 254
    local = np.zeros((60, 60), dtype=np.uint8)
    local[19:22, 39:42] = 254
    moment = a_moment(tick)
    said = {
        "plan_xy_m": np.array([[moment.true.x_m, 2.0], [2.0, 1.5], [3.0, 1.0]]),
        "ahead_xy_m": np.array([[moment.true.x_m, 2.0], [2.0, 1.5]]),
        "intended_xy_m": np.array([[moment.true.x_m, 2.0], [2.0, 2.0]]),
        "scan_xy_m": np.array([[0.05, 2.0], [3.95, 2.0]]),
        "particles": np.array([[moment.true.x_m, 2.0, 0.0]]),
        "robot": Robot(),
        "outline_m": 0.23 * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]),
        "obstacles": [np.array([[2.25, 2.75], [2.75, 2.75], [2.75, 3.25], [2.25, 3.25]])],
        "goals": (GOAL,),
        "global_costs": Patch(costs, Pose(0.0, 0.0), 0.05),
        "local_costs": Patch(local, Pose(1.0, 0.5, 0.3), 0.05),
        "overview": Patch(costs, Pose(0.0, 0.0), 0.05),
    }
    return TickSnapshot(moment=moment, **{**said, **changes})


def a_story(occupancy, warning="", ticks=60):
    moments = [a_moment(tick) for tick in range(ticks)]
    events = (Event(1.0, "recovery", 1.2, 2.0, "spin"), Event(1.52, "contact", 1.3, 2.0, "wall", 0.2))
    run = Run(0, "1:2:0", "aborted", 104, "no valid command", 3.0, 0.6, 1, 0, events)
    return Story("room-1, run 0", "room", run, "fail", warning, occupancy, moments, view_of(moments, [GOAL]))


def pixels(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3]


@pytest.fixture
def close_up(occupancy):
    """A function that draws a close-up of 4 m × 4 m: its axes, and its color at a place."""

    def drawn(tick=50, **changes):
        figure = Figure(figsize=(8, 8), dpi=100)
        axes = figure.add_axes((0, 0, 1, 1))
        draw_close_up(axes, replace(a_story(occupancy), view=[BOX] * 60), a_snapshot(tick, **changes))
        picture = pixels(figure)
        return axes, lambda x_m, y_m: tuple(picture[799 - int(y_m * 200), int(x_m * 200)].tolist())

    return drawn


def rgb(color):
    return tuple(round(255 * part) for part in to_rgb(color))


def near(one, other, by=3):
    return max(abs(a - b) for a, b in zip(one, other, strict=True)) <= by


def test_close_up_draws_truth_belief_and_map(close_up):
    _, color_at = close_up()
    assert near(color_at(1.5, 2.0 - 0.1), rgb(INK))  # the true body
    assert near(color_at(GOAL.x_m, GOAL.y_m), rgb(GOAL_COLOR))
    red, green, blue = color_at(1.15, 2.0)  # the path has the color of its judgment
    assert red > green + 50 > blue + 50
    assert [color_at(*at) for at in ((2.0, 0.01), (0.5, 3.0), (0.5, 3.8))] == [WALL, FREE, UNKNOWN]
    red, green, blue = color_at(2.3, 2.8)  # the obstacle that has appeared
    assert red > green + 20 and blue > green + 20
    c, s, x, y = np.cos(0.3), np.sin(0.3), 40.5 * 0.05, 20.5 * 0.05  # a mark of the turned local costmap
    assert near(color_at(1.0 + c * x - s * y, 0.5 + s * x + c * y), rgb(BELIEF_COLOR), by=20)


def test_close_up_draws_polygon_missing_costmap_and_distant_goal(close_up):
    _, color_at = close_up(robot=Robot(0.61, vertices=((0.6, 0.1), (0.6, -0.1), (-0.6, -0.1), (-0.6, 0.1))))
    assert near(color_at(1.5 - 0.55, 1.95), rgb(INK))
    assert not near(color_at(1.5, 2.3), rgb(INK))
    points = dict.fromkeys(("plan_xy_m", "ahead_xy_m", "intended_xy_m", "scan_xy_m"), np.empty((0, 2)))
    axes, color_at = close_up(0, local_costs=None, goals=(Pose(12.0, 2.0),), **points)
    assert near(color_at(1.0, 1.9), rgb(INK))
    assert "goal, 10 m" in [text.get_text() for text in axes.texts]


def test_ground_colors_costs_under_walls(occupancy):
    picture = ground(occupancy, a_snapshot(0).global_costs)
    assert (tuple(picture[0, 5]), tuple(picture[75, 5])) == (WALL, UNKNOWN)
    assert len({tuple(picture[cell]) for cell in ((22, 22), (30, 30), (50, 50))}) == 3
    patch = Patch(np.array([[10, 100, 200, 252]], dtype=np.uint8), Pose(1.0, 1.0), 0.05)
    red = ground(occupancy, patch)[0, :, 0].tolist()  # stronger near walls
    assert red == sorted(red, reverse=True) and len(set(red)) == 4
    coarse = ground(occupancy, Patch(np.zeros((20, 20), dtype=np.uint8), Pose(0.0, 0.0), 0.2))
    assert (tuple(coarse[0, 10]), tuple(coarse[10, 10])) == (WALL, FREE)


def test_ground_finds_walls_in_a_patch_in_any_frame(occupancy):
    """A costmap in odometry's frame lies across the map, with cells of another size, and beyond it."""
    corner = Pose(-1.0, 2.0, -0.6)
    patch = Patch(np.zeros((60, 90), dtype=np.uint8), corner, 0.06)
    found = (ground(occupancy, patch) == WALL).all(axis=2)
    c, s = math.cos(corner.yaw_rad), math.sin(corner.yaw_rad)
    for row, column in np.argwhere(occupancy.occupied):
        x_m, y_m = occupancy.center_of(row, column)
        x_m, y_m = x_m - corner.x_m, y_m - corner.y_m
        near_row, near_column = int((c * y_m - s * x_m) // 0.06), int((c * x_m + s * y_m) // 0.06)
        if 1 <= near_row < 59 and 1 <= near_column < 89:
            assert found[near_row - 1 : near_row + 2, near_column - 1 : near_column + 2].any()
    rows, columns = np.nonzero(found)
    x, y = (columns + 0.5) * 0.06, (rows + 0.5) * 0.06
    x_m, y_m = corner.x_m + c * x - s * y, corner.y_m + s * x + c * y
    from_rim_m = np.min([abs(x_m), abs(4.0 - x_m), abs(y_m), abs(4.0 - y_m)], axis=0)
    assert len(rows) > 50 and from_rim_m.max() < 0.05 + 0.06


def texts(figure):
    return [text.get_text() for text in figure.texts]


def test_strip_numbers_pictures_and_names_events(occupancy):
    said = texts(still.strip_figure(a_story(occupancy), [a_snapshot(tick) for tick in (0, 20, 31, 59)]))
    numbered = [text for text in said if text.endswith(" s") and text[0].isdigit()]
    assert numbered == ["1   0.00 s", "2   1.00 s", "3   1.55 s", "4   2.95 s"]
    assert {"recovery: spin", "touches wall at 0.20 m/s", "room-1, run 0"} <= {*said}
    assert any("aborted: no valid command" in text for text in said)
    assert not any("NOT THE RECORDED RUN" in text for text in said)
    other = still.strip_figure(a_story(occupancy, warning="row 3 (0.30 s), x_mm"), [a_snapshot(0)])
    assert "NOT THE RECORDED RUN: row 3 (0.30 s), x_mm" in texts(other)
    assert still.ranges_text([1, 3, 4, 5, 8]) == "1, 3–5, 8"


def test_stills_have_one_size_and_zones_of_masks(occupancy):
    stills = [*still.still_images(a_story(occupancy), [a_snapshot(tick) for tick in (0, 20, 40)])]
    assert len({still.size for still in stills}) == 1
    assert len({still.tobytes() for still in stills}) == 3
    zones = Zones((OccupancyMap(np.full((10, 10), 100, dtype=np.int8), 0.1, (0.5, 2.0)),))
    (tinted,) = still.still_images(replace(a_story(occupancy), zones=zones), [a_snapshot(0)])
    plain, tinted = (np.asarray(still, dtype=int) for still in (stills[0], tinted))
    assert np.count_nonzero((plain != tinted).any(axis=2)) > 2000


def test_gif_shows_all_pictures_in_true_colors(occupancy, tmp_path):
    pictures = still.still_images(a_story(occupancy), [a_snapshot(tick) for tick in (0, 20, 40, 59)])
    write_film(tmp_path / "film.gif", pictures, 250, 1000)
    with Image.open(tmp_path / "film.gif") as picture:
        colors = [color for _, color in picture.convert("RGB").getcolors(maxcolors=1024)]
        shown = []
        for k in range(picture.n_frames):
            picture.seek(k)
            shown.append(picture.info["duration"])
    assert shown[:3] == [250] * 3 and sum(shown[3:]) == 1000
    for wanted in (FREE, rgb(GOAL_COLOR), rgb(COLORS["fail"])):
        assert min(np.abs(np.subtract(color, wanted)).max() for color in colors) < 40


def test_mp4_has_same_bytes_for_same_pictures(occupancy, tmp_path):
    pictures = [*still.still_images(a_story(occupancy), [a_snapshot(tick) for tick in (0, 20, 40)])]
    files = [tmp_path / "one.mp4", tmp_path / "two.mp4"]
    for file in files:
        write_film(file, pictures, 250, 1000)
    one, two = (file.read_bytes() for file in files)
    assert one == two and one[4:12] == b"ftypisom" and b"avc1" in one
    size = "x".join(str(side + side % 2) for side in pictures[0].size)
    said = subprocess.run([get_ffmpeg_exe(), "-i", files[0]], capture_output=True, text=True, check=False).stderr
    assert f"yuv420p(progressive), {size}" in said and "Duration: 00:00:01.50" in said


def test_encoder_that_fails_is_reported(occupancy, tmp_path, monkeypatch):
    pictures = [Image.new("RGB", (64, 64))] * 50
    with pytest.raises(FileNotFoundError):
        write_film(tmp_path / "absent" / "film.mp4", pictures, 250)
    failing = tmp_path / "ffmpeg"
    failing.write_text("#!/bin/sh\necho no room >&2\nexit 3\n")
    failing.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(failing))
    with pytest.raises(FilmError, match="ffmpeg ended with 3: no room"):
        write_film(tmp_path / "film.mp4", pictures, 250)
    assert not (tmp_path / "film.mp4").exists()


def test_view_is_whole_for_small_runs_and_follows_others():
    moments = [a_moment(tick) for tick in range(150)]
    (box,) = {*view_of(moments[:60], [GOAL])}
    assert box.x0 < 1.0 and box.x1 > GOAL.x_m and box.y0 < GOAL.y_m and box.y1 > 2.0
    view = view_of(moments, [Pose(40.0, 1.0)])
    first, last = view[0], view[-1]
    assert view[60] == first
    assert 1.25 < last.x0 - first.x0 <= 1.49
    assert (first.x1 - first.x0, first.y1 - first.y0) == pytest.approx((FOLLOWED_M, FOLLOWED_M))


def test_timeline_has_bands_of_activities():
    moments = [a_moment(0), a_moment(1), a_moment(2, no_command_s=0.05), a_moment(3, stopped=True)]
    moments += [a_moment(4, activity="spin"), a_moment(5, activity="spin"), a_moment(6, no_progress_s=5.0)]
    kinds = ["following", "no command", "stopped", "spin", "no progress"]
    assert [*bands(moments)] == [*zip((0, 2, 3, 4, 6), (1, 2, 3, 5, 6), kinds, strict=True)]


@each_row(("speed_mps", "error_m"), [(0.3, 0.0), (2.0, 0.0), (0.3, 6.0)])
def test_timeline_shows_all_of_speed_and_error(speed_mps, error_m):
    moments = [a_moment(k, speed_mps=-speed_mps, true=Pose(0.0, 0.0), estimate=Pose(error_m, 0.0)) for k in range(5)]
    axes = Figure().add_subplot()
    draw_timeline(axes, moments, {})
    assert axes.get_ylim()[1] > max(speed_mps, error_m)
    ticks = axes.get_yticks()
    assert 2 <= len(ticks) <= 4 and ticks[0] == 0.0 and ticks[-1] > 0.4 * axes.get_ylim()[1]


def a_run(*events, outcome="succeeded"):
    return Run(0, "1:2:0", outcome, 0, "", 60.0, 5.0, 0, 0, events)


def moving(**changes):
    poses = {"true": Pose(1.0, 1.0), "estimate": Pose(1.0, 1.12)}
    return a_moment(40, **{**poses, "speed_mps": 0.25, "yaw_rate_radps": 0.5, **changes})


@each_row(
    ("changes", "words"),
    [
        ({}, "following the plan"),
        ({"planned": False}, "waiting for a plan"),
        ({"stopped": True}, "stopped by the collision monitor"),
        ({"no_command_s": 0.15}, "no valid command for 0.15 s"),
        ({"no_progress_s": 7.2}, "following, no progress for 7 s"),
        ({"activity": "spin"}, "recovery: spin"),
        ({"activity": "back up", "stopped": True}, "recovery: back up, held by the collision monitor"),
        ({"activity": "resting"}, "without a mission"),
        ({"activity": "ended"}, "mission succeeded"),
    ],
)
def test_activities_are_described_in_words(changes, words):
    assert story.doing(moving(**changes), a_run()) == words


def test_doing_and_numbers_give_ending_and_motion():
    assert story.doing(moving(activity="ended"), a_run(outcome="aborted")) == "mission given up"
    assert story.numbers(moving(recoveries=1)) == "0.25 m/s, 29°/s · localization 12 cm off · 1 recovery"
    assert story.numbers(moving(speed_mps=-0.001, yaw_rate_radps=0.0)).startswith("0.00 m/s ·")


@each_row(
    ("kind", "what", "value", "words"),
    [
        ("contact", "wall", 0.314, "touches wall at 0.31 m/s"),
        ("spawned", "box 3", 0.2, "box 3 appears"),
        ("deleted", "box 3", 0.0, "box 3 disappears"),
        ("plan_failed", "208", 0.0, "no path to the goal (NO_VALID_PATH)"),
        ("control_failed", "999", 0.0, "error 999"),
        ("goal_reached", "1", 0.0, "goal 2 reached"),
        ("goal_missed", "0", 0.0, "goal 1 given up"),
        ("obstacle_moved", "box 3", 0.2, None),
    ],
)
def test_events_are_described_in_words(kind, what, value, words):
    assert event_words(Event(1.0, kind, 0.0, 0.0, what, value)) == words


def test_tick_of_contact_is_after_it():
    assert story.tick_of(Event(1.35, "recovery", 0.0, 0.0, "spin")) == 27
    assert story.tick_of(Event(1.36, "contact", 0.0, 0.0, "wall")) == 28


def test_highlights_are_spread_and_prefer_contacts():
    chosen = story.highlights(a_run(), 0, 700)
    assert (len(chosen), chosen[0], chosen[-1]) == (story.FEWEST, 0, 700)
    assert max(b - a for a, b in pairwise(chosen)) <= 700 // 4
    crowd = [Event(0.5 * k, "recovery", 0.0, 0.0, "spin") for k in range(1, 100)]
    contact = Event(20.26, "contact", 0.0, 0.0, "wall")
    assert story.tick_of(contact) in story.highlights(a_run(*crowd, contact), 0, 1000)
    at_once = [Event(10.0 + 0.05 * k, "recovery", 0.0, 0.0, "spin") for k in range(4)]
    assert len({*range(200, 204)} & {*story.highlights(a_run(*at_once), 0, 1000)}) == 1
    moved = Event(20.0, "obstacle_moved", 0.0, 0.0, "box", 0.1)
    assert 400 not in story.highlights(a_run(moved), 0, 701)


KINDS = st.sampled_from(["contact", "recovery", "plan_failed", "other"])


@given(st.integers(0, 400), st.integers(0, 1200), st.lists(st.tuples(st.floats(0, 60), KINDS)))
def test_highlights_increase_within_span(first, length, events):
    run = a_run(*(Event(t_s, kind, 0.0, 0.0, "wait") for t_s, kind in events))
    chosen = story.highlights(run, first, first + length)
    assert len(chosen) <= story.FRAMES
    assert chosen == sorted(set(chosen))
    assert (chosen[0], chosen[-1]) == (first, first + length)


def test_times_become_ticks_and_impossible_ones_are_refused():
    assert story.whole_run(2.0) == story.Span(0, 39)
    whole = story.whole_run(30.0)
    assert [story.tick_at("--at", t_s, whole) for t_s in (0.0, 12.35, 12.37, 29.99, 30.0)] == [0, 247, 247, 599, 599]
    assert story.span_of(1.0, 2.0, whole).every(story.step_of(0.3)) == [20, 26, 32, 38, 40]
    assert story.rounded("--at", [12.35, 12.37]) == ["--at 12.37: the nearest tick of 50 ms is 12.35 s"]
    for odd in (float("nan"), float("inf")):
        with pytest.raises(UserError, match=r"a time of the run, from 0 to 30\.00 s, got"):
            story.tick_at("--at", odd, whole)
        with pytest.raises(UserError, match="--every: expected a time above 0 s, got"):
            story.step_of(odd)
