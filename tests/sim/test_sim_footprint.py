"""The padded footprint and where its outline lies."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.model.polygon import circumscribed_radius_m
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, padded_outline
from vastflow.sim.nav2.costmaps.window import Window, outline_hits

OUTLINE = padded_outline(0.22, 0.01)
PLACE = np.array([-1.0, 2.0, 0.05])


@njit
def hits(window, outline, x, y, yaw):
    return outline_hits(window, outline, x, y, yaw)


def vertices_in_cells(x, y, yaw, place=PLACE, outline=OUTLINE):
    """The outline's vertices as (column, row), with fractions."""
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    return (outline @ turn.T + [x, y] - place[:2]) / place[2]


def outline_cells(x, y, yaw):
    """Cells (column, row) under the outline, by the closed form of Nav2's line iterator."""
    vertices = np.floor(vertices_in_cells(x, y, yaw)).astype(int).tolist()
    lines = [*pairwise(vertices), (vertices[0], vertices[-1])]
    cells = set()
    for (x0, y0), (x1, y1) in lines:
        dx, dy = abs(x1 - x0), abs(y1 - y0)
        longer = max(dx, dy)
        for k in range(longer + 1):
            along_x = k if dx == longer else (longer // 2 + k * dx) // longer
            along_y = k if dy == longer else (longer // 2 + k * dy) // longer
            cells.add((x0 + int(math.copysign(along_x, x1 - x0)), y0 + int(math.copysign(along_y, y1 - y0))))
    return cells


@each_row(
    ("radius", "padding", "inscribed", "circumscribed"),
    [
        (0.22, 0.01, 0.225498, 0.234142),
        (0.175, 0.01, 0.181353, 0.189142),
        (0.3, 0.0, 0.3 * math.cos(math.pi / 16), 0.3),
    ],
)
def test_padded_footprint_has_nav2s_radii(radius, padding, inscribed, circumscribed):
    outline = padded_outline(radius, padding)
    assert inscribed_radius_m(outline) == pytest.approx(inscribed, abs=5e-7)
    assert circumscribed_radius_m(outline) == pytest.approx(circumscribed, abs=5e-7)


@settings(max_examples=25, deadline=None)
@given(x=st.floats(-1.2, 1.2), y=st.floats(1.8, 4.2), yaw=st.floats(-7.0, 7.0))
def test_lethal_cell_is_hit_where_a_line_of_the_outline_crosses_it(x, y, yaw):
    vertices = vertices_in_cells(x, y, yaw)
    # A vertex on a cell's border belongs to either side, as the last bit of a sum has it.
    assume(np.abs(vertices - np.round(vertices)).min() > 1e-9)
    column, row = math.floor((x + 1.0) / 0.05), math.floor((y - 2.0) / 0.05)
    costs = np.zeros((40, 40), dtype=np.uint8)
    hit = set()
    for r in range(max(row - 7, 0), min(row + 8, 40)):
        for c in range(max(column - 7, 0), min(column + 8, 40)):
            costs[r, c] = 254
            if hits(Window(costs, PLACE), OUTLINE, x, y, yaw):
                hit.add((c, r))
            costs[r, c] = 0
    assert hit == {(c, r) for c, r in outline_cells(x, y, yaw) if 0 <= r < 40 and 0 <= c < 40}


@each_row("cost", [1, 252, 253, 255])
def test_costs_below_lethal_are_no_hit(cost):
    assert not hits(Window(np.full((40, 40), cost, dtype=np.uint8), PLACE), OUTLINE, 0.0, 3.0, 0.4)
