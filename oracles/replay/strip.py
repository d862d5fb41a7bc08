"""Picture strips: a replayed run on one page."""

import textwrap
from collections.abc import Sequence
from typing import Final

from matplotlib.figure import Figure

from vastflow.oracles.figures.palette import COLORS
from vastflow.oracles.replay.caption import doing, numbers
from vastflow.oracles.replay.close_up import draw_close_up
from vastflow.oracles.replay.page import (
    DPI,
    GRAY,
    HEAD_IN,
    draw_overview,
    overview_size_in,
    place,
    write,
    write_head,
    write_legend,
)
from vastflow.oracles.replay.story import RECENT_TICKS, Story
from vastflow.oracles.replay.timeline import draw_timeline
from vastflow.sim.replay.snapshot import TickSnapshot

MOST: Final = 48
"""Pictures of a strip; with more of them it is no picture any more."""

_COLUMNS: Final = 4
_PANEL_IN: Final = 3.55
_CAPTION_IN: Final = 0.66
_GAP_IN: Final = 0.14
_TOP_IN: Final = 3.55
_LEGEND_IN: Final = 0.75


def strip_figure(story: Story, snapshots: Sequence[TickSnapshot]) -> Figure:
    """Numbered close-ups of all `snapshots` (one or more) in a grid, below the path as a whole and the timeline."""
    rows = -(-len(snapshots) // _COLUMNS)
    box = story.view.box(snapshots[0].moment)
    panel_height_in = _PANEL_IN * (box.y1 - box.y0) / (box.x1 - box.x0)
    width_in = _COLUMNS * (_PANEL_IN + _GAP_IN) + _GAP_IN
    grid_in = rows * (panel_height_in + _CAPTION_IN)
    figure = Figure(figsize=(width_in, _TOP_IN + grid_in + _LEGEND_IN), dpi=DPI)
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
