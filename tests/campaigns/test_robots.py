"""The five robots of `campaigns/robots`: what their files say of them, and a short form of the proof."""

import numpy as np
import pytest
from five_robots import FOLDER, ROBOTS, body_of, is_unnoted
from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.robots import robots_json
from vastflow.sim.model.recording import Event, Recording, Run
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.system.robot import lidar_of, robot_of
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Robot

POSE = ("t_ms", "x_mm", "y_mm", "yaw_mrad")


@pytest.fixture(scope="module", params=ROBOTS)
def campaign(request):
    return load_campaign(FOLDER / f"{request.param}.vast")


def test_campaign_notes_only_missing_nodes(campaign):
    assert [note.problem for note in campaign.notes if not note.problem.startswith("the file has no ")] == []
    assert {family.name for family in campaign.families} == {"office", "university"}


def test_robot_of_both_families_is_reported_once(campaign):
    (said,) = robots_json(campaign.families)
    assert said["families"] == ["office", "university"]


@each_row(
    ("name", "radius_m", "vertices", "speed_mps", "range_m"),
    [
        ("turtlebot3_burger", 0.105, 0, 0.22, 3.5),
        ("turtlebot3_waffle", 0.2558, 4, 0.26, 3.5),
        ("turtlebot4", 0.17, 0, 0.5, 20.0),
        ("rectangle", 0.7106, 4, 0.8, 25.0),
        ("forklift", 1.0867, 8, 1.0, 25.0),
    ],
)
def test_robot_follows_nav2_files(name, radius_m, vertices, speed_mps, range_m):
    values = load_campaign(FOLDER / f"{name}.vast").families[0].values
    parameters = parameters_of({key: value for key, value in values.items() if key == "nav2_params" or "robot." in key})
    robot = robot_of(parameters)
    assert robot.radius_m == pytest.approx(radius_m, abs=1e-4)
    assert (len(robot.vertices), robot.max_speed_mps, lidar_of(parameters).range_max_m) == (
        vertices,
        speed_mps,
        range_m,
    )


@each_row(
    ("x_mm", "contacts", "unnoted"), [(1200, (), False), (1750, (), True), (1750, (0.4,), False), (1750, (0.9,), True)]
)
def test_body_in_a_wall_without_a_contact_until_then_is_found(x_mm, contacts, unnoted):
    cells = np.zeros((40, 40), dtype=np.int8)
    cells[:, -2:] = 100  # from 1.9 m on
    columns = {
        name: np.array(values)
        for name, values in zip(POSE, ([0, 500], [1000, x_mm], [1000, 1000], [0, 0]), strict=True)
    }
    events = tuple(Event(t_s, "contact", 1.7, 1.0, "wall", 0.1) for t_s in contacts)
    ended = Run(0, "", "succeeded", 0, "", 0.5, 0.7, 0, 0, events)
    body = body_of(Robot(radius_m=0.2))
    assert is_unnoted(Recording(ended, columns), body, OccupancyMap(cells, 0.05, (0.0, 0.0))) == unnoted
