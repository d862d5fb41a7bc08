"""The start check agrees with the simulator."""

import numpy as np
import pytest
from PIL import Image
from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.run import run

FILE = """\
version: 1
configuration:
- name: a
  start_check: {check}
  parameters:
  - map_file: room.yaml
  - start_pose: {{x: {x_m}, y: 3.0, yaw: {yaw_rad}}}
  - goal_pose: {{x: 4.0, y: 3.0}}
execution: {{timeout: 25}}
"""


@pytest.fixture
def made(tmp_path):
    """The instantiation of a start `x_m` from the wall of a room of 8 m x 6 m."""
    gray = np.zeros((160, 200), dtype=np.uint8)
    gray[20:-20, 20:-20] = 254
    Image.fromarray(gray).save(tmp_path / "room.pgm")
    (tmp_path / "room.yaml").write_text("{image: room.pgm, resolution: 0.05, origin: [-1.0, -1.0, 0.0]}\n")

    def make(check, x_m, yaw_rad):
        (tmp_path / "a.vast").write_text(FILE.format(check=check, x_m=x_m, yaw_rad=yaw_rad))
        return instantiate(load_campaign(tmp_path / "a.vast")).configurations

    return make


@each_row(("x_m", "drives"), [(0.225, False), (0.236, True)])
@each_row("yaw_rad", [0.0, 0.4])
def test_check_and_the_simulator_agree_on_where_a_robot_can_start(made, x_m, yaw_rad, drives):
    (unchecked,) = made("none", x_m, yaw_rad)
    assert (run(unchecked.scenario, 0).run.distance_m > 0.1) is drives
    assert bool(made("footprint", x_m, yaw_rad)) is drives
