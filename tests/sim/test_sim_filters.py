"""Costmap filters: how files have them, what masks do to costmaps and controllers, and where a robot drives with them."""

import numpy as np
import pytest
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.plug_in import ContractError
from vastflow.sim.kernels.record import record_of
from vastflow.sim.model.faults import FileError, ScenarioError
from vastflow.sim.nav2.controllers.binding import running
from vastflow.sim.nav2.controllers.controller import Setting
from vastflow.sim.nav2.controllers.speed_zones import limit_speed, speed_zones
from vastflow.sim.nav2.costmaps.filters import keep_out_of_window, keepout_mask, on_map, with_keepout
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.nav2.navigator.kernels import with_kernels
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.costmaps import masks_of
from vastflow.sim.nav2.parameter_files.document import parse
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.plug_ins import find_controller
from vastflow.sim.nav2.parameters.costmap import KeepoutFilter, SpeedFilter
from vastflow.sim.reading.checked import checked_digest
from vastflow.sim.world.occupancy import OccupancyMap

RESOLUTION_M = 0.05
STREAM = np.array([1], dtype=np.uint64)
FILE = """
global_costmap:
  global_costmap:
    ros__parameters:
      filters: [keepout, slow]
      keepout: {plugin: "nav2_costmap_2d::KeepoutFilter", enabled: true, filter_info_topic: keepout_info}
      slow: {plugin: "nav2_costmap_2d::SpeedFilter", filter_info_topic: /slow_info, speed_limit_topic: speed_limit}
keepout_info_server:
  ros__parameters: {type: 0, filter_info_topic: keepout_info, mask_topic: keepout_mask, base: 0.0, multiplier: 1.0}
slow_info_server:
  ros__parameters: {type: 2, filter_info_topic: slow_info, mask_topic: slow_mask, base: 1.0, multiplier: -0.01}
"""


def with_filters(stack, *maps, **filters):
    return stack.with_values(**{name: getattr(stack, name).with_values(**filters) for name in maps})


def floor():
    """14 m × 4 m with walls round it."""
    cells = np.zeros((80, 280), dtype=np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    return OccupancyMap(cells, RESOLUTION_M, (0.0, 0.0))


def mask(values, resolution_m=RESOLUTION_M, origin_xy_m=(0.0, 0.0), yaw_rad=0.0):
    return OccupancyMap(np.asarray(values, dtype=np.int8), resolution_m, origin_xy_m, yaw_rad)


def test_filter_without_a_mask_is_refused_with_the_line_that_would_be_right():
    expected = r"keepout_mask: The keepout filter of the global_costmap has no mask. Add 'keepout_mask: keepout.yaml'"
    with pytest.raises(ScenarioError, match=expected):
        masks_of({}, interpretation(parse(FILE, "n.yaml")).parameters)


OWN = """
from vastflow.sim.kernels.plug_in import kernel
from vastflow.sim.nav2.controllers.controller import Controller, SpeedLimits

@kernel
def stand(q, memory, given):
    return True, 0.0, 0.0

class Unlimited(Controller):
    compute_velocity = stand

class Misnamed(Controller):
    compute_velocity = stand
    def speed_limits(self): return SpeedLimits(("speed",), 0.5)
"""


def test_speed_filter_beside_a_controller_without_right_limits_is_a_fault(tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    text = FILE + "controller_server: {ros__parameters: {controller_plugins: [F], F.plugin: 'own.py:Unlimited'}}"
    expected = (
        r"filters: The speed filter can't limit the controller Unlimited\. Choose a controller with speed_limits\(\)"
    )
    with pytest.raises(FileError, match=expected):
        interpretation(parse(text, str(tmp_path / "n.yaml")))
    controller = find_controller("own.py:Misnamed", tmp_path)()
    found = running(controller, Setting(60, 60, RESOLUTION_M, 0.25, 0.25, STREAM))
    with pytest.raises(
        ContractError, match=r"own.py:12: speed_limits of Misnamed scales 'speed'\. It must name its own"
    ):
        speed_zones(floor(), floor(), SpeedFilter(), found)


def test_digest_depends_on_the_mask_cells_that_a_filter_reads(scenario, saved):
    masks, costmap = (
        [saved(mask(np.full((4, 4), k))) for k in (0, 100)],
        "global_costmap.global_costmap.ros__parameters",
    )
    keepout = {f"{costmap}.filters": ["k"], f"{costmap}.k.plugin": "nav2_costmap_2d::KeepoutFilter"}
    assert len({checked_digest(scenario(keepout_mask=each, **keepout)) for each in masks}) == 2
    assert len({checked_digest(scenario(keepout_mask=each)) for each in masks}) == 1


def test_keepout_mask_raises_costs_and_unknown_cells_where_its_yaml_says():
    keepout = on_map(keepout_mask(mask([[0, 50, 100, -1]]), over := mask([[0, 0, 0, 0]])), over)
    assert keepout.tolist() == [[0, 127, 254, 255]]
    assert with_keepout(np.array([[10, 10, 10, 10]], dtype=np.uint8), keepout).tolist() == [[10, 127, 254, 10]]
    assert with_keepout(np.full((1, 4), 255, dtype=np.uint8), keepout).tolist() == [[0, 127, 254, 255]]
    # Cells of 0.1 m from (0.1, 0.05) on cover columns 2 and 3 of the finer map from row 1.
    found = on_map(keepout_mask(mask([[100]], 0.1, (0.1, 0.05)), over := mask(np.zeros((4, 6)))), over)
    assert np.argwhere(found == 254).tolist() == [[1, 2], [1, 3], [2, 2], [2, 3]]


@njit
def window_kept_out(window, mask, map_odom, q, x, y):
    keep_out_of_window(window, mask, map_odom, q, x, y)


def test_local_mask_follows_localization():
    window = Window(np.zeros((20, 20), dtype=np.uint8), np.array([-0.5, -0.5, 0.05]))
    zone = mask([[100]], 0.2, (2.0, 3.0))
    # The odom frame's origin is at (2.1, 2.6), turned by a quarter: what is 0.5 m ahead there is 0.5 m up on the map.
    q = record_of(KeepoutFilter())[0]
    window_kept_out(window, keepout_mask(zone, floor()), (2.1, 2.6, np.pi / 2), q, 2.1, 2.6)
    rows, columns = np.nonzero(window.costs == 254)
    x, y = -0.5 + (columns + 0.5) * 0.05, -0.5 + (rows + 0.5) * 0.05
    assert (x.min(), x.max(), y.min(), y.max()) == pytest.approx((0.425, 0.475, -0.075, 0.075))


@each_row(
    ("q", "x_m", "cost"),
    [
        (KeepoutFilter(), 2.1, 254),
        (KeepoutFilter(override_lethal_cost=True), 2.1, 252),
        (KeepoutFilter(override_lethal_cost=True, lethal_override_cost=200), 2.1, 200),
        (KeepoutFilter(override_lethal_cost=True, lethal_override_cost=255), 2.1, 252),
        (KeepoutFilter(override_lethal_cost=True), 2.3, 254),  # on the mask's free cell
        (KeepoutFilter(override_lethal_cost=True), 9.0, 254),  # beside the mask
    ],
)
def test_lethal_cells_cost_less_while_the_robot_is_on_one(q, x_m, cost):
    window = Window(np.full((20, 20), 10, dtype=np.uint8), np.array([2.0, 3.0, 0.05]))
    zone = keepout_mask(mask([[100, 0]], 0.2, (2.0, 3.0)), floor())
    window_kept_out(window, zone, (0.0, 0.0, 0.0), record_of(q)[0], x_m, 3.1)
    assert sorted({*window.costs.flat}) == [10, cost]


@njit
def limited(zones, x, y):
    limit_speed(zones, x, y)


def limits_at(kind, q, values, names):
    """The parameters of a controller at each cell of a mask in turn."""
    controller = with_kernels(parameters_of({"controller": kind}).controller)
    found = running(controller, Setting(60, 60, RESOLUTION_M, 0.25, 0.25, STREAM))
    zones = speed_zones(mask([values]), floor(), q, found)
    rows = []
    for k in range(len(values)):
        limited(zones, (k + 0.5) * RESOLUTION_M, 0.5 * RESOLUTION_M)
        rows.append(tuple(round(float(found.parameters[name][0]), 6) for name in names))
    return rows


@each_row(
    ("kind", "names", "full"),
    [
        ("mppi", ("vx_max", "vx_min", "vy_max", "wz_max", "ax_max"), (0.5, -0.35, 0.5, 1.9, 3.0)),
        ("dwb", ("max_vel_x", "max_speed_xy", "max_vel_theta", "min_vel_x", "acc_lim_x"), (0.26, 0.26, 1.0, 0.0, 2.5)),
        ("rpp", ("desired_linear_vel", "rotate_to_heading_angular_vel"), (0.5, 1.8)),
    ],
)
def test_speed_limit_in_percent_scales_speeds_of_controller(kind, names, full):
    unscaled = {"ax_max", "min_vel_x", "acc_lim_x", "rotate_to_heading_angular_vel"}
    half = tuple(value if name in unscaled else round(0.5 * value, 6) for name, value in zip(names, full, strict=True))
    # 0 is no limit, -1 changes nothing, and 120 % is out of bounds, which is no limit again.
    assert limits_at(kind, SpeedFilter(type=1), [0, 50, -1, 0], names) == [full, half, half, full]
    assert limits_at(kind, SpeedFilter(type=1, base=100.0, multiplier=1.0), [20], names) == [full]


def test_speed_limit_in_meters_per_second_acts_as_in_nav2():
    """MPPI scales by whatever it is, DWB only downward, and RPP drives at it."""
    q = SpeedFilter(type=2, base=0.0, multiplier=0.01)
    assert limits_at("mppi", q, [25, 100], ("vx_max", "wz_max")) == [(0.25, 0.95), (1.0, 3.8)]
    assert limits_at("dwb", q, [13, 60, 0], ("max_vel_x", "max_vel_theta")) == [(0.13, 0.5), (0.13, 0.5), (0.26, 1.0)]
    assert limits_at("rpp", q, [25, 100], ("desired_linear_vel",)) == [(0.25,), (1.0,)]


def test_robot_with_a_keepout_filter_drives_ten_meters_round_an_area(over_a_floor):
    """The mask has a rim of 0.4 m that costs, or the path would run along the area's edge."""
    values = np.zeros((80, 280))
    values[20:60, 92:148] = 60
    values[28:52, 100:140] = 100  # from (5.0, 1.4) to (7.0, 2.6)
    stack = parameters_of({"controller": "rpp"})
    keeping = with_filters(stack, "local_costmap", "global_costmap", keepout_filter=KeepoutFilter())
    found = [over_a_floor(keeping, masks=(mask(values),)), over_a_floor(stack)]
    assert [each.run.outcome for each in found] == ["succeeded", "succeeded"]
    x_mm, y_mm = ([each.columns[name] for each in found] for name in ("x_mm", "y_mm"))
    within = [np.any((np.abs(x_mm[k] - 6000) < 1000) & (np.abs(y_mm[k] - 2000) < 600)) for k in (0, 1)]
    assert within == [False, True]


def test_robot_leaves_the_zone_that_it_starts_in_by_the_override(over_a_floor):
    values = np.zeros((80, 280))
    values[20:60, :60] = 100  # up to x = 3 m
    own = KeepoutFilter(override_lethal_cost=True)
    stack = with_filters(parameters_of({}), "local_costmap", "global_costmap", keepout_filter=own)
    assert over_a_floor(stack, masks=(mask(values),)).run.outcome == "succeeded"


@each_row("controller", ["mppi", "dwb", "rpp"])
def test_robot_with_a_speed_filter_drives_ten_meters_partly_at_half_speed(over_a_floor, controller):
    values = np.zeros((80, 280))
    values[:, 100:160] = 50  # from x = 5 m to x = 8 m
    stack = parameters_of({"controller": controller})
    slow = with_filters(stack, "global_costmap", speed_filter=SpeedFilter(type=1))
    found = over_a_floor(slow, masks=(None, mask(values)))
    assert found.run.outcome == "succeeded"
    # The global costmap is updated once a second: half a meter after the border at the latest.
    x_mm, speed = found.columns["x_mm"], found.columns["speed_mmps"]
    there, before = speed[(x_mm > 6000) & (x_mm < 7800)], speed[(x_mm > 2500) & (x_mm < 4800)]
    assert there.mean() / before.mean() == pytest.approx(0.5, abs=0.06)
