"""A world that is not as the robot's map has it."""

import numpy as np
import pytest
from scipy import ndimage
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.recording import si
from vastflow.sim.reading.checked import checked_digest
from vastflow.sim.run import run
from vastflow.sim.world.difference import WorldDifference, differing
from vastflow.sim.world.environment import difference_of
from vastflow.sim.world.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from vastflow.sim.world.robot_model import Robot

RESOLUTION_M = 0.05


def offsets_of_a_wall(seed: int, **given: float) -> np.ndarray:
    """Offsets (m) of a straight wall's face from its place on the map, along the wall."""
    cells = np.full((400, 40), FREE, dtype=np.int8)
    cells[:, 20:24] = OCCUPIED
    world = differing(OccupancyMap(cells, RESOLUTION_M, (0.0, 0.0)), WorldDifference(seed, **given))
    assert world.occupied.any(axis=1).all()
    return world.occupied.argmax(axis=1) * world.resolution_m - 20 * RESOLUTION_M


@each_row(("offset_m", "within"), [(0.1, 0.15), (0.02, 0.25)])
def test_walls_are_offset_by_the_stated_standard_deviation(offset_m, within):
    offsets_m = np.concatenate([offsets_of_a_wall(seed, wall_offset_m=offset_m) for seed in range(40)])
    assert offsets_m.mean() == pytest.approx(0.0, abs=0.25 * offset_m)
    assert offsets_m.std() == pytest.approx(offset_m, rel=within)
    assert np.abs(offsets_m).max() <= 5 * offset_m


@each_row(("correlation_m", "shared"), [(0.5, 0.14), (2.0, 0.88)])
def test_offsets_correlate_over_correlation_length(correlation_m, shared):
    """The squared exponential at 1 m: exp(-1 / (2 · 0.5²)) = 0.14, exp(-1 / (2 · 2²)) = 0.88."""
    walls = np.array([offsets_of_a_wall(s, wall_offset_m=0.1, correlation_length_m=correlation_m) for s in range(60)])
    a, b = walls[:, :-40].ravel(), walls[:, 40:].ravel()  # 40 cells of 0.025 m apart
    assert np.mean(a * b) / np.mean(a * a) == pytest.approx(shared, abs=0.12)


def test_single_cell_wall_is_kept():
    cells = np.full((200, 60), FREE, dtype=np.int8)
    cells[:, 30] = OCCUPIED
    for seed in range(20):
        world = differing(OccupancyMap(cells, RESOLUTION_M, (0.0, 0.0)), WorldDifference(seed, wall_offset_m=0.2))
        assert ndimage.label(world.occupied, np.ones((3, 3)))[1] == 1
        assert world.occupied.any(axis=1).all()


def test_world_has_the_maps_extent_frame_and_unknown_space():
    cells = np.full((40, 60), UNKNOWN, dtype=np.int8)
    turned = OccupancyMap(cells, RESOLUTION_M, (-3.0, 2.0), 0.3)
    world = differing(turned, WorldDifference(1, wall_offset_m=0.05))
    assert (world.shape, world.resolution_m) == ((80, 120), 0.025)
    assert world.frame == turned.frame
    assert (world.cells == UNKNOWN).all()
    coarse = differing(OccupancyMap(np.zeros((9, 9), dtype=np.int8), 0.06, (0.0, 0.0)), WorldDifference(1, 0.05))
    assert (coarse.shape, coarse.resolution_m) == ((27, 27), pytest.approx(0.02))


def test_furniture_is_removed_with_probability_and_walls_are_kept():
    cells = np.zeros((400, 400), dtype=np.int8)
    cells[:4] = OCCUPIED  # a wall of 20 m
    for row in range(20, 390, 20):
        for column in range(10, 390, 20):
            cells[row : row + 8, column : column + 8] = OCCUPIED
    n_pieces = 19 * 19
    kept = []
    for seed in range(5):
        world = differing(OccupancyMap(cells, RESOLUTION_M, (0.0, 0.0)), WorldDifference(seed, missing_share=0.3))
        assert (world.cells[:4] == OCCUPIED).all()
        kept.append(ndimage.label(world.occupied)[1] - 1)
    assert 1 - np.mean(kept) / n_pieces == pytest.approx(0.3, abs=0.05)


def test_furniture_is_at_most_2_meters_long():
    cells = np.zeros((100, 100), dtype=np.int8)
    cells[10, 10:50], cells[20, 10:51] = OCCUPIED, OCCUPIED
    world = differing(OccupancyMap(cells, RESOLUTION_M, (0.0, 0.0)), WorldDifference(0, missing_share=1.0))
    assert not world.occupied[10].any()
    assert world.occupied[20].sum() == 41


def test_seed_alone_makes_no_difference():
    assert difference_of({"seed": 5, "wall_offset": 0.0, "missing_furniture": 0.0}) is None
    assert difference_of(None) is None


def test_world_changes_the_checked_scenario(scenario):
    worlds = [scenario(world={"seed": seed, "wall_offset": 0.1}) for seed in (1, 2)]
    assert len({checked_digest(each) for each in (scenario(), *worlds)}) == 3


def test_estimate_follows_a_shift_of_all_walls(scenario, two_rooms_map):
    """The scan fits the map only where the robot takes itself to be offset as much the other way."""
    given = {"seed": 6, "wall_offset": 0.2, "correlation_length": 1000.0}
    world = differing(two_rooms_map, difference_of(given))
    corners_m = [
        [each.free.any(axis=axis).argmax() * each.resolution_m for axis in (0, 1)] for each in (world, two_rooms_map)
    ]
    moved_m = np.subtract(*corners_m)
    assert np.abs(moved_m).max() > 0.15
    recording = run(scenario(world=given), 0, 0)
    assert recording.run.outcome == "succeeded"
    columns = {name: si(column) for name, column in recording.columns.items()}
    errors_m = np.stack([columns[f"estimated_{axis}_mm"] - columns[f"{axis}_mm"] for axis in "xy"])
    half = errors_m.shape[1] // 2
    assert errors_m[:, half:].mean(axis=1) == pytest.approx(-moved_m, abs=0.12)


@pytest.mark.parametrize("seed", range(3))
def test_body_keeps_out_of_the_worlds_walls(scenario, two_rooms_map, seed):
    """With offsets of 0.25 m it would enter them by the width of a hand, did physics take the map's."""
    given = {"seed": seed, "wall_offset": 0.25, "correlation_length": 3.0}
    recording = run(scenario(world=given, timeout_s=60.0), 0, 0)
    world = differing(two_rooms_map, difference_of(given))
    room_m = ndimage.distance_transform_edt(~world.occupied) * world.resolution_m
    cells = world.in_cells(np.column_stack([si(recording.columns[name]) for name in ("x_mm", "y_mm")])).astype(int)
    assert room_m[cells[:, 0], cells[:, 1]].min() >= Robot().radius_m - world.resolution_m


@each_row(
    ("value", "message"),
    [
        (
            3,
            r"^world: expected the path of a world, or a mapping of seed, wall_offset, correlation_length, missing_furniture, as .*, got 3",
        ),
        ({"offset": 1}, r"^world: expected the path of a world, or a mapping of seed, .*, got offset"),
        ({"seed": -1}, r"^world.seed: expected a whole number from 0, got -1"),
        ({"seed": True}, r"^world.seed: expected a whole number from 0, got True"),
        ({"wall_offset": float("nan")}, r"^world.wall_offset: expected a number from 0 to 1000, got nan"),
    ],
)
def test_malformed_world_is_refused_with_place(value, message):
    with pytest.raises(ScenarioError, match=message):
        difference_of(value)


def test_difference_without_shift_moves_no_wall():
    found = difference_of({"seed": 1, "missing_furniture": 0.5})
    assert (found.wall_offset_m, found.correlation_length_m, found.missing_share) == (0.0, 2.0, 0.5)
