"""Pictures of a configuration in two campaigns."""

import io

import numpy as np
from PIL import Image

from vastflow.oracles.figures.case_figure import Side, pair_figure
from vastflow.oracles.figures.style import png
from vastflow.oracles.observation.situation import Situation
from vastflow.sim.model.pose import Pose
from vastflow.sim.world.map_file import load_map


def a_side(build, tmp_path, title, said, chosen=0):
    occupancy = load_map(build.write_map(tmp_path / title, build.walled_room(8.0, 6.0)))
    situation = Situation(Pose(1.0, 1.0, 0.0), (Pose(6.0, 4.0, 0.0),), ())
    ways = [(judgement, np.linspace((1.0, 1.0), (6.0, 1.0 + k), 40)) for k, judgement in enumerate(said)]
    return Side(title, occupancy, situation, (), ways, chosen)


def drawn(*sides):
    content = png(pair_figure("c1", sides))
    return content, np.asarray(Image.open(io.BytesIO(content)).convert("RGB")).astype(int)


def colored(pixels, rgb):
    return int((np.abs(pixels - rgb).sum(axis=2) < 30).sum())


def test_both_sides_are_drawn_and_failures_stand_out(build, tmp_path):
    sides = a_side(build, tmp_path, "A", ("pass", "pass")), a_side(build, tmp_path, "B", ("fail", "pass"))
    _, pixels = drawn(*sides)
    left, right = pixels[:, : pixels.shape[1] // 2], pixels[:, pixels.shape[1] // 2 :]
    blue, vermilion = (0, 114, 178), (213, 94, 0)
    assert colored(left, blue) > 200 and colored(right, vermilion) > 200
    assert colored(right[:-90], blue) < colored(left[:-90], blue)


def test_equal_sides_give_equal_bytes(build, tmp_path):
    sides = a_side(build, tmp_path, "A", ("pass",)), a_side(build, tmp_path, "B", ("fail",))
    assert drawn(*sides)[0] == drawn(*sides)[0]


def test_side_without_a_recorded_run_is_an_empty_map(build, tmp_path):
    sides = a_side(build, tmp_path, "A", (), chosen=None), a_side(build, tmp_path, "B", ("not judged",), chosen=None)
    content, _ = drawn(*sides)
    assert content.startswith(b"\x89PNG")
