"""Maps and scenarios for tests of the simulator."""

import itertools
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import drive
from outside import paper_map
from PIL import Image

from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Recording
from vastflow.sim.model.scenario import Mission, Scenario, scenario_of
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nav2.system.robot import robot_of
from vastflow.sim.reading.abstract import abstract_content
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar
from vastflow.sim.world.world import World, map_content

CELLS = {".": 0, "#": 100, "?": -1}
GRAY = {0: 254, 100: 0, -1: 205}
RESOLUTION_M = 0.05


@pytest.fixture(scope="session")
def drawn() -> Callable[..., OccupancyMap]:
    """An occupancy map of rows of text, the top row first; each letter makes `cells` × `cells` cells."""

    def draw(*rows: str, cells: int = 1, resolution_m: float = RESOLUTION_M) -> OccupancyMap:
        letters = np.array([[CELLS[letter] for letter in row] for row in rows[::-1]], dtype=np.int8)
        return OccupancyMap(np.kron(letters, np.ones((cells, cells), dtype=np.int8)), resolution_m, (0.0, 0.0))

    return draw


@pytest.fixture(scope="session")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Callable[[OccupancyMap], FileContent]:
    """A map as files, the way a campaign names it."""

    def save(occupancy: OccupancyMap) -> FileContent:
        folder = tmp_path_factory.mktemp("map")
        gray = np.select([occupancy.cells == value for value in GRAY], list(GRAY.values())).astype(np.uint8)
        Image.fromarray(gray[::-1]).save(folder / "map.pgm")
        x, y = occupancy.origin_xy_m
        (folder / "map.yaml").write_text(
            f"image: map.pgm\nresolution: {occupancy.resolution_m}\norigin: [{x}, {y}, {occupancy.yaw_rad!r}]\n"
            "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
        )
        return map_content(folder / "map.yaml")

    return save


@pytest.fixture(scope="session")
def two_rooms_map() -> OccupancyMap:
    """The map of `two_rooms`."""
    return OccupancyMap(rooms_cells(), RESOLUTION_M, (0.0, 0.0))


@pytest.fixture(scope="session")
def two_rooms(saved: Callable[[OccupancyMap], FileContent], two_rooms_map: OccupancyMap) -> FileContent:
    """Two rooms of 4 m × 5 m side by side with a door of 1.2 m.

    The door is at x 4.1..4.3 m, y 1.8..3.0 m; the rooms' free space is x 0.2..4.1 and 4.3..8.2, y 0.2..5.2.
    """
    return saved(two_rooms_map)


@pytest.fixture(scope="session")
def walled_off(saved: Callable[[OccupancyMap], FileContent]) -> FileContent:
    """The two rooms with their door walled up."""
    cells = rooms_cells()
    cells[:, 82:86] = 100
    return saved(OccupancyMap(cells, RESOLUTION_M, (0.0, 0.0)))


def rooms_cells() -> np.ndarray:
    cells = np.zeros((108, 168), dtype=np.int8)
    cells[:4], cells[-4:], cells[:, :4], cells[:, -4:] = 100, 100, 100, 100
    cells[:, 82:86] = 100
    cells[36:60, 82:86] = 0
    return cells


@pytest.fixture(scope="session")
def scenario(two_rooms: FileContent) -> Callable[..., Scenario]:
    """A mission in the two rooms, from one to the other unless `values` say otherwise."""

    def make(mission: str = "navigate_to_pose", timeout_s: float = 120.0, **values: Any) -> Scenario:
        given = {"map_file": two_rooms, "start_pose": {"x": 1.0, "y": 1.0}, **values}
        if "goal_pose" not in given and "goal_poses" not in given:
            given["goal_pose"] = {"x": 7.0, "y": 4.0, "yaw": 0.0}
        return scenario_of(given, {"obstacles": "environment"}, abstract=f"builtin:{mission}", timeout_s=timeout_s)

    return make


@pytest.fixture(scope="session")
def over_a_floor() -> Callable[..., Recording]:
    """A run over an empty floor of 14 m × 4 m from (1, 2) along x.

    The robot begins with its heading at `yaw_rad`; `cells` says which of the floor's (80, 280) are walls beside its edges.
    `masks` are those of the keepout and the speed filter.
    """

    def run(
        parameters: NavParameters,
        length_m: float = 10.0,
        yaw_rad: float = 0.0,
        goal_yaw_rad: float = 0.0,
        cells: Any = None,
        masks: tuple[OccupancyMap | None, ...] = (),
    ) -> Recording:
        floor = np.zeros((80, 280), dtype=np.int8) if cells is None else np.where(cells, 100, 0).astype(np.int8)
        floor[[0, -1]], floor[:, [0, -1]] = 100, 100
        prepared = prepare(World(OccupancyMap(floor, RESOLUTION_M, (0.0, 0.0))), Lidar(), parameters, *masks)
        mission = Mission("navigate_to_pose", (Pose(1.0 + length_m, 2.0, goal_yaw_rad),))
        robot, start = robot_of(parameters), Pose(1.0, 2.0, yaw_rad)
        return drive(prepared, parameters, Lidar(), robot, start, mission, (), (1, 2, 3), 120.0)

    return run


TRIAL = """\
import osc.gazebo
import osc.helpers
import osc.nav2
import osc.os
import osc.ros
import osc.sim

scenario trial:
    start: pose_3d = pose_3d(position_3d(1.0m, 1.0m))
    near: pose_3d = pose_3d(position_3d(3.0m, 1.0m))
    above: pose_3d = pose_3d(position_3d(3.0m, 4.0m))
    beyond: pose_3d = pose_3d(position_3d(7.0m, 4.0m))
    robot: differential_drive_robot
"""


@pytest.fixture
def staged(tmp_path: Path, two_rooms: FileContent) -> Callable[..., Scenario]:
    """A function that makes a scenario of the two rooms from a text, with a robot and four named poses.

    A text without a `do` lists actions that run one after the other once the robot knows that it is at `start`.
    """

    numbers = itertools.count()

    def make(text: str, *, timeout_s: float = 60.0, **values: Any) -> Scenario:
        body = textwrap.dedent(text).strip("\n")
        if "\ndo " not in f"\n{body}":
            body = "do serial:\n    robot.init_nav2(start)\n" + textwrap.indent(body, "    ")
        file = tmp_path / str(next(numbers)) / "trial.osc"
        file.parent.mkdir()
        file.write_text(TRIAL + textwrap.indent(body, "    ") + "\n")
        given = {"map_file": two_rooms, "controller": "rpp", **values}
        tags = {"obstacles": "environment", "crates": "environment", "static_objects": "environment"}
        return scenario_of(given, tags, abstract=abstract_content(file), timeout_s=timeout_s)

    return make


@pytest.fixture(scope="session")
def shared_map() -> Callable[[str], Path]:
    """One of the five maps of the paper's dataset, which lie beside the repository where they are."""
    return paper_map
