"""Scenes of a synthetic campaign directory, zones of costmap filters, and figures of a pair of campaigns."""

import json

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from PIL import Image
from table import each_row

from vastflow.oracles.figures.case_figure import Case, case_figure, pair_figure, plan_view_figure
from vastflow.oracles.figures.charts import factor_figure
from vastflow.oracles.figures.maps import map_figure, zone_handles
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.page.words import factor_text
from vastflow.oracles.query import scene as scenes
from vastflow.oracles.query.scene import (
    NO_ZONES,
    Zones,
    known_extent_m,
    read_mover_paths,
    read_walks,
    scenes_of,
    zones_of,
)
from vastflow.oracles.results.executed import environment_names
from vastflow.oracles.results.tables import FAIL, PASS, read_tables
from vastflow.oracles.results.units import Units
from vastflow.oracles.statistics.effects import Claim, FactorEffect, LevelEffect
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Recording, Run
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.world.bodies import Body, Disc
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.world import World, map_content

TASK = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
WAY = [(1.0 + 0.1 * i, 2.0) for i in range(41)]


@pytest.fixture
def directory(synthetic_campaign, room, build):
    """Ten runs of which the last three end at x = 2.9 m, and a configuration without a recording."""
    runs = [build.a_recording(WAY, run_index=i) for i in range(7)]
    runs += [build.a_recording(WAY[:20], run_index=i, outcome="aborted", reason="stuck") for i in (7, 8, 9)]
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=runs, obstacles=[build.box_at(3.0, 3.0)])
    synthetic_campaign.add("a-2", "a", room, TASK, fault="fault: MemoryError", runs=2)
    return synthetic_campaign.write()


def test_walks_are_true_paths_of_runs(directory):
    walks = read_walks(directory, "a-1")
    assert walks.run_index.tolist() == list(range(10))
    assert walks.ends_xy_m[[0, 9]].tolist() == pytest.approx(np.array([[5.0, 2.0], [2.9, 2.0]]))
    line = walks.line(9)
    assert line[0].tolist() == [1.0, 2.0] and line[-1].tolist() == pytest.approx([2.9, 2.0])
    assert len(line) == 20
    assert read_walks(directory, "a-2") is None


def test_programs_without_a_robot_have_no_walks(tmp_path):
    (tmp_path / "recordings").mkdir()
    run = Run(0, "0", "succeeded", 0, "", 1.0, 0.0, 0, 0)
    (tmp_path / "recordings" / "a-1.parquet").write_bytes(write_recordings([Recording(run, {})]))
    assert read_walks(tmp_path, "a-1") is None


def test_paths_of_movers_are_those_of_the_run_and_are_drawn_dotted(tmp_path, occupancy):
    (tmp_path / "recordings").mkdir()
    recordings = [
        Recording(
            Run(k, "0", "succeeded", 0, "", 1.0, 0.0, 0, 0),
            {
                name: np.array(column, dtype=np.int32)
                for name, column in {
                    "t_ms": [0, 100],
                    "mover_x_mm/cart": [1000 + k, 2000 + k],
                    "mover_y_mm/cart": [500, 700],
                }.items()
            },
        )
        for k in (0, 1)
    ]
    (tmp_path / "recordings" / "a-1.parquet").write_bytes(write_recordings(recordings))
    (path,) = read_mover_paths(tmp_path, "a-1", 1, ["cart"])
    assert path == pytest.approx(np.array([(1.001, 0.5), (2.001, 0.7)]))
    assert read_mover_paths(tmp_path, "a-1", 1, ["dog"]) == read_mover_paths(tmp_path, "a-1", 1, []) == []
    figure = case_figure(Case("", World(occupancy), Situation(None, (), ()), (), (), mover_paths=[path]))
    assert any(np.array_equal(line.get_xydata(), path) for line in figure.axes[0].lines)


def test_scene_has_counts_and_final_poses(directory):
    (scene,) = scenes_of(read_tables(directory))
    assert (scene.runs.passed, scene.runs.failed, scene.runs.not_judged) == (7, 3, 2)
    assert scene.failed_xy_m == pytest.approx(np.array([[2.9, 2.0]] * 3))
    assert scene.missed.tolist() == [True, True, True]
    assert (len(scene.lines[PASS]), len(scene.lines[FAIL])) == (7, 3)
    assert scene.starts_xy_m.tolist() == [[1.0, 2.0]]
    assert len(scene.obstacles) == 1

    def at(*xy_m):
        column, row = np.floor((np.array(xy_m) - found.grid.origin_xy_m) / found.grid.cell_m).astype(int)
        return int(found.failures[row, column]), int(found.visits[row, column])

    found = scene.failures
    assert [at(1.3, 2.01), at(2.88, 2.01), at(4.8, 2.01), at(4.8, 3.5)] == [(0, 10), (3, 10), (0, 7), (0, 0)]


def test_scene_leaves_out_broken_configuration(synthetic_campaign, room, build):
    broken = {**build.box_at(3.0, 3.0), "xacro_arguments": "size:=0.4"}
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=[build.a_recording(WAY)])
    fault = "ValueError: a box has no argument 'size'"
    synthetic_campaign.add("a-2", "a", room, TASK, fault=fault, runs=1, obstacles=[broken])
    (scene,) = scenes_of(read_tables(synthetic_campaign.write()))
    assert (scene.runs.passed, scene.runs.not_judged, len(scene.obstacles)) == (1, 1, 0)


def test_environment_names_match_files(directory, room):
    environment = read_tables(directory).configurations.environments[0]
    assert environment_names(directory, [environment]) == {environment: environment[:8]}
    (directory / "inputs").mkdir()
    for file in room.parent.iterdir():
        (directory / "inputs" / file.name.replace(".yaml", "_of_mine.yaml")).write_bytes(file.read_bytes())
    assert environment_names(directory, [environment]) == {environment: "map_of_mine"}


def test_scenes_are_maps_with_most_failures_and_maps_of_one_plan_are_numbered(
    synthetic_campaign, tmp_path, build, monkeypatch
):
    for k in range(2):
        room = build.write_map(tmp_path / f"room{k}", build.walled_room(6.0 + k, 4.0))
        outcome = {"outcome": "aborted", "reason": "stuck"} if k == 1 else {}
        synthetic_campaign.add(f"a-{k}", "a", room, TASK, recordings=[build.a_recording(WAY, **outcome)])
    tables = read_tables(synthetic_campaign.write())
    environments = tables.configurations.environments
    for k, environment in enumerate(environments):
        text = json.dumps({"file": "plans/office_wing.fpm", "seed": k})
        (tables.directory / "environments" / environment / "provenance.json").write_text(text)
    assert [*environment_names(tables.directory, environments).values()] == ["office_wing 1", "office_wing 2"]
    monkeypatch.setattr(scenes, "MAX_SCENES", 1)
    assert [scene.environment for scene in scenes_of(tables)] == [environments[1]]


def test_turned_map_is_drawn_in_its_frame(tmp_path, build):
    """Every cell of the map has its color on the figure at its place in the map's frame."""
    file = build.write_map(tmp_path / "room", build.walled_room(4.0, 3.0), origin_xy_m=(1.0, -2.0))
    file.write_text(file.read_text().replace("-2.0, 0.0]", "-2.0, 0.5]"))
    occupancy = load_map(file)
    assert occupancy.yaw_rad == 0.5
    x0, x1, y0, y1 = known_extent_m(occupancy, 0.0)
    corners = occupancy.corners_of(np.array([(r, c) for r in (0, 60) for c in (0, 80)]))
    assert (x0, y0, x1, y1) == pytest.approx((*corners.min(axis=0), *corners.max(axis=0)))
    cells = [(0, 40), (59, 3), (30, 0), (30, 40), (10, 70)]
    places = [occupancy.center_of(*cell) for cell in cells]
    *found, beside = colors_at(*map_figure(occupancy, 1), *places, (x0 + 0.1, y0 + 0.1))
    assert [red < 128 for red, _, _ in found] == [True, True, True, False, False]
    assert beside != (255, 255, 255)  # in the bounds, and off the turned map


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
    figure = plan_view_figure(Case("room", World(occupancy), Situation(None, (), ()), (), (), zones=zones))
    return figure, figure.axes[0]


@each_row("draw", [plan_view_figure, case_figure])
@each_row("known", [True, False])
def test_figures_show_bodies_of_world(occupancy, draw, known):
    world = World(occupancy if known else None, bodies=(Body("b", Disc(0.3), Pose(1.0, 1.0, 0.0)),))
    figure = draw(Case("room", world, Situation(Pose(1.5, 1.5, 0.0), (), ()), (), ()))
    on_body, beside = colors_at(figure, figure.axes[0], (1.0, 1.0), (1.6, 1.0))
    assert sum(on_body) < sum(beside) - 150


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
    paths = [("fail", np.array([(0.5, 2.0), (3.5, 2.0)]))]
    before, after = (Case("", World(occupancy), situation, (), paths, 0, zones=zones) for zones in masks)
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


def test_factor_figure_has_one_artist_for_all_situations_and_few_labels():
    claim = Claim(0.5)
    levels = [LevelEffect(str(k), 1, 2, None, None, 3, 0.5, 0.5) for k in range(600)]
    rates = [[None if (k + of) % 7 == 0 else 0.5 for k in range(600)] for of in range(50)]
    effect = FactorEffect("x", levels, "0", "1", 0.0, claim, claim, rates=rates)
    (axes,) = factor_figure([effect]).axes
    (lines,) = [each for each in axes.collections if isinstance(each, LineCollection)]
    assert len(lines.get_segments()) == 50
    assert len(axes.lines) == 2
    assert [each.get_text() for each in axes.get_xticklabels()] == [str(k) for k in range(0, 600, 30)]


def test_level_without_compared_runs_has_no_point_and_no_rate_in_words():
    claim = Claim(0.01, shown=True)
    told = [("90", 0, 6), ("135", 0, 0), ("180", 3, 3)]
    levels = [LevelEffect(name, failed, runs, None, None, 1, 0.5, 0.5) for name, failed, runs in told]
    effect = FactorEffect("angle", levels, "180", "90", 1.0, claim, claim)
    (axes,) = factor_figure([effect]).axes
    np.testing.assert_array_equal(axes.lines[-1].get_ydata(), [0.0, np.nan, 1.0])
    said = factor_text(effect, Units(np.arange(1), "path", "paths on this map"))
    assert said.startswith("angle matters on this path: 180 fails 3 of 3 runs, 90 none of 6 (")
