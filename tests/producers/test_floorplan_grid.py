"""Floor plans as occupancy grids: what is drawn where, and that the files are ROS maps."""

import numpy as np
import pytest
import yaml
from floor_plans import DOOR, EXAMPLE, ROOM, built
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.producers.floorplan.grid import grid_of
from vastflow.sim.model.faults import FileError
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import FREE, OCCUPIED, UNKNOWN


def grid(text, **options):
    return grid_of(built(text), **options)


def at(found, x, y):
    """The map's value at a point."""
    occupancy = found.occupancy
    return int(occupancy.cells[occupancy.cell_of(x, y)])


def test_example_has_the_documented_size_and_origin():
    found = grid(EXAMPLE)
    assert found.gray.shape == (int(2.25 / 0.05) + 50, int(9.5 / 0.05) + 50)
    assert found.origin_xy_m == (-3.25, -0.5)
    assert (found.resolution_m, found.laser_height_m) == (0.05, 0.193)


def test_example_has_free_rooms_occupied_walls_and_unknown_outside():
    found = grid(EXAMPLE)
    for value, places in (
        (FREE, [(1, 2), (7, 1)]),
        (OCCUPIED, [(1, 3.1), (7.6, 2), (6.5, 2.15)]),
        (UNKNOWN, [(-3, 0)]),
    ):
        assert {at(found, *place) for place in places} == {value}


def test_door_is_open_through_both_walls_and_closed_beside():
    found = grid(EXAMPLE)
    assert {at(found, x, 1.65) for x in np.arange(3.9, 4.6, 0.02)} == {FREE}
    assert {at(found, x, 2.3) for x in np.arange(4.06, 4.5, 0.02)} == {OCCUPIED}


def test_window_stays_wall_at_every_height_of_the_laser():
    assert {at(grid(EXAMPLE, laser_height_m=height), 2.0, 3.1) for height in (0.2, 1.5)} == {OCCUPIED}


@each_row(("height", "rail", "post"), [(0.193, OCCUPIED, OCCUPIED), (0.7, FREE, OCCUPIED), (2.2, FREE, FREE)])
def test_laser_sees_obstacles_at_its_height(height, rail, post):
    found = grid(EXAMPLE, laser_height_m=height)
    assert (at(found, 5.7, 1.76), at(found, 6.5, 2.15)) == (rail, post)


def test_laser_height_selects_lintel_or_nothing():
    assert at(grid(EXAMPLE, laser_height_m=2.2), 4.1, 1.65) == OCCUPIED
    assert at(grid(EXAMPLE, laser_height_m=3.0), 7.6, 2.0) == UNKNOWN
    assert grid(ROOM, resolution_m=0.02).gray.shape == (150 + 50, 200 + 50)  # a border of 25 cells whatever their size


def test_door_opens_a_cell_beyond_both_faces():
    text = ROOM + DOOR
    closed = text.replace("Entryway", "Window")
    opened = (grid(text).gray != grid(closed).gray).any(axis=1).sum()
    assert opened == pytest.approx(0.2 / 0.05 + 2, abs=1)


def test_plan_away_from_origin_keeps_position():
    moved = ROOM.replace("of: this", "of: this translation: x: 30 m, y: 20 m")
    here, there = grid(ROOM), grid(moved)
    assert there.origin_xy_m == (30 - 2 - 1.25, 20 - 1.5 - 1.25)
    assert np.array_equal(here.gray, there.gray)


def test_thick_walls_fit_into_the_picture():
    found = grid(ROOM.replace("0.2 m", "2.0 m"))
    assert at(found, 0, 3.4) == at(found, -3.9, 0) == OCCUPIED
    assert (found.gray[[0, -1]] == 200).all()


def test_rounding_noise_does_not_choose_the_cells_of_walls_on_the_grid():
    # 0.1 + 0.2 and 0.3 are apart in the last bit; corners on the border of cells must not hang on it.
    moved = ROOM.replace("of: this", "of: this translation: x: 0.30000000000000004 m")
    same = ROOM.replace("of: this", "of: this translation: x: 0.3 m")
    assert np.array_equal(grid(moved).gray, grid(same).gray)
    assert grid(moved).origin_xy_m == grid(same).origin_xy_m


def test_files_are_a_ros_map_of_the_same_content(tmp_path):
    found = grid(EXAMPLE)
    (tmp_path / "flat.yaml").write_bytes(found.header("flat.pgm"))
    (tmp_path / "flat.pgm").write_bytes(found.picture())
    read = load_map(tmp_path / "flat.yaml")
    assert np.array_equal(read.cells, found.occupancy.cells)
    assert read.digest == found.occupancy.digest
    assert yaml.safe_load(found.header("flat.pgm"))["laser_height"] == 0.193


def test_map_of_too_many_cells_is_a_fault():
    with pytest.raises(
        FileError,
        match=r"p.fpm:1:1: Floor plan p: 4 m × 3 m at 0.0001 m are 1,496,468,036 cells\. At most 50,000,000",
    ):
        grid(ROOM, resolution_m=0.0001)


@settings(max_examples=25, deadline=None)
@given(st.floats(-3.2, 3.2), st.floats(0.6, 1.4), st.floats(-1.0, 1.0))
def test_door_joins_two_rooms_at_any_angle(turn, width, x):
    from scipy import ndimage

    text = ROOM.strip() + f" rotation: z: {turn!r}\nSpace b: shape: Rectangle width=4 m, length=3 m "
    text += "location: wrt: a.walls[0] of: this.walls[2] spaced\n"
    door = f"Entryway d: shape: Rectangle width={width!r} m, height=2 m location: in: a.walls[0] and b.walls[2] "
    door += f"translation: x: {x!r} m, z: 1 m"
    for shape, rooms in ((text + door, 1), (text, 2)):
        _, found = ndimage.label(grid(shape).occupancy.free)
        assert found == rooms
