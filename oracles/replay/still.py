"""Stills and strips: moments of a replayed run on a page, placed in inches from the upper left corner."""

import textwrap
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from vastflow.oracles.figures.maps import draw_zones, zone_handles
from vastflow.oracles.figures.style import COLORS, GOAL_COLOR, INK, SOFT_INK
from vastflow.oracles.replay import close_up
from vastflow.oracles.replay.story import RECENT_TICKS, Story, doing, numbers
from vastflow.sim.replay import Box, TickSnapshot

DPI: Final = 110
HEAD_IN: Final = 1.15
_BOLD_LETTER_IN: Final = 0.1
"""Width of a letter of the headline; most are narrower."""
_SAME_PLACE_M: Final = 0.45


def place(figure: Figure, left_in: float, top_in: float, width_in: float, height_in: float) -> Axes:
    """Axes of a size."""
    page_width_in, page_height_in = figure.get_size_inches()
    left, bottom = left_in / page_width_in, 1.0 - (top_in + height_in) / page_height_in
    return figure.add_axes((left, bottom, width_in / page_width_in, height_in / page_height_in))


def write(figure: Figure, left_in: float, top_in: float, text: str, **style: Any) -> None:
    """Text with its upper left corner at a place."""
    page_width_in, page_height_in = figure.get_size_inches()
    look = {"color": INK, "va": "top", **style}
    figure.text(left_in / page_width_in, 1.0 - top_in / page_height_in, text, **look)


def write_head(figure: Figure, story: Story) -> None:
    """Write title, ending, and warning of a run, `HEAD_IN` high."""
    write(figure, 0.15, 0.12, story.title, fontsize=14, fontweight="bold")
    write(figure, figure.get_figwidth() - 0.15, 0.16, story.subtitle, fontsize=9, color=SOFT_INK, ha="right")
    ending = textwrap.fill(story.ending, int((figure.get_figwidth() - 0.3) / _BOLD_LETTER_IN))
    write(figure, 0.15, 0.43, ending, fontsize=10, color=story.color, fontweight="bold")
    if story.warning:
        box = {"facecolor": COLORS["fail"], "edgecolor": "none", "boxstyle": "square,pad=0.25"}
        write(figure, 0.2, 0.86, f"NOT THE RECORDED RUN: {story.warning}", fontsize=9, color="white", bbox=box)


def write_legend(figure: Figure, story: Story, columns: int, left_in: float, top_in: float) -> None:
    """Write the legend of a close-up."""
    page_width_in, page_height_in = figure.get_size_inches()
    at = left_in / page_width_in, 1.0 - top_in / page_height_in
    spaces = {"handletextpad": 0.5, "columnspacing": 1.4, "labelspacing": 0.25, "borderpad": 0.2, "borderaxespad": 0.2}
    look: dict[str, Any] = {"frameon": False, "fontsize": 8, "labelcolor": INK, **spaces}
    handles = [*close_up.legend_handles(story.color), *zone_handles(story.zones)]
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=at, ncols=columns, **look)


def fitted(box: Box, width_in: float, height_in: float) -> tuple[float, float]:
    """Width and height of a picture of `box`, as large as fits."""
    scale = min(width_in / (box.x1 - box.x0), height_in / (box.y1 - box.y0))
    return scale * (box.x1 - box.x0), scale * (box.y1 - box.y0)


def draw_overview(axes: Axes, story: Story, snapshot: TickSnapshot, ticks: Sequence[int]) -> None:
    """Draw the known part of the map with global costs, path, plan, and goals of `snapshot`.

    Args:
        ticks: The places of these are numbered; without any, the robot and what the close-up shows are marked.
    """
    patch = snapshot.overview
    close_up.draw_patch(axes, patch, close_up.ground(story.occupancy, patch))
    known = story.known
    axes.set(xlim=(known.x0, known.x1), ylim=(known.y0, known.y1), xticks=[], yticks=[], autoscale_on=False)
    axes.spines[:].set_visible(False)
    draw_zones(axes, story.zones)
    driven_xy_m = story.true_xy_m[: snapshot.moment.tick + 1]
    axes.plot(*snapshot.plan_xy_m.T, color=GOAL_COLOR, linewidth=1.0)
    axes.plot(*driven_xy_m.T, color=story.color, linewidth=1.6)
    for goal in snapshot.goals:
        axes.plot(goal.x_m, goal.y_m, marker="D", markersize=5, color=GOAL_COLOR, markeredgecolor="white")
    if ticks:
        _write_places(axes, story, ticks)
        return
    box = story.view[snapshot.moment.tick]
    frame = Rectangle((box.x0, box.y0), box.x1 - box.x0, box.y1 - box.y0, fill=False, edgecolor=INK, linewidth=0.8)
    axes.add_patch(frame)
    axes.plot(*driven_xy_m[-1], marker="o", markersize=5, color=INK, markeredgecolor="white")


def _write_places(axes: Axes, story: Story, ticks: Sequence[int]) -> None:
    here: dict[tuple[float, float], list[int]] = {}
    for number, tick in enumerate(ticks, 1):
        true = story.moments[tick].true
        near = [p for p in here if np.hypot(p[0] - true.x_m, p[1] - true.y_m) < _SAME_PLACE_M]
        here.setdefault(near[0] if near else (true.x_m, true.y_m), []).append(number)
    for point, its_numbers in here.items():
        axes.plot(*point, marker="o", markersize=4, color=INK, markeredgecolor="white", markeredgewidth=0.6)
        style: dict[str, Any] = {
            "fontsize": 7,
            "fontweight": "bold",
            "color": INK,
            "bbox": {**close_up.PLATE, "boxstyle": "round,pad=0.1"},
        }
        axes.annotate(ranges_text(its_numbers), point, (3, 3), textcoords="offset points", **style)


def ranges_text(numbers: Sequence[int]) -> str:
    """Increasing numbers as `1, 3–5`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and runs[-1][-1] == number - 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]}–{run[-1]}" for run in runs)


_PICTURE_IN: Final = (6.6, 5.8)
_SIDE_IN: Final = 4.4
_WORDS_IN: Final = 1.45
_LEGEND_IN: Final = 2.1
_TIMELINE_IN: Final = 1.0


def still_images(story: Story, snapshots: Sequence[TickSnapshot]) -> Iterator[Image.Image]:
    """The stills of `snapshots` (one or more) as RGB pictures of one size; what does not move is drawn once."""
    width_in, height_in = fitted(story.view[snapshots[0].moment.tick], *_PICTURE_IN)
    overview_in = fitted(story.known, _SIDE_IN, max(height_in - _WORDS_IN - _LEGEND_IN, 1.0))
    page_in = width_in + _SIDE_IN + 0.7, HEAD_IN + height_in + _TIMELINE_IN + 0.65
    timeline_in = 0.5, HEAD_IN + height_in + 0.2, width_in + _SIDE_IN, _TIMELINE_IN
    left_in = width_in + 0.45
    background = Figure(figsize=page_in, dpi=DPI)
    write_head(background, story)
    write_legend(background, story, 1, left_in - 0.05, HEAD_IN + _WORDS_IN + overview_in[1] + 0.08)
    close_up.draw_timeline(place(background, *timeline_in), story.moments, {})
    still = _image(background)
    for snapshot in snapshots:
        moment, moving = snapshot.moment, Figure(figsize=page_in, dpi=DPI, facecolor="none")
        close_up.draw_close_up(place(moving, 0.15, HEAD_IN, width_in, height_in), story, snapshot)
        recent = story.happenings(moment.tick - RECENT_TICKS, moment.tick)
        write(moving, left_in, HEAD_IN - 0.05, f"{moment.t_s:.2f} s", fontsize=20, fontweight="bold")
        write(moving, left_in, HEAD_IN + 0.35, textwrap.fill(doing(moment, story.run), 46), fontsize=11)
        write(moving, left_in, HEAD_IN + 0.77, numbers(moment), fontsize=9, color=SOFT_INK)
        write(moving, left_in, HEAD_IN + 0.97, "\n".join(recent[-2:]), fontsize=9, color=COLORS["fail"])
        draw_overview(place(moving, left_in, HEAD_IN + _WORDS_IN, *overview_in), story, snapshot, [])
        close_up.draw_now(place(moving, *timeline_in), story.moments, moment.tick)
        yield Image.alpha_composite(still, _image(moving)).convert("RGB")


def _image(figure: Figure) -> Image.Image:
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba()))  # which knows its size in pixels


MOST: Final = 48
"""Pictures of a strip; with more of them it is no picture any more."""

_COLUMNS: Final = 4
_PANEL_IN: Final = 3.55
_CAPTION_IN: Final = 0.66
_GAP_IN: Final = 0.14
_TOP_IN: Final = 3.55
_STRIP_LEGEND_IN: Final = 0.75


def strip_figure(story: Story, snapshots: Sequence[TickSnapshot]) -> Figure:
    """Numbered close-ups of all `snapshots` (one or more) in a grid, below the path as a whole and the timeline."""
    rows = -(-len(snapshots) // _COLUMNS)
    box = story.view[snapshots[0].moment.tick]
    panel_height_in = _PANEL_IN * (box.y1 - box.y0) / (box.x1 - box.x0)
    width_in = _COLUMNS * (_PANEL_IN + _GAP_IN) + _GAP_IN
    grid_in = rows * (panel_height_in + _CAPTION_IN)
    figure = Figure(figsize=(width_in, _TOP_IN + grid_in + _STRIP_LEGEND_IN), dpi=DPI)
    write_head(figure, story)
    ticks = [snapshot.moment.tick for snapshot in snapshots]
    overview_in = fitted(story.known, 5.0, _TOP_IN - HEAD_IN - 0.15)
    draw_overview(place(figure, _GAP_IN, HEAD_IN, *overview_in), story, snapshots[-1], ticks)
    left_in = _GAP_IN + overview_in[0] + 0.55
    timeline = place(figure, left_in, HEAD_IN + 0.15, width_in - left_in - 0.3, _TOP_IN - HEAD_IN - 0.75)
    close_up.draw_timeline(timeline, story.moments, {tick: str(k) for k, tick in enumerate(ticks, 1)})
    for k, snapshot in enumerate(snapshots):
        left_in = _GAP_IN + (k % _COLUMNS) * (_PANEL_IN + _GAP_IN)
        top_in = _TOP_IN + (k // _COLUMNS) * (panel_height_in + _CAPTION_IN)
        axes = place(figure, left_in, top_in + _CAPTION_IN - 0.06, _PANEL_IN, panel_height_in)
        close_up.draw_close_up(axes, story, snapshot)
        _write_caption(figure, story, snapshot, k + 1, ticks[k - 1] if k else -1, left_in, top_in)
    write_legend(figure, story, 5, 0.15 * width_in, _TOP_IN + grid_in + 0.1)
    return figure


def _write_caption(
    figure: Figure, story: Story, snapshot: TickSnapshot, number: int, previous: int, left_in: float, top_in: float
) -> None:
    moment = snapshot.moment
    now = doing(moment, story.run)
    happened = story.happenings(max(previous, moment.tick - RECENT_TICKS), moment.tick)
    name = f"{number}   {moment.t_s:.2f} s"
    write(figure, left_in, top_in + 0.06, name, fontsize=10, fontweight="bold")
    write(
        figure,
        left_in + 0.2 + 0.083 * len(name),
        top_in + 0.075,
        textwrap.shorten(now, 44, placeholder=" …"),
        fontsize=8.5,
    )
    write(figure, left_in, top_in + 0.25, numbers(moment), fontsize=7.5, color=SOFT_INK)
    news = "; ".join([text for text in happened if text != now][-2:])
    write(
        figure, left_in, top_in + 0.41, textwrap.shorten(news, 70, placeholder=" …"), fontsize=7.2, color=COLORS["fail"]
    )
