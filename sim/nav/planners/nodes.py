"""The nodes that a search over cells and headings has met: a table that grows, and a hash to find them in."""

from typing import Any, Final, NamedTuple

import numpy as np

from vastflow.sim.kernels.numeric import inner

KEY, X, Y, HEADING, VALUE, PARENT, TURN, COST, STATE = range(9)
"""Columns of a node: its cell and bin in one number; its pose in cells and bins; the best cost to it and whence; how it was
turned on the way; the costmap's cost at it; what is known of it."""

NEW, BLOCKED, OPEN, CLOSED = 0.0, 1.0, 2.0, 3.0

_FIRST: Final = 1 << 14
_SPREAD: Final = 0x9E3779B97F4A7C15 >> 1


class Nodes(NamedTuple):
    """Nodes in the order they were met.

    Attributes:
        rows: (N, 9) float64, of which the first `count[0]` are used.
        slots: (2 N,) int64, the row of a key and one more, 0 where there is none.
        count: (1,) int64.
    """

    rows: Any
    slots: Any
    count: Any


@inner
def new_nodes() -> Nodes:
    """No nodes."""
    return Nodes(np.zeros((_FIRST, 9)), np.zeros(2 * _FIRST, dtype=np.int64), np.zeros(1, dtype=np.int64))


@inner
def roomy(nodes: Nodes, more: int) -> Nodes:
    """The same nodes, with room for some more."""
    count = nodes.count[0]
    if count + more <= nodes.rows.shape[0]:
        return nodes
    rows = np.zeros((2 * nodes.rows.shape[0], 9))
    rows[:count] = nodes.rows[:count]
    slots = np.zeros(2 * rows.shape[0], dtype=np.int64)
    for k in range(count):
        slots[_slot(rows, slots, int(rows[k, KEY]))] = k + 1
    return Nodes(rows, slots, nodes.count)


@inner
def node_of(nodes: Nodes, key: int) -> int:
    """The row of a key, a new one if need be; there must be room."""
    slot = _slot(nodes.rows, nodes.slots, key)
    if nodes.slots[slot] == 0:
        nodes.rows[nodes.count[0], KEY] = key
        nodes.count[0] += 1
        nodes.slots[slot] = nodes.count[0]
    return int(nodes.slots[slot] - 1)


@inner
def _slot(rows: Any, slots: Any, key: int) -> int:
    """Where the key is, or where it would be."""
    last = slots.shape[0] - 1
    slot = ((key * _SPREAD) >> 20) & last
    while slots[slot] != 0 and rows[slots[slot] - 1, KEY] != key:
        slot = (slot + 1) & last
    return int(slot)
