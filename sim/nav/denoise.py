"""The Denoise layer (nav2_costmap_2d, Jazzy): groups of few lethal cells are noise."""

from typing import Any

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav.costmap import MARKED, SEEN_FREE
from vastflow.sim.nav.inflation import FREE, LETHAL
from vastflow.sim.nav.parameters.costmap import DenoiseLayer


def denoised(static: NDArray[np.uint8], q: DenoiseLayer) -> NDArray[np.uint8]:
    """The static layer (H, W) without its groups of fewer than `minimal_group_size` lethal cells."""
    lethal = static == LETHAL
    structure = np.ones((3, 3)) if q.group_connectivity_type == 8 else None
    labels, _ = scipy.ndimage.label(lethal, structure)
    small = np.bincount(labels.ravel()) < q.minimal_group_size
    small[0] = False
    return np.where(small[labels], np.uint8(FREE), static)


@inner
def remove_small_groups(q: Any, lethal: Any, scratch: Any) -> None:
    """Set to 0 the flags (R, C) uint8 that stand in groups of fewer than `minimal_group_size`; all at once.

    Args:
        scratch: (R, C) uint8, overwritten.
    """
    rows, columns = lethal.shape
    group = np.empty((max(q.minimal_group_size, 1), 2), dtype=np.int64)
    for row in range(rows):
        for column in range(columns):
            scratch[row, column] = lethal[row, column] != 0 and _is_large(q, lethal, group, row, column)
    for row in range(rows):
        for column in range(columns):
            lethal[row, column] = scratch[row, column]


@inner
def remove_small_marks(
    q: Any, static: Any, layer: Any, lethal: Any, row0: int, row1: int, col0: int, col1: int, out: Any
) -> None:
    """A window of an obstacle layer (H, W) into `out`, its marks in small groups free; walls of the static layer count with them.

    Args:
        lethal: (H, W) uint8, overwritten in the window.
    """
    for row in range(row0, row1):
        for column in range(col0, col1):
            lethal[row, column] = layer[row, column] == MARKED or static[row, column] == LETHAL
            out[row, column] = layer[row, column]
    window = lethal[row0:row1, col0:col1]
    group = np.empty((max(q.minimal_group_size, 1), 2), dtype=np.int64)
    for row in range(row0, row1):
        for column in range(col0, col1):
            if layer[row, column] == MARKED and not _is_large(q, window, group, row - row0, column - col0):
                out[row, column] = SEEN_FREE


@inner
def _is_large(q: Any, lethal: Any, group: Any, row: int, column: int) -> bool:
    """Whether a lethal cell has at least as many with it as a group must."""
    rows, columns = lethal.shape
    group[0, 0], group[0, 1] = row, column
    count, at = 1, 0
    while at < count < q.minimal_group_size:
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                if q.group_connectivity_type == 4 and dx != 0 and dy != 0:
                    continue
                r, c = group[at, 0] + dy, group[at, 1] + dx
                if r < 0 or c < 0 or r >= rows or c >= columns or lethal[r, c] == 0 or count >= q.minimal_group_size:
                    continue
                known = False
                for k in range(count):
                    known = known or (group[k, 0] == r and group[k, 1] == c)
                if not known:
                    group[count, 0], group[count, 1] = r, c
                    count += 1
        at += 1
    return bool(count >= q.minimal_group_size)
