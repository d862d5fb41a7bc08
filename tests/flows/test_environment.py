"""Maps in the campaign directory are the maps that were used."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from vastflow.flows.results.results import write_map
from vastflow.sim.world.map_file import LARGEST_CELL_M, LEAST_CELL_M, load_map
from vastflow.sim.world.occupancy import OccupancyMap

METERS = st.floats(-1e3, 1e3, allow_nan=False)
RESOLUTIONS = st.sampled_from([0.05, 0.025, 0.1, 1.0, LEAST_CELL_M, LARGEST_CELL_M, 1 / 3])


@pytest.mark.parametrize("values", [(0, 100, -1), tuple(range(-1, 101))], ids=["trinary", "scale"])
def test_map_written_anew_is_the_same_map(tmp_path_factory, values):
    @given(
        arrays(np.int8, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.sampled_from(values)),
        RESOLUTIONS,
        st.tuples(METERS, METERS),
        st.sampled_from([0.0, 0.3, -math.pi / 4, math.pi / 4, 1e-4]),
    )
    def check(cells, resolution_m, origin_xy_m, yaw_rad):
        occupancy = OccupancyMap(cells, resolution_m, origin_xy_m, yaw_rad)
        directory = tmp_path_factory.mktemp("map")
        write_map(directory, occupancy)
        assert load_map(directory / "map.yaml").digest == occupancy.digest

    check()


def test_trinary_map_has_the_gray_values_of_map_saver(tmp_path):
    write_map(tmp_path / "e", OccupancyMap(np.array([[0, 100, -1]], dtype=np.int8), 0.05, (0.0, 0.0)))
    assert (tmp_path / "e/map.pgm").read_bytes().endswith(bytes([254, 0, 205]))
