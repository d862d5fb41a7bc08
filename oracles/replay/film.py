"""Films: a replayed run as an animated GIF, which every browser and most other programs show."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from PIL import Image

from vastflow.oracles.figures.style import COLORS, GOAL_COLOR, INK, OBSTACLE_COLOR
from vastflow.oracles.replay.close_up import BELIEF_COLOR, INTENT_COLOR
from vastflow.oracles.replay.still import still_images
from vastflow.oracles.replay.story import Story
from vastflow.sim.replay import TickSnapshot

FRAME_MS: Final = 250
"""How long a picture is shown."""
LAST_MS: Final = 2000

_KEPT: Final = (
    *COLORS.values(),
    GOAL_COLOR,
    INK,
    OBSTACLE_COLOR,
    BELIEF_COLOR,
    INTENT_COLOR,
    "#000000",
    "#FFFFFF",
)
_SHARES: Final = (0.5, 1.0)
_DPI: Final = 60
_PALETTE_SIZE: Final = 40
"""Size and colors at which 30 s of film stay below 1 MB, and words readable."""
_DISTINCT: Final = 12


def write_film(file: Path, story: Story, snapshots: Sequence[TickSnapshot]) -> None:
    """Write the stills of `snapshots` (one or more) as a film; one picture is in memory at a time."""
    chosen = sorted({0, len(snapshots) // 2, len(snapshots) - 1})
    palette = _palette([*still_images(story, [snapshots[k] for k in chosen], _DPI)])
    frames = (
        still.quantize(palette=palette, dither=Image.Dither.NONE) for still in still_images(story, snapshots, _DPI)
    )
    durations = [FRAME_MS] * (len(snapshots) - 1) + [LAST_MS]
    next(frames).save(file, format="GIF", save_all=True, append_images=frames, duration=durations, loop=0)


def _palette(samples: Sequence[Image.Image]) -> Image.Image:
    """Return one palette for the whole film, so that nothing flickers: the marks' colors and the most frequent others."""
    kept = _blends()
    stack = Image.fromarray(np.concatenate([np.asarray(sample) for sample in samples]))
    found = stack.quantize(colors=_PALETTE_SIZE - len(kept), dither=Image.Dither.NONE).getpalette() or []
    others = np.array(found, dtype=np.int64).reshape(-1, 3)
    # Pillow looks colors up in coarse cells: with another near white in the palette, white would become that.
    far = np.abs(others[:, None] - kept).max(axis=2).min(axis=1) > _DISTINCT
    palette = Image.new("P", (1, 1))
    palette.putpalette([*kept.ravel().tolist(), *others[far].ravel().tolist()])
    return palette


def _blends() -> NDArray[np.uint8]:
    """(N, 3): small marks that a palette made by area would lose, and what their edges blend to."""
    blends = [share * np.array(to_rgb(color)) + 1.0 - share for color in _KEPT for share in _SHARES]
    return np.unique(np.rint(255.0 * np.array(blends)).astype(np.uint8), axis=0)
