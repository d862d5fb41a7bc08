"""Ranges of beams to walls by a table of free distances for each cell and octant.

In an octant's own axes a beam rises by a row at most for each column, so from anywhere on the near side of a cell it stays in a cone
of cells that does not depend on the beam. The table holds for how many columns that cone is free. A beam skips as far, looks again,
and meets a wall's face at a whole number of columns or rows: ranges are exact to floating point.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.world.bodies import DISC, Outlines

WALL: Final = 255
OUTSIDE: Final = 254
"""The frame of one cell round the map, which ends every skip."""

FARTHEST: Final = 253
OCTANTS: Final = 8
GOES_ON: Final = -1.0
COVERED: Final = -1
"""Name of a wall's cell that no outline crosses."""
MOST_DISCS: Final = 1000
"""Discs that are faster to test against the beams toward each than cell by cell."""
_STEP: Final = 1e-7
"""Cells by which a beam is beyond the border of two cells, and edges overlap at their ends."""


class SkipTable(NamedTuple):
    """The table of a map.

    Attributes:
        cells: uint8, for each octant (H + 2) × (W + 2) cells by its columns and rows (`_octant`): free columns, `WALL` or `OUTSIDE`.
        rows, columns: Size of the map with its frame, in cells.
        named, starts, members, parts: Outlines in walls' cells, see `vastflow.sim.world.bodies.Outlines`; none where cells are walls.
        discs: Number of parts where all are discs on the map, and few; else 0.
    """

    cells: Any
    rows: int
    columns: int
    named: Any
    starts: Any
    members: Any
    parts: Any
    discs: int


def skip_table_of(occupied: NDArray[np.bool_], outlines: Outlines | None = None) -> SkipTable:
    """Return the table of a map (H, W): 8 bytes a cell, 12 with outlines of bodies."""
    if outlines is not None:
        occupied = occupied | (outlines.named > 0)
    rows, columns = occupied.shape[0] + 2, occupied.shape[1] + 2
    walls = np.ones((rows, columns), dtype=np.uint8)
    walls[1:-1, 1:-1] = occupied
    cells = np.empty((OCTANTS, rows * columns), dtype=np.uint8)
    for octant, flat in enumerate(cells):
        _fill(np.ascontiguousarray(_octant(walls, octant)), flat)
    none = np.zeros(0, dtype=np.int32)
    given = outlines or Outlines(none.reshape(0, 0), none, none, np.zeros((0, 5)))
    named = given.named if outlines is None else np.where(occupied & (given.named == 0), COVERED, given.named)
    listed = given.starts, given.members, given.parts
    return SkipTable(cells.reshape(-1), rows, columns, named.astype(np.int32), *listed, _discs(given))


def _discs(outlines: Outlines) -> int:
    kind, xy, radius = outlines.parts[:, 0], outlines.parts[:, 1:3], outlines.parts[:, 3:4]
    within = (xy - radius >= 0.0) & (xy + radius <= outlines.named.shape[::-1])
    return len(kind) if len(kind) <= MOST_DISCS and bool(np.all(kind == DISC) and np.all(within)) else 0


def _octant(walls: NDArray[np.uint8], octant: int) -> NDArray[np.uint8]:
    """Return the cells in an octant's axes: bit 2 flips x, bit 1 y, bit 0 swaps them."""
    if octant & 4:
        walls = walls[:, ::-1]
    if octant & 2:
        walls = walls[::-1]
    return walls.T if octant & 1 else walls


def _fill(walls: NDArray[np.uint8], flat: NDArray[np.uint8]) -> None:
    """Write the number of free columns ahead of each cell (A, B), 0 next to a wall."""
    free = 1 - (walls[:, :-1] | walls[:, 1:])
    table = flat.reshape(walls.shape)
    table[-1], table[:, -1] = 0, 0
    for a in range(len(walls) - 2, -1, -1):
        here = table[a, :-1]
        np.minimum(table[a + 1, :-1], table[a + 1, 1:], out=here)
        np.minimum(here, FARTHEST - 1, out=here)
        here += 1
        here *= free[a]
    table[walls == 1] = WALL
    table[[0, -1]], table[:, [0, -1]] = OUTSIDE, OUTSIDE


@njit
def ranges_to_walls(
    skips: SkipTable, x_cells: float, y_cells: float, directions: Any, start: float, end: float, out: Any
) -> None:
    """Write distances in cells along beams to the first occupied cell, `inf` without one before `end`.

    Beams advance in turns, each by one skip, which takes a quarter less time than beam by beam.

    Args:
        x_cells, y_cells: Origin in cell units from the map's lower left corner.
        directions: (B, 2) unit vectors.
        start: Least distance.
    """
    lines = np.empty((directions.shape[0], 6))
    places = np.empty((directions.shape[0], 5), dtype=np.int64)
    going = np.empty(directions.shape[0], dtype=np.int64)
    n = 0
    for b in range(directions.shape[0]):
        met = _begin(skips, x_cells, y_cells, directions[b, 0], directions[b, 1], start, lines, places, b)
        out[b] = met if met < end else math.inf
        if met == GOES_ON:
            going[n] = b
            n += 1
    while n > 0:
        still = 0
        for i in range(n):
            b = going[i]
            out[b] = _advance(skips, lines, places, b, start, end)
            if out[b] == GOES_ON:
                going[still] = b
                still += 1
        n = still
    if skips.named.shape[0] > 0:
        _meet_outlines(skips, x_cells, y_cells, directions, start, end, lines, places, out)


@inner
def _advance(skips: SkipTable, lines: Any, places: Any, b: int, start: float, end: float) -> float:
    """Advance a beam by one skip; return GOES_ON, or its distance."""
    slope, base = lines[b, 0], lines[b, 1]
    table, width = places[b, 0], places[b, 1]
    column, row, free = places[b, 2], places[b, 3], places[b, 4]
    if free == 0:
        # A wall may stand in the row above, and the beam may rise to it within this column.
        if base + slope * (column + 1) >= row + 1:
            free = skips.cells[table + column * width + row + 1]
            if free >= OUTSIDE:
                return _met(free, (row + 1 - lines[b, 3]) / lines[b, 5], start, end)
        free = 1
    column += free
    row = int(base + slope * column)
    free = skips.cells[table + column * width + row]
    if free >= OUTSIDE:
        return _met(free, (column - lines[b, 2]) / lines[b, 4], start, end)
    places[b, 2], places[b, 3], places[b, 4] = column, row, free
    return GOES_ON


@inner
def _meet_outlines(
    skips: SkipTable, x: float, y: float, directions: Any, start: float, end: float, lines: Any, places: Any, out: Any
) -> None:
    """Turn the distances of beams to walls' cells into those to the outlines that they meet.

    A beam goes on cell by cell while it meets none, and by skips where nothing stands. A cell that no outline crosses is met itself.
    """
    named, starts, members, parts = skips.named, skips.starts, skips.members, skips.parts
    for b in range(directions.shape[0]):
        dx, dy = directions[b, 0], directions[b, 1]
        right, up = int(dx > 0.0), int(dy > 0.0)
        per_x = 1.0 / dx if dx != 0.0 else math.inf
        per_y = 1.0 / dy if dy != 0.0 else math.inf
        away, nearest, last = out[b], math.inf, -1
        while away < min(end, nearest):
            away += _STEP
            column, row = math.floor(x + away * dx), math.floor(y + away * dy)
            to_x = (column + right - x) * per_x if dx != 0.0 else math.inf
            to_y = (row + up - y) * per_y if dy != 0.0 else math.inf
            # A beam on a border belongs to the cell that it goes to, as `_begin` has it; a flat one stays there for many cells.
            if to_x <= away:
                column += 2 * right - 1
                to_x += abs(per_x)
            if to_y <= away:
                row += 2 * up - 1
                to_y += abs(per_y)
            while 0 <= row < named.shape[0] and 0 <= column < named.shape[1]:
                name = named[row, column]
                if name == COVERED:
                    nearest = min(nearest, away)
                if nearest <= away or name == 0:
                    break
                for m in range(starts[name - 1], starts[name]):
                    k = members[m]
                    if k != last:
                        last = k
                        part = parts[k, 0], parts[k, 1] - x, parts[k, 2] - y, parts[k, 3], parts[k, 4]
                        nearest = min(nearest, range_to_part(*part, x, y, dx, dy, start))
                away = min(to_x, to_y)
                if to_x < to_y:
                    column += 2 * right - 1
                    to_x += abs(per_x)
                else:
                    row += 2 * up - 1
                    to_y += abs(per_y)
            if away < nearest:
                before = away
                away = _begin(skips, x, y, dx, dy, away, lines, places, 0)
                while away == GOES_ON:
                    away = _advance(skips, lines, places, 0, 0.0, end)
                if away <= before:  # rounding put the beam into a cell beside that one, in which nothing stands
                    away = max(before, min(to_x, to_y))
        out[b] = nearest if nearest < end else math.inf


@inner
def range_to_part(
    kind: float, ox: float, oy: float, c: float, d: float, x: float, y: float, dx: float, dy: float, start: float
) -> float:
    """Return the distance along a beam to an outline from `start` on, or `inf`; all in cells."""
    if kind == DISC:
        along, across = ox * dx + oy * dy, ox * dy - oy * dx
        inside = c * c - across * across
        if inside < 0.0:
            return math.inf
        half = math.sqrt(inside)
        return max(along - half, start) if along + half >= start else math.inf
    ex, ey = c - x - ox, d - y - oy
    across = dx * ey - dy * ex
    if across == 0.0:
        return math.inf
    away, share = (ox * ey - oy * ex) / across, (ox * dy - oy * dx) / across
    return away if away >= start and -_STEP <= share <= 1.0 + _STEP else math.inf


@inner
def _begin(
    skips: SkipTable,
    x_cells: float,
    y_cells: float,
    dx: float,
    dy: float,
    start: float,
    lines: Any,
    places: Any,
    beam: int,
) -> float:
    """Set up a beam in its octant's axes; return GOES_ON, or its distance if already known.

    Its row of `lines` gets slope and height of the beam as a line, and its origin and direction along and across; its row of `places`
    the octant's first cell in the table, the cells of a column, and the first column, row, and free columns (none).
    """
    octant = 0
    along_x, along_y = x_cells + 1.0, y_cells + 1.0
    if dx < 0.0:
        along_x = skips.columns - along_x
        octant += 4
    if dy < 0.0:
        along_y = skips.rows - along_y
        octant += 2
    da, db = abs(dx), abs(dy)
    if da >= db:
        octant += 1
        a0, b0, height, width = along_x, along_y, skips.columns, skips.rows
    else:
        da, db = db, da
        a0, b0, height, width = along_y, along_x, skips.rows, skips.columns
    slope = db / da
    base = b0 - slope * a0
    a = a0 + start * da
    b = base + slope * a
    if not (1.0 <= a < height - 1 and 1.0 <= b < width - 1):
        # Outside the map nothing is known to stand; go to where the beam enters it, if it still does.
        start = max(start, (1.0 - a0) / da)
        if b < 1.0:
            start = max(start, (1.0 - b0) / db) if db > 0.0 else math.inf
        a = max(a0 + start * da, 1.0)
        b = max(base + slope * a, 1.0)
        if not (a < height - 1 and b < width - 1):
            return math.inf
    table, column, row = octant * height * width, int(a), int(b)
    lines[beam, 0], lines[beam, 1], lines[beam, 2], lines[beam, 3] = slope, base, a0, b0
    lines[beam, 4], lines[beam, 5] = da, db
    places[beam, 0], places[beam, 1], places[beam, 2], places[beam, 3], places[beam, 4] = table, width, column, row, 0
    return start if skips.cells[table + column * width + row] == WALL else GOES_ON


@inner
def _met(cell: int, distance: float, start: float, end: float) -> float:
    return max(distance, start) if cell == WALL and distance < end else math.inf


@inner
def free_square(skips: SkipTable, x_cells: float, y_cells: float) -> int:
    """Return a lower bound of the free cells round a point; 0 off the map."""
    if not (0.0 <= x_cells < skips.columns - 2 and 0.0 <= y_cells < skips.rows - 2):
        return 0
    column, row = int(x_cells) + 1, int(y_cells) + 1
    least = FARTHEST
    for octant in range(OCTANTS):
        c = skips.columns - 1 - column if octant & 4 else column
        r = skips.rows - 1 - row if octant & 2 else row
        at = c * skips.rows + r if octant & 1 else r * skips.columns + c
        free = int(skips.cells[octant * skips.rows * skips.columns + at])
        least = min(least, free if free != WALL else 0)
    # The cones begin at the near side of the point's own column.
    return max(least - 1, 0)
