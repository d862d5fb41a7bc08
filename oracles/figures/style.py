"""The style of all figures: colors, axes, and files.

Colors are those of Okabe and Ito, told apart by people with any common color blindness; rates and densities are viridis from yellow
(little) to purple (much). The same figure gives the same bytes.
"""

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vastflow.oracles.judgment.verdict import Judgment

if TYPE_CHECKING:
    from vastflow.oracles.statistics.classes import ClassName

DPI: Final = 120
COLORS: Final[Mapping[Judgment, str]] = {"pass": "#0072B2", "fail": "#D55E00", "not judged": "#8A8A8A"}
WORDS: Final[Mapping[Judgment, str]] = {"pass": "passed", "fail": "failed", "not judged": "not judged"}
CLASS_COLORS: Final["Mapping[ClassName, str]"] = {
    "reliable": "#0072B2",
    "systematic": "#D55E00",
    "flaky": "#E69F00",
    "undecided": "#8A8A8A",
}
OBSTACLE_COLOR: Final = "#CC79A7"
OBSTACLE_EDGE: Final = "#8F4A72"
KEEPOUT_COLOR: Final = "#7A3B10"
SPEED_COLOR: Final = "#F0E442"
GOAL_COLOR: Final = "#009E73"
INK: Final = "#22262B"
SOFT_INK: Final = "#6B7280"
LINE: Final = "#E2E5E8"
RATES: Final = "viridis_r"
"""Name of matplotlib's color map for rates and densities."""


def place(figure: Figure, left_in: float, bottom_in: float, width_in: float, height_in: float) -> Axes:
    """Add axes at a place and of a size in inches."""
    whole_in, high_in = figure.get_size_inches()
    return figure.add_axes((left_in / whole_in, bottom_in / high_in, width_in / whole_in, height_in / high_in))


def plain_axes(axes: Axes, grid: Literal["x", "y", "both"] | None = "both", **ticks: Any) -> None:
    """Draw axes without spines and tick marks, over a light grid."""
    if grid is not None:
        axes.grid(axis=grid, color=LINE, linewidth=0.8)
        axes.set_axisbelow(True)
    axes.tick_params(length=0, colors=INK, **ticks)
    axes.spines[:].set_visible(False)


def axis_labels(axes: Axes, x: str = "", y: str = "", **look: Any) -> None:
    """Label the axes in small soft letters."""
    axes.set_xlabel(x, fontsize=8, color=SOFT_INK, **look)
    axes.set_ylabel(y, fontsize=8, color=SOFT_INK, **look)


@contextmanager
def plain_style() -> Iterator[None]:
    """Use matplotlib's defaults in place of a user's `matplotlibrc`."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        yield


@dataclass(frozen=True, slots=True)
class Plot:
    """A figure that a notebook shows, whatever its backend."""

    figure: Figure

    def _repr_png_(self) -> bytes:
        return png(self.figure)


def png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


def svg(figure: Figure) -> bytes:
    """The figure as SVG with text as text; rasterized artists are pictures inside."""
    out = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "vastflow", "svg.fonttype": "none"}):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return out.getvalue()
