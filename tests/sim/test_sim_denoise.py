"""The Denoise layer: which cells it takes away, and what a robot drives through with it."""

import numpy as np
import scipy.ndimage
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.costmaps.costmap import denoised, remove_small_groups
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameters.costmap import DenoiseLayer


@njit
def removed(q, lethal, scratch):
    remove_small_groups(q[0], lethal, scratch)


def with_layer(stack, layer):
    maps = {name: getattr(stack, name).with_values(denoise_layer=layer) for name in ("local_costmap", "global_costmap")}
    return stack.with_values(**maps)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 9), st.sampled_from([4, 8]))
def test_groups_of_fewer_cells_go_and_all_others_stay(seed, size, connectivity):
    lethal = np.random.default_rng(seed).random((25, 30)) < 0.25
    labels, _ = scipy.ndimage.label(lethal, np.ones((3, 3)) if connectivity == 8 else None)
    sizes = np.bincount(labels.ravel())[labels]
    layer = DenoiseLayer(minimal_group_size=size, group_connectivity_type=connectivity)
    cells = lethal.astype(np.uint8)
    removed(record_of(layer), cells, np.zeros_like(cells))
    assert np.array_equal(cells != 0, lethal & (sizes >= size))
    static = np.where(lethal, 254, 255).astype(np.uint8)
    assert np.array_equal(denoised(static, layer), np.where(lethal & (sizes < size), 0, static))


def test_robot_with_the_layer_drives_ten_meters_straight_past_a_speck(
    over_a_floor,
):
    cells = np.zeros((80, 280), dtype=bool)
    cells[48, 120] = True
    stack = parameters_of({"controller": "rpp"})
    found = [over_a_floor(each, cells=cells) for each in (with_layer(stack, DenoiseLayer(minimal_group_size=6)), stack)]
    assert [each.run.outcome for each in found] == ["succeeded", "succeeded"]
    aside = [np.abs(each.columns["y_mm"] - 2000).max() for each in found]
    assert aside[0] < 150 < aside[1]
