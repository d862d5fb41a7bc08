"""The story of one run: what all pictures of a replay share."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.figures.palette import COLORS
from vastflow.oracles.figures.zones import NO_ZONES, Zones
from vastflow.oracles.replay.caption import happening
from vastflow.oracles.replay.close_up import DrivenPath
from vastflow.oracles.replay.highlights import tick_of
from vastflow.oracles.verdict import Judgement
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Run
from vastflow.sim.replay.snapshot import Box, Moment
from vastflow.sim.world.occupancy import UNKNOWN, OccupancyMap

WHOLE_M: Final = 6.5
"""A run that fits into such a square is shown whole in every picture."""
FOLLOWED_M: Final = 5.5
"""Else the pictures show such a square around the robot."""
RECENT_TICKS: Final = 10
"""What happened within so many ticks is still told."""
_SMALLEST_M: Final = 4.0
_MARGIN_M: Final = 0.9
_EDGE_M: Final = 0.3
_FREE_M: Final = 1.25
_WIDEST, _NARROWEST = 1.6, 0.8


@dataclass(frozen=True, slots=True)
class View:
    """Which part of the map the pictures show, at each tick."""

    boxes: Sequence[Box] = field(repr=False)

    def box(self, moment: Moment) -> Box:
        """The part at a moment; all are of one size."""
        return self.boxes[moment.tick]


def view_of(moments: Sequence[Moment], goals: Sequence[Pose]) -> View:
    """The whole run and its goals where that is small, else a square that moves when the robot comes near its edge."""
    points = np.array([(p.x_m, p.y_m) for p in (*(m.true for m in moments), *goals)])
    low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
    if max(high - low) <= WHOLE_M:
        width, height = np.maximum(high - low, _SMALLEST_M).tolist()
        whole = _box((low + high) / 2, max(width, height * _NARROWEST), max(height, width / _WIDEST))
        return View([whole] * len(moments))
    boxes, center = [], points[0]
    for point in points[: len(moments)]:
        if abs(point - center).max() > _FREE_M:  # a background that stands still halves a film
            center = point
        boxes.append(_box(center, FOLLOWED_M, FOLLOWED_M))
    return View(boxes)


def _box(center: NDArray[np.float64], width_m: float, height_m: float) -> Box:
    x, y = center.tolist()
    return Box(x - width_m / 2, y - height_m / 2, x + width_m / 2, y + height_m / 2)


@dataclass(frozen=True, eq=False)
class Story:
    """A replayed run.

    Attributes:
        title: Configuration and run.
        subtitle: Campaign and when it was made.
        run: Its row, as it was executed now.
        warning: Why this is not the recorded run; empty where it is.
        occupancy: The walls as they stand.
        moments: One a tick from the run's first on.
        zones: Where masks of costmap filters are.
    """

    title: str
    subtitle: str
    run: Run
    judgement: Judgement
    warning: str
    occupancy: OccupancyMap = field(repr=False)
    moments: Sequence[Moment] = field(repr=False)
    view: View
    zones: Zones = NO_ZONES

    @property
    def color(self) -> str:
        """The color of its trajectory: that of the judgement on it."""
        return COLORS[self.judgement]

    @property
    def ending(self) -> str:
        """How it ended, in words, and how long and far it was."""
        outcome = self.run.outcome.replace("_", " ")
        how = f"{outcome}: {self.run.reason}" if self.run.reason else outcome
        return f"{how}  ·  {self.run.simulated_s:.2f} s, {self.run.distance_m:.1f} m"

    def path_until(self, tick: int) -> DrivenPath:
        """Where the robot has been."""
        contacts = [(e.x_m, e.y_m) for e in self.run.events if e.kind == "contact" and tick_of(e) <= tick]
        return DrivenPath(
            self._true_xy_m[: tick + 1],
            self._estimated_xy_m[: tick + 1],
            np.array(contacts, dtype=np.float64).reshape(-1, 2),
            self.color,
        )

    def happenings(self, after: int, until: int) -> list[str]:
        """What happened behind tick `after` and no later than tick `until`, each thing once."""
        events = [e for e in self.run.events if after < tick_of(e) <= until]
        return list(dict.fromkeys(text for event in events if (text := happening(event))))

    @cached_property
    def known(self) -> Box:
        """What is known of the map, with a margin."""
        known = self.occupancy.cells != UNKNOWN
        rows, columns = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
        ends = [(row, column) for row in rows[[0, -1]] for column in columns[[0, -1]]]
        centers = self.occupancy.centers_of(np.array(ends))
        (x0, y0), (x1, y1) = centers.min(axis=0).tolist(), centers.max(axis=0).tolist()
        return Box(x0 - _EDGE_M, y0 - _EDGE_M, x1 + _EDGE_M, y1 + _EDGE_M)

    @cached_property
    def _true_xy_m(self) -> NDArray[np.float64]:
        return np.array([(m.true.x_m, m.true.y_m) for m in self.moments])

    @cached_property
    def _estimated_xy_m(self) -> NDArray[np.float64]:
        return np.array([(m.estimate.x_m, m.estimate.y_m) for m in self.moments])
