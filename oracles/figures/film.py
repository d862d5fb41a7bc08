"""Films of runs and pictures as MP4 (H.264) or GIF; the same pictures give the same bytes."""

import math
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon, Rectangle
from numpy.typing import NDArray
from PIL import Image

from vastflow.oracles.figures.case_figure import CASE_IN, CROSS, Case, case_figure
from vastflow.oracles.figures.style import COLORS, DPI, INK, LINE, OBSTACLE_COLOR, OBSTACLE_EDGE, SOFT_INK, place
from vastflow.oracles.judgment.verdict import Judgment
from vastflow.oracles.observation.obstacle_tracks import obstacle_tracks_of
from vastflow.oracles.observation.trace import signals_of
from vastflow.sim.loop.event_words import event_words
from vastflow.sim.model.recording import Event, Recording

_SAID: Final = 500
"""Characters of ffmpeg's complaint that are kept, the last ones."""
_GIF: Final = (
    "scale=trunc(iw*0.55):-1:flags=area,split[a][b];[a]palettegen=max_colors=64[p];[b][p]paletteuse=dither=none"
)
"""Filter of ffmpeg for a size and colors at which 30 s of film are about 1 MB, and words readable."""


class FilmError(Exception):
    """A film can't be encoded."""


def write_film(file: Path, pictures: Iterable[Image.Image], picture_ms: int, last_ms: int = 0, crf: int = 23) -> None:
    """Write RGB pictures as H.264, which every browser plays, or smaller as GIF by the suffix of `file`.

    Args:
        picture_ms: Duration of a picture.
        last_ms: Duration of the last picture, if it is longer.
        crf: Constant rate factor of x264, from 0 (lossless) to 51.

    Raises:
        FilmError: ffmpeg fails.
        OSError: the file can't be written.
    """
    waiting = iter(pictures)
    first = next(waiting)
    # H.264 halves the resolution of colors, so both sides are even. One thread and no version of the encoder in the file: its bytes
    # follow from the pictures.
    kind = [
        *("-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p"),
        *("-c:v", "libx264", "-preset", "fast", "-tune", "animation", "-crf", str(crf)),
        *("-fflags", "+bitexact", "-flags:v", "+bitexact", "-bsf:v", "filter_units=remove_types=6"),
        *("-movflags", "+faststart", "-f", "mp4"),
    ]
    command = [
        _encoder(),
        *("-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{first.width}x{first.height}"),
        *("-framerate", f"1000/{picture_ms}", "-i", "-", "-an", "-map_metadata", "-1", "-threads", "1"),
        *(["-vf", _GIF, "-f", "gif"] if file.suffix.lower() == ".gif" else kind),
        *("-y", str(file)),
    ]
    file.touch()  # so that a folder that can't be written is an OSError
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None and encoder.stderr is not None
        try:
            for picture in _held(chain([first], waiting), picture_ms, last_ms):
                encoder.stdin.write(picture.tobytes())
            encoder.stdin.close()
        except BrokenPipeError:
            pass
        except BaseException:
            encoder.kill()
            raise
        said = encoder.stderr.read().decode(errors="replace")
    if encoder.returncode:
        file.unlink(missing_ok=True)
        raise FilmError(f"ffmpeg ended with {encoder.returncode}: {' '.join(said.split())[-_SAID:]}")


def _encoder() -> str:
    from imageio_ffmpeg import get_ffmpeg_exe

    try:
        return str(get_ffmpeg_exe())
    except RuntimeError as error:  # a system that imageio-ffmpeg has no wheel for, and none is installed
        raise FilmError(" ".join(str(error).split())) from None


def _held(pictures: Iterable[Image.Image], picture_ms: int, last_ms: int) -> Iterator[Image.Image]:
    picture = None
    for picture in pictures:
        yield picture
    if picture is not None:
        yield from [picture] * (last_ms // picture_ms - 1)


MOST_PICTURES: Final = 80
PICTURE_MS: Final = 100
LAST_MS: Final = 1500
ESTIMATE_COLOR: Final = "#E69F00"

_STRIP_IN: Final = 0.37
"""Height of the strip below the map."""
_LEAST_RADIUS_IN: Final = 0.035
_SAID_S: Final = 2.5
"""Simulated time for which an event is told."""
_TOLD: Final = ("contact", "recovery", "spawned", "deleted", "stopped_by_monitor", "goal_missed")
_TICKS: Final = {"contact": COLORS["fail"], "recovery": ESTIMATE_COLOR}


@dataclass(frozen=True, eq=False)
class FilmedRun:
    """A recorded run with the figure that it is drawn on.

    Attributes:
        case: Its map and situation; no paths.
        radius_m: Radius of the robot's body.
    """

    case: Case
    recording: Recording = field(repr=False)
    judgment: Judgment
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

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of each picture in pixels."""
        width_in, height_in = CASE_IN
        return int(width_in * DPI), int((height_in + _STRIP_IN) * DPI)

    def pictures(self) -> Iterator[Image.Image]:
        """Draw the run, a picture for each of `rows`, as RGB pictures of one size."""
        true, estimate = (self._poses(prefix) for prefix in ("", "estimated_"))
        figure = case_figure(replace(self.case, obstacles=(), route_xy_m=true[:, :2]))
        (floor,) = figure.axes
        width_in, height_in = figure.get_size_inches().tolist()
        figure.set_size_inches(width_in, height_in + _STRIP_IN)
        whole = _STRIP_IN / (height_in + _STRIP_IN)
        floor.set_position((0.0, whole, 1.0, 1.0 - whole))
        x0_m, x1_m = floor.get_xlim()
        radius_m = max(self.radius_m, _LEAST_RADIUS_IN * (x1_m - x0_m) / width_in)
        bodies = [
            _body(floor, radius_m, "white", facecolor=INK, edgecolor="white"),
            _body(floor, radius_m, ESTIMATE_COLOR, fill=False, edgecolor=ESTIMATE_COLOR),
        ]
        (taken,) = floor.plot([], [], linestyle="none", marker=".", markersize=1.5, color=ESTIMATE_COLOR)
        (driven,) = floor.plot([], [], linewidth=1.3, color=COLORS[self.judgment])
        (crosses,) = floor.plot([], [], **CROSS)
        tracks = obstacle_tracks_of(self.case.situation, self.recording.run, signals_of(self.recording.columns))
        look: dict[str, Any] = {"facecolor": OBSTACLE_COLOR, "edgecolor": OBSTACLE_EDGE}
        obstacles = [Polygon(np.zeros((1, 2)), **look) for _ in tracks]
        for outline in obstacles:
            floor.add_patch(outline)
        t_ms, events = self.recording.columns["t_ms"], self.recording.run.events
        strip = _Strip(place(figure, 0.0, 0.0, width_in, _STRIP_IN), int(t_ms[-1]) / 1000.0, events)
        moving = [taken, driven, *obstacles, *(part for body in bodies for part in body), crosses, *strip.moving]
        for artist in moving:
            artist.set_animated(True)
        canvas: Any = FigureCanvasAgg(figure)
        canvas.draw()
        still = canvas.copy_from_bbox(figure.bbox)
        for row in self.rows.tolist():
            t_s = int(t_ms[row]) / 1000.0
            taken.set_data(*estimate[: row + 1, :2].T)
            driven.set_data(*true[: row + 1, :2].T)
            for outline, track in zip(obstacles, tracks, strict=True):
                outline.set_xy(track.outline_m(int(t_ms[row])))
            for (circle, heading), (x_m, y_m, yaw_rad) in zip(bodies, (true[row], estimate[row]), strict=True):
                circle.center = x_m, y_m
                ahead = x_m + radius_m * math.cos(yaw_rad), y_m + radius_m * math.sin(yaw_rad)
                heading.set_data(*zip((x_m, y_m), ahead, strict=True))
            met = [(event.x_m, event.y_m) for event in events if event.kind == "contact" and event.t_s <= t_s]
            crosses.set_data(*np.reshape(met, (-1, 2)).T)
            strip.show(t_s)
            canvas.restore_region(still)
            for artist in moving:
                figure.draw_artist(artist)
            yield Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")

    def _poses(self, prefix: str) -> NDArray[np.float64]:
        names = (f"{prefix}x_mm", f"{prefix}y_mm", f"{prefix}yaw_mrad")
        return np.column_stack([self.recording.columns[name] for name in names]) / 1000.0


def _body(axes: Axes, radius_m: float, color: str, **look: Any) -> tuple[Circle, Line2D]:
    circle = Circle((0.0, 0.0), radius_m, linewidth=1.2, **look)
    axes.add_patch(circle)
    (heading,) = axes.plot([], [], linewidth=1.2, color=color)
    return circle, heading


class _Strip:
    def __init__(self, axes: Axes, end_s: float, events: Sequence[Event]) -> None:
        self._end_s, self._events = end_s, events
        axes.set(xlim=(-0.017 * end_s, 1.017 * end_s), ylim=(0.0, 1.0))
        axes.set_axis_off()
        axes.add_patch(Rectangle((0.0, 0.15), end_s, 0.08, color=LINE))
        for event in events:
            if event.kind in _TICKS:
                axes.plot([event.t_s] * 2, [0.08, 0.3], color=_TICKS[event.kind], linewidth=1.5)
        self._bar = Rectangle((0.0, 0.15), 0.0, 0.08, color=SOFT_INK)
        axes.add_patch(self._bar)
        self._clock = axes.text(0.0, 0.5, "", color=INK, fontsize=8)
        self._told = axes.text(0.12 * end_s, 0.5, "", fontsize=8)
        self.moving: list[Artist] = [self._bar, self._clock, self._told]

    def show(self, t_s: float) -> None:
        """Show a moment."""
        self._bar.set_width(t_s)
        self._clock.set_text(f"{t_s:.1f} s")
        past = [event for event in self._events if event.kind in _TOLD and 0.0 <= t_s - event.t_s <= _SAID_S]
        self._told.set_text(event_words(past[-1]) if past else f"of {self._end_s:.1f} s")
        self._told.set_color(COLORS["fail"] if past else SOFT_INK)
