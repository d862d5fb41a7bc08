"""Zones of costmap filters in figures, and figures of a pair of campaigns."""

import io

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from vastflow.oracles.figures.case_figure import Case, PlanView, pair_figure, plan_view_figure
from vastflow.oracles.figures.maps import zone_handles
from vastflow.oracles.figures.scene import NO_ZONES, Zones, zones_of
from vastflow.oracles.figures.style import png
from vastflow.oracles.observation.situation import Situation
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.world.map_file import load_map, map_content
from vastflow.sim.world.occupancy import OccupancyMap

ROOM = np.zeros((80, 80), dtype=np.int8)
ROOM[[0, -1], :] = ROOM[:, [0, -1]] = 100
FILTERS = """
global_costmap:
  global_costmap:
    ros__parameters:
      filters: [own]
      own: {plugin: "nav2_costmap_2d::KeepoutFilter"}
"""


@pytest.fixture
def occupancy():
    """A room of 4 m × 4 m."""
    return OccupancyMap(ROOM, 0.05, (0.0, 0.0))


def zone(x_m, y_m, value, yaw_rad=0.0):
    """A mask of 1 m × 1 m with a corner at a place, all of one value."""
    return OccupancyMap(np.full((10, 10), value, dtype=np.int8), 0.1, (x_m, y_m), yaw_rad)


def colors_at(figure, axes, *points):
    """RGB of a figure at points of its axes."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = np.asarray(canvas.buffer_rgba())
    pixels = [axes.transData.transform(point) for point in points]
    return [tuple(picture[picture.shape[0] - 1 - int(y), int(x), :3].tolist()) for x, y in pixels]


def plan_view(occupancy, zones):
    figure = plan_view_figure(PlanView("room", occupancy, Situation(None, (), ()), np.zeros((0, 2)), zones))
    return figure, figure.axes[0]


def test_zones_are_tinted_by_kind_and_value(occupancy):
    figure, axes = plan_view(occupancy, Zones((zone(0.5, 0.5, 100),), (zone(2.5, 2.5, 100),)))
    keepout, speed, beside = colors_at(figure, axes, (1.0, 1.0), (3.0, 3.0), (1.0, 3.0))
    assert beside == (255, 255, 255)
    assert sum(keepout) < 550 < sum(speed) < 700
    assert speed[2] < speed[0]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["kept out by a mask", "slower by a mask"]
    weak, strong, unknown = zone(0.5, 0.5, 20), zone(2.0, 0.5, 90), zone(0.5, 2.0, 0)
    found = colors_at(*plan_view(occupancy, Zones((weak, strong, unknown))), (1.0, 1.0), (2.5, 1.0), (1.0, 2.5))
    assert sum(found[1]) < sum(found[0]) < sum(found[2]) == 765
    inside, outside = colors_at(*plan_view(occupancy, Zones((zone(2.0, 0.5, 100, np.pi / 4),))), (2.0, 1.2), (2.9, 0.6))
    assert sum(inside) < 550 and outside == (255, 255, 255)
    assert zone_handles(NO_ZONES) == []


def test_pair_figure_has_zones_of_each_side(occupancy):
    situation = Situation(Pose(0.5, 2.0, 0.0), (Pose(3.5, 2.0, 0.0),), ())
    masks = Zones(keepout=(zone(0.5, 0.5, 100),)), Zones(speed=(zone(2.5, 2.5, 100),))
    before, after = (Case("", occupancy, situation, (), (), zones=zones) for zones in masks)
    figure = pair_figure("room", (before, after))
    points = (1.0, 1.0), (3.0, 3.0)
    (kept_out, plain), (as_plain, slower) = (colors_at(figure, axes, *points) for axes in figure.axes)
    assert plain == as_plain == (255, 255, 255)
    assert sum(kept_out) < 550 < sum(slower) < 700
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words[-2:] == ["kept out by a mask", "slower by a mask"]


def test_zones_of_scenarios_are_masks_of_enabled_filters(tmp_path):
    Image.fromarray(np.full((10, 10), 0, dtype=np.uint8)).save(tmp_path / "mask.pgm")
    (tmp_path / "mask.yaml").write_text(
        "{image: mask.pgm, resolution: 0.1, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, free_thresh: 0.196}"
    )
    (tmp_path / "own.yaml").write_text(FILTERS)
    mask = {"keepout_mask": map_content(tmp_path / "mask.yaml")}
    filtered = {**mask, "nav2_params": nav2_file(tmp_path / "own.yaml")}
    with_filter, without = (Scenario("builtin:navigate_to_pose", 1.0, {}, {}, system) for system in (filtered, mask))
    found = zones_of([with_filter, with_filter])
    assert (len(found.keepout), found.speed) == (1, ())
    assert (found.keepout[0].cells == 100).all()
    assert zones_of([without]).keepout == ()


def a_side(build, tmp_path, title, said, chosen=0):
    occupancy = load_map(build.write_map(tmp_path / title, build.walled_room(8.0, 6.0)))
    situation = Situation(Pose(1.0, 1.0, 0.0), (Pose(6.0, 4.0, 0.0),), ())
    paths = [(judgement, np.linspace((1.0, 1.0), (6.0, 1.0 + k), 40)) for k, judgement in enumerate(said)]
    return Case(title, occupancy, situation, (), paths, chosen)


def drawn(*sides):
    content = png(pair_figure("c1", sides))
    return content, np.asarray(Image.open(io.BytesIO(content)).convert("RGB")).astype(int)


def colored(pixels, rgb):
    return int((np.abs(pixels - rgb).sum(axis=2) < 30).sum())


def test_pair_figure_draws_both_sides(build, tmp_path):
    sides = a_side(build, tmp_path, "A", ("pass", "pass")), a_side(build, tmp_path, "B", ("fail", "pass"))
    _, pixels = drawn(*sides)
    left, right = pixels[:, : pixels.shape[1] // 2], pixels[:, pixels.shape[1] // 2 :]
    blue, vermilion = (0, 114, 178), (213, 94, 0)
    assert colored(left, blue) > 200 and colored(right, vermilion) > 200
    assert colored(right[:-90], blue) < colored(left[:-90], blue)
    assert drawn(*sides)[0] == drawn(*sides)[0]
    empty = a_side(build, tmp_path, "C", (), chosen=None), a_side(build, tmp_path, "D", ("not judged",), chosen=None)
    assert drawn(*empty)[0].startswith(b"\x89PNG")
