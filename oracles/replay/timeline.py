"""The timeline of a run: what the robot did when, how fast it was, how wrong its localization was."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba

from vastflow.oracles.figures.style import COLORS, INK
from vastflow.oracles.replay.close_up import BELIEF_COLOR
from vastflow.oracles.replay.story import SLOW_S
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.replay import Moment

_GRAY: Final = "#6B7280"
_BANDS: Final[Mapping[str, tuple[str, float]]] = {
    "following": (COLORS["pass"], 0.18),
    "no progress": ("#F0E442", 0.75),
    "no command": (INK, 0.7),
    "stopped": (COLORS["fail"], 0.95),
    "spin": ("#CC79A7", 0.8),
    "wait": ("#8A8A8A", 0.55),
    "back up": ("#E69F00", 0.8),
    "pausing": ("#8A8A8A", 0.2),
    "resting": ("#8A8A8A", 0.2),
    "starting": ("#8A8A8A", 0.2),
    "ended": ("#8A8A8A", 0.2),
}


_NARROW: Final = {"no command": "no valid command", "stopped": "stopped by the collision monitor"}


def draw_timeline(axes: Axes, moments: Sequence[Moment], marks: Mapping[int, str]) -> None:
    """Fill `axes`: bands of what the robot did, speed (m/s) and localization error (m) over time.

    Args:
        marks: Tick to the label that stands above it.
    """
    times_s = np.array([m.t_s for m in moments])
    end_s = float(times_s[-1]) + TICK_S
    speed = [abs(m.speed_mps) for m in moments]
    error = [m.error_m for m in moments]
    points_per_s = 72.0 * axes.get_figure().get_figwidth() * axes.get_position().width / end_s  # type: ignore[union-attr]
    top = max(0.55, 1.1 * max(error))
    axes.set(xlim=(0.0, end_s), ylim=(-0.36 * top, top))
    for first, last, kind in bands(moments):
        color, alpha = _BANDS[kind]
        width_s = (last - first + 1) * TICK_S
        axes.broken_barh([(first * TICK_S, width_s)], (-0.33 * top, 0.25 * top), facecolor=to_rgba(color, alpha))
        if width_s * points_per_s > 4.2 * len(kind) + 4.0:
            middle_s = first * TICK_S + width_s / 2
            color = "white" if kind in _NARROW else INK
            axes.text(middle_s, -0.205 * top, kind, fontsize=7, ha="center", va="center", color=color, clip_on=True)
    axes.fill_between(times_s, 0.0, speed, color=COLORS["pass"], alpha=0.3, linewidth=0)
    axes.plot(times_s, error, color=BELIEF_COLOR, linewidth=1.3)
    height, before_s = 1.03, -math.inf
    for tick, label in marks.items():
        t_s = tick * TICK_S
        close = (t_s - before_s) * points_per_s < 5.0 * len(label) + 3.0
        height, before_s = (1.17 if close and height == 1.03 else 1.03), t_s
        axes.axvline(t_s, color=INK, linewidth=0.6, alpha=0.5)
        axes.text(t_s, height * top, label, fontsize=7, ha="center", va="bottom", color=INK, fontweight="bold")
    _label(axes, {kind for _, _, kind in bands(moments)})


def draw_now(axes: Axes, moments: Sequence[Moment], tick: int) -> None:
    """Over a timeline of the same size: a line at `tick`; what comes after it gets faint."""
    end_s = moments[-1].t_s + TICK_S
    axes.set(xlim=(0.0, end_s), ylim=(0.0, 1.0))
    axes.axis("off")
    axes.axvspan(tick * TICK_S, end_s, color="white", alpha=0.6, linewidth=0)
    axes.axvline(tick * TICK_S, color=INK, linewidth=1.4)


def bands(moments: Sequence[Moment]) -> Iterator[tuple[int, int, str]]:
    """Spans of ticks (first, last) in which the robot did the same thing, and what."""
    first = 0
    kinds = [_kind(moment) for moment in moments]
    for k in range(1, len(kinds) + 1):
        if k == len(kinds) or kinds[k] != kinds[first]:
            yield first, k - 1, kinds[first]
            first = k


def _kind(moment: Moment) -> str:
    if moment.stopped:
        return "stopped"
    if moment.no_command_s > 0.0:
        return "no command"
    return "no progress" if moment.no_progress_s > SLOW_S else moment.activity


def _label(axes: Axes, kinds: Collection[str]) -> None:
    """Names of the curves, and of the bands that are too narrow to be named inside."""
    words = [("speed (m/s)", COLORS["pass"]), ("localization error (m)", "#B77F00")]
    words += [(text, _BANDS[kind][0]) for kind, text in _NARROW.items() if kind in kinds]
    left = 0
    for text, color in words:
        axes.annotate(text, (0.0, 0.0), (left, -13), xycoords="axes fraction", textcoords="offset points", fontsize=7,
                      va="top", color=color)  # fmt: skip
        left += 4 * len(text) + 10
    axes.set_yticks([0.0, 0.25, 0.5])
    axes.tick_params(labelsize=7, colors=_GRAY, length=2)
    axes.annotate("simulated time (s)", (1.0, 0.0), (0, -13), xycoords="axes fraction", textcoords="offset points",
                  fontsize=7, va="top", ha="right", color=_GRAY)  # fmt: skip
    axes.spines[:].set_visible(False)
