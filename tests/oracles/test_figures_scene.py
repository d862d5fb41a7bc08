"""Walks and scenes of a synthetic campaign directory."""

import json

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from vastflow.oracles.figures import scene as scenes
from vastflow.oracles.figures.maps import map_figure
from vastflow.oracles.figures.scene import known_extent_m, read_walks, scenes_of
from vastflow.oracles.results.executed import environment_names
from vastflow.oracles.results.tables import CODES, FAIL, PASS, read_tables
from vastflow.sim.world.map_file import load_map

TASK = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
WAY = [(1.0 + 0.1 * i, 2.0) for i in range(41)]


@pytest.fixture
def directory(synthetic_campaign, tmp_path, build):
    """Ten runs of which the last three end at x = 2.9 m, and a configuration without a recording."""
    room = build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))
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


def test_scene_has_counts_and_final_poses(directory):
    (scene,) = scenes_of(read_tables(directory))
    assert (scene.runs.passed, scene.runs.failed, scene.runs.not_judged) == (7, 3, 2)
    assert scene.failed_xy_m == pytest.approx(np.array([[2.9, 2.0]] * 3))
    assert scene.missed.tolist() == [True, True, True]
    assert (len(scene.lines[PASS]), len(scene.lines[FAIL])) == (7, 3)
    assert scene.starts_xy_m.tolist() == [[1.0, 2.0]]
    assert len(scene.obstacles) == 1

    def at(x_m, y_m):
        column, row = ((np.array([x_m, y_m]) - scene.failures.grid.origin_xy_m) / scene.failures.grid.cell_m).astype(
            int
        )
        return int(scene.failures.failures[row, column]), int(scene.failures.visits[row, column])

    found = [at(*place) for place in ((1.3, 2.01), (2.88, 2.01), (4.8, 2.01), (4.8, 3.5))]
    assert found == [(0, 10), (3, 10), (0, 7), (0, 0)]


def test_scene_leaves_out_broken_configuration(synthetic_campaign, tmp_path, build):
    room = build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))
    broken = {**build.box_at(3.0, 3.0), "xacro_arguments": "size:=0.4"}
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=[build.a_recording(WAY)])
    synthetic_campaign.add(
        "a-2", "a", room, TASK, fault="ValueError: a box has no argument 'size'", runs=1, obstacles=[broken]
    )
    (scene,) = scenes_of(read_tables(synthetic_campaign.write()))
    assert (scene.runs.passed, scene.runs.not_judged, len(scene.obstacles)) == (1, 1, 0)


def test_scene_draws_evenly_chosen_runs(directory, monkeypatch):
    monkeypatch.setattr(scenes, "MAX_LINES", 3)
    (scene,) = scenes_of(read_tables(directory))
    assert [len(scene.lines[code]) for code in CODES.values()] == [3, 3, 0]
    assert scene.runs.passed == 7


def test_scenes_are_maps_with_most_failures(synthetic_campaign, tmp_path, build, monkeypatch):
    for k in range(3):
        room = build.write_map(tmp_path / f"room{k}", build.walled_room(6.0 + k, 4.0))
        outcome = {"outcome": "aborted", "reason": "stuck"} if k == 1 else {}
        synthetic_campaign.add(f"a-{k}", "a", room, TASK, recordings=[build.a_recording(WAY, **outcome)])
    tables = read_tables(synthetic_campaign.write())
    monkeypatch.setattr(scenes, "MAX_SCENES", 1)
    assert [scene.environment for scene in scenes_of(tables)] == [tables.configurations.environments[1]]


def test_environment_names_are_those_of_files(directory, tmp_path):
    environment = read_tables(directory).configurations.environments[0]
    assert environment_names(directory, [environment]) == {environment: environment[:8]}
    (directory / "inputs").mkdir()
    for file in (tmp_path / "room").iterdir() if (tmp_path / "room").is_dir() else tmp_path.glob("room*"):
        (directory / "inputs" / file.name.replace(".yaml", "_of_mine.yaml")).write_bytes(file.read_bytes())
    assert environment_names(directory, [environment])[environment].endswith("_of_mine")


def test_environment_names_number_maps_of_one_plan(synthetic_campaign, tmp_path, build):
    for k in range(2):
        room = build.write_map(tmp_path / f"room{k}", build.walled_room(6.0 + k, 4.0))
        synthetic_campaign.add(f"a-{k}", "a", room, TASK, recordings=[build.a_recording(WAY)])
    directory = synthetic_campaign.write()
    environments = read_tables(directory).configurations.environments
    for k, environment in enumerate(environments):
        text = json.dumps({"file": "plans/office_wing.fpm", "seed": k})
        (directory / "environments" / environment / "provenance.json").write_text(text)
    assert list(environment_names(directory, environments).values()) == ["office_wing 1", "office_wing 2"]


def test_turned_map_is_drawn_in_its_frame(tmp_path, build):
    """Every cell of the map has its color on the figure at its place in the map's frame."""
    file = build.write_map(tmp_path / "room", build.walled_room(4.0, 3.0), origin_xy_m=(1.0, -2.0))
    file.write_text(file.read_text().replace("-2.0, 0.0]", "-2.0, 0.5]"))
    occupancy = load_map(file)
    assert occupancy.yaw_rad == 0.5
    x0, x1, y0, y1 = known_extent_m(occupancy, 0.0)
    corners = occupancy.corners_of(np.array([(r, c) for r in (0, 60) for c in (0, 80)]))
    assert (x0, y0, x1, y1) == pytest.approx((*corners.min(axis=0), *corners.max(axis=0)))
    figure, axes = map_figure(occupancy, 1)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = np.asarray(canvas.buffer_rgba())
    for cell, dark in (((0, 40), True), ((59, 3), True), ((30, 0), True), ((30, 40), False), ((10, 70), False)):
        column, up = axes.transData.transform(occupancy.center_of(*cell))
        assert (picture[picture.shape[0] - 1 - int(up), int(column), 0] < 128) == dark, cell
    column, up = axes.transData.transform((x0 + 0.1, y0 + 0.1))  # in the bounds, and off the turned map
    assert tuple(picture[picture.shape[0] - 1 - int(up), int(column), :3]) != (255, 255, 255)
