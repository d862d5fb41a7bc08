"""The film of a recorded run on its map: the robot, where it takes itself to be, obstacles, and events."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from vastflow.oracles.figures.case_figure import Case, case_figure
from vastflow.oracles.figures.style import COLORS, INK, LINE, OBSTACLE_COLOR, OBSTACLE_EDGE, SOFT_INK
from vastflow.oracles.judgement.verdict import Judgement
from vastflow.oracles.observation.obstacle_tracks import ObstacleTrack, obstacle_tracks_of
from vastflow.sim.model.recording import Event, Recording

MOST_PICTURES: Final = 80
PICTURE_MS: Final = 100
LAST_MS: Final = 1500
ESTIMATE_COLOR: Final = "#E69F00"

_FINE: Final = 2
"""Pixels drawn along a side of one of the film's, whose edges are smooth by that."""
_STRIP_PX: Final = 44 * _FINE
_SAID_MS: Final = 2500
"""Simulated time for which an event is told."""
_TOLD: Final = {
    "contact": "touches {}",
    "recovery": "recovery: {}",
    "spawned": "{} appears",
    "deleted": "{} disappears",
    "stopped_by_monitor": "stopped by the collision monitor",
    "goal_missed": "a goal given up",
}


@dataclass(frozen=True, eq=False)
class FilmedRun:
    """A recorded run with the figure that it is drawn on.

    Attributes:
        case: Its map and situation; no paths.
        radius_m: Of the robot's body.
    """

    case: Case
    recording: Recording = field(repr=False)
    judgement: Judgement
    radius_m: float

    @property
    def rows(self) -> NDArray[np.int64]:
        """Indices (K,) of the rows that are shown, the last among them."""
        n = len(self.recording.columns["t_ms"])
        step = -(-n // MOST_PICTURES)
        return np.unique(np.r_[np.arange(0, n, step), n - 1])

    @property
    def times_real_time(self) -> float:
        """Speed of the film."""
        t_ms = self.recording.columns["t_ms"]
        rows = self.rows
        return float(t_ms[-1] - t_ms[0]) / (PICTURE_MS * max(len(rows) - 1, 1))

    def pictures(self) -> Iterator[Image.Image]:
        """Draw the run, a picture for each of `rows`, as RGB pictures of one size."""
        columns, run = self.recording.columns, self.recording.run
        true = _poses(columns, "")
        estimate = _poses(columns, "estimated_")
        t_ms, tracks = columns["t_ms"], obstacle_tracks_of(self.case.situation, run)
        floor, to_px = _floor(replace(self.case, obstacles=(), around_xy_m=true[:, :2]))
        scale = float(to_px[0])
        canvas = ImageDraw.Draw(floor)
        radius_px = max(scale * self.radius_m, 4.0 * _FINE)
        true_px, estimate_px = (_placed(poses[:, :2], to_px) for poses in (true, estimate))
        before = 0
        for row in self.rows.tolist():
            for k in range(before + 1, row + 1):
                canvas.ellipse(_around(estimate_px[k], 1.0 * _FINE), fill=ESTIMATE_COLOR)
            if row > before:
                line = [tuple(point) for point in true_px[before : row + 1].tolist()]
                canvas.line(line, fill=COLORS[self.judgement], width=2 * _FINE, joint="curve")
            before = row
            picture = floor.copy()
            draw = ImageDraw.Draw(picture)
            for track in tracks:
                _draw_obstacle(draw, track, t_ms[row : row + 1], to_px)
            draw.ellipse(_around(true_px[row], radius_px), fill=INK, outline="white", width=_FINE)
            _draw_heading(draw, true_px[row], float(true[row, 2]), radius_px, "white")
            draw.ellipse(_around(estimate_px[row], radius_px), outline=ESTIMATE_COLOR, width=2 * _FINE)
            _draw_heading(draw, estimate_px[row], float(estimate[row, 2]), radius_px, ESTIMATE_COLOR)
            for event in run.events:
                if event.kind == "contact" and event.t_s * 1000.0 <= t_ms[row]:
                    _draw_cross(draw, _placed(np.array([[event.x_m, event.y_m]]), to_px)[0])
            _draw_strip(draw, picture.size, int(t_ms[row]), int(t_ms[-1]), run.events)
            yield picture.reduce(_FINE)


def _poses(columns: Any, prefix: str) -> NDArray[np.float64]:
    """Poses (N, 3) in meters and radians."""
    names = (f"{prefix}x_mm", f"{prefix}y_mm", f"{prefix}yaw_mrad")
    return np.column_stack([columns[name] for name in names]) / 1000.0


def _floor(case: Case) -> tuple[Image.Image, NDArray[np.float64]]:
    """Draw the map with a white strip below; return it with scale and offset (4,) from meters to pixels."""
    figure = case_figure(case)
    figure.set_dpi(figure.get_dpi() * _FINE)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    drawn = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    width, height = (side - side % (2 * _FINE) for side in drawn.size)
    picture = Image.new("RGB", (width, height + _STRIP_PX), "white")
    picture.paste(drawn.crop((0, 0, width, height)))
    (axes,) = figure.axes
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    across, up = drawn.width / (x1 - x0), drawn.height / (y1 - y0)
    return picture, np.array([across, -up, -x0 * across, y1 * up])


def _placed(xy_m: NDArray[np.float64], to_px: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(xy_m * to_px[:2] + to_px[2:])


def _around(point: NDArray[np.float64], radius_px: float) -> tuple[float, float, float, float]:
    x, y = point.tolist()
    return x - radius_px, y - radius_px, x + radius_px, y + radius_px


def _draw_heading(
    draw: ImageDraw.ImageDraw, point: NDArray[np.float64], yaw_rad: float, radius_px: float, color: str
) -> None:
    x, y = point.tolist()
    ahead = x + radius_px * math.cos(yaw_rad), y - radius_px * math.sin(yaw_rad)
    draw.line([(x, y), ahead], fill=color, width=round(1.5 * _FINE))


def _draw_cross(draw: ImageDraw.ImageDraw, point: NDArray[np.float64]) -> None:
    x, y = point.tolist()
    for color, width, reach in (("white", 5 * _FINE, 6 * _FINE), (COLORS["fail"], 3 * _FINE, 5 * _FINE)):
        for up in (-1, 1):
            draw.line([(x - reach, y - up * reach), (x + reach, y + up * reach)], fill=color, width=width)


def _draw_obstacle(
    draw: ImageDraw.ImageDraw, track: ObstacleTrack, t_ms: NDArray[np.int32], to_px: NDArray[np.float64]
) -> None:
    (center_m,), obstacle = track.at(t_ms), track.obstacle
    if not np.isfinite(center_m).all():
        return
    look: dict[str, Any] = {"fill": OBSTACLE_COLOR, "outline": OBSTACLE_EDGE, "width": _FINE}
    if obstacle.shape == "cylinder":
        draw.ellipse(_around(_placed(center_m[None], to_px)[0], float(to_px[0]) * obstacle.length_m / 2), **look)
        return
    yaw_rad = track.yaw_rad[np.searchsorted(track.since_ms, t_ms[0], side="right") - 1]
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (obstacle.length_m / 2, obstacle.width_m / 2)
    outline = _placed(corners @ np.array([[c, s], [-s, c]]) + center_m, to_px)
    draw.polygon([tuple(point) for point in outline.tolist()], **look)


def _draw_strip(
    draw: ImageDraw.ImageDraw, size: tuple[int, int], now_ms: int, end_ms: int, events: Sequence[Event]
) -> None:
    """Write time and events below the map, over a time line with a tick for each contact and recovery."""
    width, height = size
    top, edge = height - _STRIP_PX, 10 * _FINE
    font = ImageFont.truetype(str(Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")), 13 * _FINE)
    draw.text((edge, top + 6 * _FINE), f"{now_ms / 1000.0:.1f} s", fill=INK, font=font)
    past = [event for event in events if event.kind in _TOLD and 0.0 <= now_ms - event.t_s * 1000.0 <= _SAID_MS]
    if past:
        told = _TOLD[past[-1].kind].format(past[-1].what)
        draw.text((edge + 70 * _FINE, top + 6 * _FINE), told, fill=COLORS["fail"], font=font)
    else:
        draw.text((edge + 70 * _FINE, top + 6 * _FINE), f"of {end_ms / 1000.0:.1f} s", fill=SOFT_INK, font=font)
    line = width - 2 * edge
    low = height - 10 * _FINE
    draw.rectangle((edge, low, edge + line, low + 3 * _FINE), fill=LINE)
    draw.rectangle((edge, low, edge + line * now_ms / max(end_ms, 1), low + 3 * _FINE), fill=SOFT_INK)
    for event in events:
        if event.kind in ("contact", "recovery"):
            x = edge + line * event.t_s * 1000.0 / max(end_ms, 1)
            color = COLORS["fail"] if event.kind == "contact" else ESTIMATE_COLOR
            draw.rectangle((x - _FINE, low - 3 * _FINE, x + _FINE, low + 3 * _FINE), fill=color)
