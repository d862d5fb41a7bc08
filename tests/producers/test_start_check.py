"""The start check: the system's own footprint must fit where a configuration begins and ends."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.producers.places.ground import ground_of
from vastflow.producers.places.start_check import room_m
from vastflow.sim.model.polygon import circumscribed_radius_m
from vastflow.sim.model.pose import pose_of
from vastflow.sim.nav2.costmaps.outline import padded_outline

WALLED = ["#" * 10, *["#" + "." * 8 + "#"] * 6, "#" * 10]
"""A room of 8 m x 6 m between walls, from (0, -1) to (8, 5) with cells of 1 m, drawn in cells of 0.05 m."""
LEFT_M, LOW_M = 0.0, -1.0
NAV2 = """\
local_costmap:
  local_costmap:
    ros__parameters:
      robot_radius: {radius}
      footprint_padding: {padding}
      {more}
      plugins: ["inflation_layer"]
      inflation_layer: {{plugin: "nav2_costmap_2d::InflationLayer"}}
"""
DISC_M = 0.234142
"""Reach of the outline of a robot of 0.22 m padded by 0.01 m; to the right also 0.23 m."""


@pytest.fixture(scope="module")
def room(drawn_map):
    return drawn_map(*WALLED, cells=20)


@pytest.fixture
def made(room, tmp_path):
    """The instantiation of a file with one family, of the lines that it has besides its map."""

    def make(lines, execution="", name="made.vast"):
        text = f"version: 1\nconfiguration:\n- name: a\n{lines}\n{execution}"
        (tmp_path / name).write_text(text.replace("MAP", room.path))
        return instantiate(load_campaign(tmp_path / name))

    return make


def poses(start, goal=(4.0, 2.0), more=""):
    place = [f"{{x: {x}, y: {y}, yaw: 0.0}}" for x, y in (start, goal)]
    return f"  parameters:\n  - map_file: MAP\n  - start_pose: {place[0]}\n  - goal_pose: {place[1]}\n{more}"


def fits(found):
    assert len(found.configurations) + len(found.rejections) == 1
    return bool(found.configurations)


@each_row(
    ("x_m", "free"),
    [(4.0, True), (0.231, True), (0.229, False), (0.1, False), (7.769, True), (7.771, False)],
)
def test_given_start_is_realized_exactly_where_the_padded_footprint_fits(made, x_m, free):
    """0.22 m and 0.01 m of padding to each side along an axis."""
    assert fits(made(poses((x_m, 2.0)))) is free


@each_row(("y_m", "free"), [(2.0, True), (2.52, True), (2.6, False)])
def test_start_stands_clear_of_bodies_that_only_the_world_has(made, tmp_path, y_m, free):
    """A post of 0.2 m at (1, 3) begins at 2.8 m, 0.28 m above the second start."""
    (tmp_path / "posts.csv").write_text("1.0,3.0,0.2\n")
    assert fits(made(poses((1.0, y_m), more=f"  - world: {tmp_path / 'posts.csv'}\n"))) is free


@each_row(
    ("goals", "free"),
    [
        ("goal_pose: {x: 4.0, y: 2.0}", True),
        ("goal_pose: {x: 0.1, y: 2.0}", False),
        ("goal_pose: {x: 4.0, y: 2.0}\n  - goal_pose1: {x: 0.1, y: 2.0}", True),
        ("goal_pose: {x: 4.0, y: 2.0}\n  - goal_pose1: {x: 0.1, y: 2.0}\n  dimensions: {goal_pose1: task}", False),
        ("goal_poses: [{x: 4.0, y: 2.0}, {x: 1.0, y: 2.0}]", True),
        ("goal_poses: [{x: 4.0, y: 2.0}, {x: 1.0, y: -0.9}]", False),
    ],
)
def test_goals_are_checked_as_the_start_is(made, goals, free):
    found = made(f"  parameters:\n  - map_file: MAP\n  - start_pose: {{x: 4.0, y: 2.0}}\n  - {goals}\n")
    assert fits(found) is free
    assert free or found.rejections[0].reason.split(" at ")[1].startswith(
        ("goal_pose (0.1", "goal_pose1 (0.1", "goal_poses[1] (1, -0.9")
    )


def test_rejection_names_producer_parent_and_request(made):
    found = made(poses((0.1, 2.0)))
    (rejection,) = found.rejections
    assert (rejection.producer, rejection.family, rejection.parent) == ("start_check", "a", "a")
    assert rejection.reason == (
        "the local costmap's footprint does not fit at start_pose (0.1, 2): it reaches 0.234 m from its center, into a wall"
    )
    assert found.coverage["unrealizable_by"] == {
        "start_check": {"count": 1, "reasons": {rejection.reason: 1}, "reasons_not_listed": 0}
    }


@each_row(
    ("more", "free"),
    [
        ("  - robot_radius: 0.3\n", False),
        ("  - local_costmap.robot_radius: 0.3\n", False),
        ("  - global_costmap.robot_radius: 0.3\n", True),
        ("  - footprint_padding: 0.1\n", False),
        ("  - robot_radius: '0.3'\n", False),
    ],
)
def test_local_costmaps_footprint_counts(made, more, free):
    assert fits(made(poses((0.27, 2.0), more=more))) is free


@pytest.mark.parametrize(
    ("radius", "padding", "more", "yaw", "free"),
    [
        (0.2, 0.0, "", 0.0, True),
        (0.2, 0.1, "", 0.0, False),
        (0.2, 0.0, 'footprint: "[[.2, .4], [.2, -.4], [-.2, -.4], [-.2, .4]]"', 0.0, True),
        (0.2, 0.0, 'footprint: "[[.2, .4], [.2, -.4], [-.2, -.4], [-.2, .4]]"', math.pi / 2, False),
        (0.2, 0.1, 'footprint: "[[.2, .4], [.2, -.4], [-.2, -.4], [-.2, .4]]"', 0.0, False),
        (0.2, 0.0, 'footprint: "[]"', 0.0, True),
    ],
)
def test_turning_radius_polygon_and_padding_follow_parameter_file(made, tmp_path, radius, padding, more, yaw, free):
    (tmp_path / "nav2.yaml").write_text(NAV2.format(radius=radius, padding=padding, more=more))
    turned = poses((0.27, 2.0)).replace("yaw: 0.0", f"yaw: {yaw}", 1)
    assert fits(made(turned, "execution:\n  nav2_params: nav2.yaml\n")) is free


@each_row("design", ["t_way: {strength: 2}", "sample: {method: lhs, size: 6, seed: 1}"])
def test_covering_design_uses_feasible_levels(made, design):
    radii = "  variations:\n  - ParameterVariationList: {name: robot_radius, values: [0.2, 0.25, 0.3]}\n"
    noise = "  - ParameterVariationList: {name: laserscan_gaussian_noise_std_deviation, values: [0.0, 0.1, 0.2]}\n"
    found = made(f"  design:\n    {design}\n" + poses((0.27, 2.0), more=radii + noise))
    assert len(found.configurations) == 6
    assert {c.scenario.system["robot_radius"] for c in found.configurations} == {0.2, 0.25}
    assert [(r.producer, r.parent) for r in found.rejections] == [("start_check", "a-3")]


@each_row(("box", "free"), [("x: 0.5, y: 0.0", False), ("x: 3.0, y: 3.0", True), ("x: 4.0, y: 2.0", True)])
def test_obstacle_is_in_the_way_at_the_start_and_not_at_the_goal(made, box, free):
    more = f"  - static_objects: [{{entity_name: crate, spawn_pose: {{{box}}}}}]\n"
    found = made(poses((0.5, 0.4), (4.0, 2.0), more))
    assert fits(found) is free
    assert free or found.rejections[0].reason.endswith("into crate")


def test_configuration_without_a_map_passes(tmp_path):
    (tmp_path / "p.osc").write_text("import osc.helpers\nscenario p:\n    do serial:\n        run_process('true')\n")
    file = tmp_path / "p.vast"
    file.write_text("version: 1\nconfiguration:\n- name: a\nexecution:\n  scenario_file: p.osc\n")
    assert fits(instantiate(load_campaign(file)))


PATHS = """\
  parameters:
  - map_file: MAP
  variations:
  - PathVariationRandom:
      {{path_length: 4.0, path_length_tolerance: 0.5, num_paths: 30, num_goal_poses: 2, robot_diameter: 0.2, seed: {seed}}}
"""
RADII = "  - ParameterVariationList: {name: robot_radius, values: [0.1, 0.45]}\n"
RASTER = """\
  parameters:
  - map_file: MAP
  variations:
  - PathVariationRasterized: {path_length: 5.0, raster_size: 1.25, raster_offset_x: 1.15, raster_offset_y: 1.15, robot_diameter: 0.2}
"""


def stops(configuration):
    task = configuration.scenario.task
    goals = task.get("goal_poses") or [task["goal_pose"]]
    return [pose_of(pose) for pose in (task["start_pose"], *goals)]


def gap_m(pose):
    """To the nearest wall of the room."""
    return min(pose.x_m - LEFT_M, 8.0 + LEFT_M - pose.x_m, pose.y_m - LOW_M, 6.0 + LOW_M - pose.y_m)


@each_row("lines", [PATHS.format(seed=3), RASTER])
def test_drawn_stops_pass_the_start_check(made, lines):
    loose, checked = made("  start_check: none\n" + lines), made(lines)
    assert [r.reason for r in checked.rejections if r.producer == "start_check"] == []
    least = [min(gap_m(pose) for c in found.configurations for pose in stops(c)) for found in (loose, checked)]
    assert least[0] < DISC_M < least[1]


def test_drawn_stops_fit_largest_robot(made):
    """The footprint narrows what is drawn and seeds nothing: two systems can be compared path by path."""
    found = made(PATHS.format(seed=3) + RADII)
    assert found.rejections == ()
    assert min(gap_m(pose) for c in found.configurations for pose in stops(c)) >= 0.46
    larger = RADII.replace("[0.1, 0.45]", "[0.23]")
    one, other = (made(PATHS.format(seed=3) + more).configurations for more in ("", larger))
    assert sum(stops(a) == stops(b) for a, b in zip(one, other, strict=True)) > 25


@given(
    st.lists(st.tuples(st.integers(0, 19), st.integers(0, 19)), min_size=1, max_size=5),
    st.sampled_from([0.0, 0.03, 0.1, 0.234142, 0.4]),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_stop_keeps_requested_wall_distance(drawn_map, walls, room_m):
    rows = [["."] * 20 for _ in range(20)]
    for row, column in walls:
        rows[row][column] = "#"
    ground = ground_of(drawn_map(*("".join(row) for row in rows)), 0.05, room_m)
    cells = np.argwhere(ground.passable)
    # From a center to the nearest side of a wall's square, in cells.
    off = np.maximum(np.abs(cells[:, None] - np.argwhere(ground.occupancy.occupied)) - 0.5, 0.0)
    nearest_m = np.hypot(off[..., 0], off[..., 1]).min(axis=1) * 0.05
    clear = np.abs(nearest_m - room_m) > 1e-9
    np.testing.assert_array_equal(ground.stops[tuple(cells[clear].T)], (nearest_m[clear] > room_m) | (not room_m))


def test_room_is_that_of_the_largest_outline():
    assert room_m({}, []) == pytest.approx(circumscribed_radius_m(padded_outline(0.22, 0.01)))
    assert room_m({"robot_radius": "0.4", "footprint_padding": 0.0}, []) == pytest.approx(0.4)


def test_obstacles_leave_the_robots_own_room_at_its_stops(made):
    """`robot_diameter` of 0.2 m alone would let a box stand 0.15 m from the start."""
    boxes = "  - ObstacleVariation: {obstacle_configs: [{amount: 3, max_distance: 0.5, args: 'width:=0.3'}], robot_diameter: 0.2, placement: constructive}\n"
    found = made(PATHS.format(seed=5) + boxes)
    assert [r.reason for r in found.rejections if r.producer == "start_check"] == []
    assert len(found.configurations) > 20


@each_row("start", [(9.3, 2.0), (-1.4, 2.0), (1e9, 100.0)])
def test_start_outside_map_is_rejected_at_any_distance(made, start):
    varied = (
        f"  variations:\n  - ParameterVariationList: {{name: start_pose, values: [{{x: {start[0]}, y: {start[1]}}}]}}\n"
    )
    (rejected,) = made(poses((4.0, 1.0), more=varied)).rejections
    assert rejected.reason == f"start_pose ({start[0]:g}, {start[1]:g}) lies outside of the map"
