"""The inflation layer, cell by cell against its formula on the exact distance transform."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage
from table import each_row

from vastflow.sim.nav2.costmaps.inflation import cost_stamp, inflate
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, padded_outline
from vastflow.sim.world.map_file import load_map

JAZZY = (0.05, inscribed_radius_m(padded_outline(0.22, 0.01)), 0.70, 3.0)


def by_formula(costmap, resolution_m, inscribed_m, radius_m, k):
    """Inflation by the distance of every cell to the nearest lethal one."""
    lethal = costmap == 254
    if not lethal.any():
        return costmap.copy()
    cells = ndimage.distance_transform_edt(~lethal)
    cost = np.minimum(np.floor(252 * np.exp(-k * (cells * resolution_m - inscribed_m))), 252)
    cost = np.where(cells * resolution_m <= inscribed_m, 253, cost)
    cost = np.where(cells > math.ceil(radius_m / resolution_m), 0, cost)
    cost = np.where(lethal, 254, cost)
    return np.where((costmap == 255) & (cost < 253), 255, cost).astype(np.uint8)


@given(
    st.tuples(st.integers(1, 40), st.integers(1, 40)).flatmap(
        lambda shape: arrays(np.uint8, shape, elements=st.sampled_from([0] * 20 + [254, 254, 255]))
    ),
    st.sampled_from([JAZZY, (0.06, 0.181353, 0.45, 4.0), (0.05, 0.225498, 0.1, 3.0), (0.05, 0.225498, 0.0, 10.0)]),
)
@settings(max_examples=60, deadline=None)
def test_cells_have_the_cost_of_the_formula(costmap, parameters):
    np.testing.assert_array_equal(inflate(costmap, *parameters), by_formula(costmap, *parameters))


@each_row("name", ["rooms", "hallways"])
def test_cells_of_a_map_of_the_dataset_have_the_cost_of_the_formula(shared_map, name):
    occupancy = load_map(shared_map(name))
    static = np.where(occupancy.occupied, 254, np.where(occupancy.cells < 0, 255, 0)).astype(np.uint8)
    np.testing.assert_array_equal(inflate(static, *JAZZY), by_formula(static, *JAZZY))


def test_costs_of_the_turtlebot_s_own_parameters():
    stamp = cost_stamp(0.06, 0.181353, 0.45, 4.0)
    assert stamp[8, 8:].tolist()[:9] == [254, 253, 253, 253, 199, 156, 123, 97, 76]
