"""Stills and strips: moments of a replayed run on a page, placed in inches from the upper left corner."""

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from vastflow.oracles.figures.floor import draw_zones, zone_handles
from vastflow.oracles.figures.style import COLORS, GOAL_COLOR, INK
from vastflow.oracles.replay.close_up import draw_close_up, draw_patch, ground, legend_handles
from vastflow.oracles.replay.story import RECENT_TICKS, Story, doing, numbers
from vastflow.oracles.replay.timeline import draw_now, draw_timeline
from vastflow.sim.replay import TickSnapshot

DPI: Final = 110
HEAD_IN: Final = 1.15
GRAY: Final = "#6B7280"
_BOLD_LETTER_IN: Final = 0.1
"""Width of a letter of the headline; most are narrower."""
_SAME_PLACE_M: Final = 0.45
_PLATE: Final = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "boxstyle": "round,pad=0.1"}


def place(figure: Figure, left_in: float, top_in: float, width_in: float, height_in: float) -> Axes:
    """Axes of a size."""
    page_width_in, page_height_in = figure.get_size_inches()
    left, bottom = left_in / page_width_in, 1.0 - (top_in + height_in) / page_height_in
    return figure.add_axes((left, bottom, width_in / page_width_in, height_in / page_height_in))


def write(figure: Figure, left_in: float, top_in: float, text: str, **style: Any) -> None:
    """Text whose upper left corner is at a place."""
    page_width_in, page_height_in = figure.get_size_inches()
    look = {"color": INK, "va": "top", **style}
    figure.text(left_in / page_width_in, 1.0 - top_in / page_height_in, text, **look)


def write_head(figure: Figure, story: Story) -> None:
    """Write title, ending, and warning of a run, `HEAD_IN` high."""
    write(figure, 0.15, 0.12, story.title, fontsize=14, fontweight="bold")
    write(figure, figure.get_figwidth() - 0.15, 0.16, story.subtitle, fontsize=9, color=GRAY, ha="right")
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
    handles = [*legend_handles(story.color), *zone_handles(story.zones)]
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=at, ncols=columns, **look)


def overview_size_in(story: Story, width_in: float, height_in: float) -> tuple[float, float]:
    """Width and height of the overview, as large as fits."""
    box = story.known
    scale = min(width_in / (box.x1 - box.x0), height_in / (box.y1 - box.y0))
    return scale * (box.x1 - box.x0), scale * (box.y1 - box.y0)


def draw_overview(axes: Axes, story: Story, snapshot: TickSnapshot, ticks: Sequence[int]) -> None:
    """Draw the known part of the map with global costs, path, plan, and goals of `snapshot`.

    Args:
        ticks: The places of these are numbered; without any, the robot and what the close-up shows are marked.
    """
    patch = snapshot.overview
    draw_patch(axes, patch, ground(story.occupancy, patch))
    known = story.known
    axes.set(xlim=(known.x0, known.x1), ylim=(known.y0, known.y1), xticks=[], yticks=[], autoscale_on=False)
    axes.spines[:].set_visible(False)
    draw_zones(axes, story.zones)
    path = story.path_until(snapshot.moment.tick)
    axes.plot(*snapshot.plan_xy_m.T, color=GOAL_COLOR, linewidth=1.0)
    axes.plot(*path.true_xy_m.T, color=path.color, linewidth=1.6)
    for goal in snapshot.goals:
        axes.plot(goal.x_m, goal.y_m, marker="D", markersize=5, color=GOAL_COLOR, markeredgecolor="white")
    if ticks:
        _write_places(axes, story, ticks)
        return
    box = story.view.box(snapshot.moment)
    frame = Rectangle((box.x0, box.y0), box.x1 - box.x0, box.y1 - box.y0, fill=False, edgecolor=INK, linewidth=0.8)
    axes.add_patch(frame)
    axes.plot(*path.true_xy_m[-1], marker="o", markersize=5, color=INK, markeredgecolor="white")


def _write_places(axes: Axes, story: Story, ticks: Sequence[int]) -> None:
    """A number where each picture was taken; those of one place share a label."""
    here: dict[tuple[float, float], list[int]] = {}
    for number, tick in enumerate(ticks, 1):
        true = story.moments[tick].true
        near = [p for p in here if np.hypot(p[0] - true.x_m, p[1] - true.y_m) < _SAME_PLACE_M]
        here.setdefault(near[0] if near else (true.x_m, true.y_m), []).append(number)
    for point, its_numbers in here.items():
        axes.plot(*point, marker="o", markersize=4, color=INK, markeredgecolor="white", markeredgewidth=0.6)
        style: dict[str, Any] = {"fontsize": 7, "fontweight": "bold", "color": INK, "bbox": _PLATE}
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


@dataclass(frozen=True, slots=True)
class _Layout:
    """Sizes of a page, the same for all moments of a story."""

    width_in: float
    height_in: float
    overview_in: tuple[float, float]

    @property
    def page_in(self) -> tuple[float, float]:
        return self.width_in + _SIDE_IN + 0.7, HEAD_IN + self.height_in + _TIMELINE_IN + 0.65

    @property
    def side_in(self) -> float:
        """Left edge of the column beside the picture."""
        return self.width_in + 0.45

    @property
    def timeline_in(self) -> tuple[float, float, float, float]:
        return 0.5, HEAD_IN + self.height_in + 0.2, self.width_in + _SIDE_IN, _TIMELINE_IN


def still_images(story: Story, snapshots: Sequence[TickSnapshot], dpi: int = DPI) -> Iterator[Image.Image]:
    """The stills of `snapshots` (one or more) as RGB pictures of one size; what does not move is drawn once."""
    layout = _layout(story, snapshots[0])
    background = Figure(figsize=layout.page_in, dpi=dpi)
    _draw_background(background, layout, story)
    still = _image(background)
    for snapshot in snapshots:
        moving = Figure(figsize=layout.page_in, dpi=dpi, facecolor="none")
        _draw_moment(moving, layout, story, snapshot)
        yield Image.alpha_composite(still, _image(moving)).convert("RGB")


def _image(figure: Figure) -> Image.Image:
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba()))  # which knows its size in pixels


def _layout(story: Story, snapshot: TickSnapshot) -> _Layout:
    box = story.view.box(snapshot.moment)
    scale = min(_PICTURE_IN[0] / (box.x1 - box.x0), _PICTURE_IN[1] / (box.y1 - box.y0))
    width_in, height_in = scale * (box.x1 - box.x0), scale * (box.y1 - box.y0)
    room_in = max(height_in - _WORDS_IN - _LEGEND_IN, 1.0)
    return _Layout(width_in, height_in, overview_size_in(story, _SIDE_IN, room_in))


def _draw_background(figure: Figure, layout: _Layout, story: Story) -> None:
    write_head(figure, story)
    write_legend(figure, story, 1, layout.side_in - 0.05, HEAD_IN + _WORDS_IN + layout.overview_in[1] + 0.08)
    draw_timeline(place(figure, *layout.timeline_in), story.moments, {})


def _draw_moment(figure: Figure, layout: _Layout, story: Story, snapshot: TickSnapshot) -> None:
    moment, left_in = snapshot.moment, layout.side_in
    axes = place(figure, 0.15, HEAD_IN, layout.width_in, layout.height_in)
    draw_close_up(axes, story.occupancy, snapshot, story.path_until(moment.tick), story.view.box(moment), story.zones)
    recent = story.happenings(moment.tick - RECENT_TICKS, moment.tick)
    write(figure, left_in, HEAD_IN - 0.05, f"{moment.t_s:.2f} s", fontsize=20, fontweight="bold")
    write(figure, left_in, HEAD_IN + 0.35, textwrap.fill(doing(moment, story.run), 46), fontsize=11)
    write(figure, left_in, HEAD_IN + 0.77, numbers(moment), fontsize=9, color=GRAY)
    write(figure, left_in, HEAD_IN + 0.97, "\n".join(recent[-2:]), fontsize=9, color=COLORS["fail"])
    draw_overview(place(figure, left_in, HEAD_IN + _WORDS_IN, *layout.overview_in), story, snapshot, [])
    draw_now(place(figure, *layout.timeline_in), story.moments, moment.tick)


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
    box = story.view.box(snapshots[0].moment)
    panel_height_in = _PANEL_IN * (box.y1 - box.y0) / (box.x1 - box.x0)
    width_in = _COLUMNS * (_PANEL_IN + _GAP_IN) + _GAP_IN
    grid_in = rows * (panel_height_in + _CAPTION_IN)
    figure = Figure(figsize=(width_in, _TOP_IN + grid_in + _STRIP_LEGEND_IN), dpi=DPI)
    write_head(figure, story)
    ticks = [snapshot.moment.tick for snapshot in snapshots]
    overview_in = overview_size_in(story, 5.0, _TOP_IN - HEAD_IN - 0.15)
    draw_overview(place(figure, _GAP_IN, HEAD_IN, *overview_in), story, snapshots[-1], ticks)
    left_in = _GAP_IN + overview_in[0] + 0.55
    timeline = place(figure, left_in, HEAD_IN + 0.15, width_in - left_in - 0.3, _TOP_IN - HEAD_IN - 0.75)
    draw_timeline(timeline, story.moments, {tick: str(k) for k, tick in enumerate(ticks, 1)})
    for k, snapshot in enumerate(snapshots):
        left_in = _GAP_IN + (k % _COLUMNS) * (_PANEL_IN + _GAP_IN)
        top_in = _TOP_IN + (k // _COLUMNS) * (panel_height_in + _CAPTION_IN)
        axes = place(figure, left_in, top_in + _CAPTION_IN - 0.06, _PANEL_IN, panel_height_in)
        draw_close_up(
            axes, story.occupancy, snapshot, story.path_until(ticks[k]), story.view.box(snapshot.moment), story.zones
        )
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
    write(figure, left_in + 0.2 + 0.083 * len(name), top_in + 0.075, _short(now, 44), fontsize=8.5)
    write(figure, left_in, top_in + 0.25, numbers(moment), fontsize=7.5, color=GRAY)
    news = "; ".join([text for text in happened if text != now][-2:])
    write(figure, left_in, top_in + 0.41, _short(news, 70), fontsize=7.2, color=COLORS["fail"])


def _short(text: str, width: int) -> str:
    return textwrap.shorten(text, width, placeholder=" …")
