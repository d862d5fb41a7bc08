"""Pages: what stands round the pictures of a replay, placed in inches from the upper left corner."""

import textwrap
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from vastflow.oracles.figures.floor import draw_zones, zone_handles
from vastflow.oracles.figures.palette import COLORS, GOAL_COLOR, INK
from vastflow.oracles.replay.close_up import draw_patch, ground, legend_handles
from vastflow.oracles.replay.story import Story
from vastflow.sim.replay.snapshot import TickSnapshot

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
    """Which run, how it ended, and whether it is the recorded one; `HEAD_IN` high."""
    write(figure, 0.15, 0.12, story.title, fontsize=14, fontweight="bold")
    write(figure, figure.get_figwidth() - 0.15, 0.16, story.subtitle, fontsize=9, color=GRAY, ha="right")
    ending = textwrap.fill(story.ending, int((figure.get_figwidth() - 0.3) / _BOLD_LETTER_IN))
    write(figure, 0.15, 0.43, ending, fontsize=10, color=story.color, fontweight="bold")
    if story.warning:
        box = {"facecolor": COLORS["fail"], "edgecolor": "none", "boxstyle": "square,pad=0.25"}
        write(figure, 0.2, 0.86, f"NOT THE RECORDED RUN: {story.warning}", fontsize=9, color="white", bbox=box)


def write_legend(figure: Figure, story: Story, columns: int, left_in: float, top_in: float) -> None:
    """What the marks of a close-up mean."""
    page_width_in, page_height_in = figure.get_size_inches()
    figure.legend(
        handles=[*legend_handles(story.color), *zone_handles(story.zones)],
        loc="upper left",
        bbox_to_anchor=(left_in / page_width_in, 1.0 - top_in / page_height_in),
        ncols=columns,
        frameon=False,
        fontsize=8,
        labelcolor=INK,
        handletextpad=0.5,
        columnspacing=1.4,
        labelspacing=0.25,
        borderpad=0.2,
        borderaxespad=0.2,
    )


def overview_size_in(story: Story, width_in: float, height_in: float) -> tuple[float, float]:
    """Width and height of the overview, as large as fits."""
    box = story.known
    scale = min(width_in / (box.x1 - box.x0), height_in / (box.y1 - box.y0))
    return scale * (box.x1 - box.x0), scale * (box.y1 - box.y0)


def draw_overview(axes: Axes, story: Story, snapshot: TickSnapshot, ticks: Sequence[int]) -> None:
    """What is known of the map with the global costs of `snapshot`, the path until then, the plan and the goals.

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
    for point, numbers in here.items():
        axes.plot(*point, marker="o", markersize=4, color=INK, markeredgecolor="white", markeredgewidth=0.6)
        style: dict[str, Any] = {"fontsize": 7, "fontweight": "bold", "color": INK, "bbox": _PLATE}
        axes.annotate(ranges_text(numbers), point, (3, 3), textcoords="offset points", **style)


def ranges_text(numbers: Sequence[int]) -> str:
    """Increasing numbers as `1, 3–5`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and runs[-1][-1] == number - 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]}–{run[-1]}" for run in runs)
