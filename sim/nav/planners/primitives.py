"""Motion primitives of Hybrid-A*: the least arcs that leave a cell and end at a heading of the search."""

import math
from typing import Any, Final

import numpy as np

from vastflow.sim.kernels.numeric import inner

FORWARD, LEFT, RIGHT, REVERSE, REVERSE_LEFT, REVERSE_RIGHT = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
"""Turns; the start's is `NO_TURN`."""

NO_TURN: Final = 0.0

AHEAD, ASIDE, BINS, KIND, LENGTH = range(5)
"""Columns of a primitive: where it leads in cells, by how many bins it turns, its turn and its length."""


@inner
def primitives_of(q: Any) -> Any:
    """(P, 5): straight on, left and right at the least radius, the arcs between them with `q.interpolates`, and all in reverse.

    The turn's angle is a multiple of a bin, and its chord at least √2 cells, which leaves any cell.
    """
    bin_rad = 2.0 * math.pi / q.bins
    bins = max(math.ceil(2.0 * math.asin(math.sqrt(2.0) / (2.0 * q.radius)) / bin_rad - 1e-9), 1)
    chord = 2.0 * q.radius * math.sin(0.5 * bins * bin_rad)
    between = bins - 1 if q.interpolates != 0 else 0
    found = np.zeros(((3 + 2 * between) * (2 if q.reverses != 0 else 1), 5))
    n = 0
    for backward in range(2 if q.reverses != 0 else 1):
        sign = -1.0 if backward == 1 else 1.0
        found[n, AHEAD], found[n, KIND], found[n, LENGTH] = sign * chord, REVERSE if backward == 1 else FORWARD, chord
        n += 1
        for k in range(between + 1):
            turned = bins if k == 0 else k
            angle = turned * bin_rad
            radius = chord / (2.0 * math.sin(0.5 * angle))
            for side in range(2):
                bend = -1.0 if side == 1 else 1.0
                row = found[n]
                row[AHEAD], row[ASIDE] = sign * radius * math.sin(angle), bend * radius * (1.0 - math.cos(angle))
                row[BINS], row[LENGTH] = sign * bend * turned, radius * angle
                row[KIND] = (REVERSE_LEFT if backward == 1 else LEFT) + side
                n += 1
    return found


@inner
def price(q: Any, primitive: Any, cost: float, last_turn: float) -> float:
    """What a primitive costs: its length, dearer over costly ground, where it turns, turns otherwise than before, or reverses."""
    share = cost / 252.0
    share = share * share if q.quadratic != 0 else share
    value = primitive[LENGTH] * (q.travel_distance_reward + q.cost_penalty * share)
    kind = primitive[KIND]
    if kind != FORWARD and kind != REVERSE and last_turn != NO_TURN:
        value *= q.non_straight_penalty + (0.0 if kind == last_turn else q.change_penalty)
    return float(value * q.reverse_penalty if kind >= REVERSE else value)
