"""Stills: one moment of a replayed run on a page of its own."""

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

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
from vastflow.oracles.replay.timeline import draw_now, draw_timeline
from vastflow.sim.replay.snapshot import TickSnapshot

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
        """Where the column beside the picture begins."""
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
