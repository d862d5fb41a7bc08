"""Drawings: keys of what is drawn, and files that are taken from an earlier one."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from vastflow.oracles.figures.drawing import Drawing


@dataclass(frozen=True)
class Walk:
    xy_m: np.ndarray
    name: str = "a"


def line(walk: Walk) -> Figure:
    figure = Figure()
    figure.add_subplot().plot(*walk.xy_m.T)
    return figure


def dots(walk: Walk) -> Figure:
    return line(walk)


WALK = Walk(np.array([[0.0, 1.0], [2.0, 3.0]]))
OTHERS = {
    "value": (line, replace(WALK, xy_m=WALK.xy_m + 1e-12)),
    "shape": (line, replace(WALK, xy_m=WALK.xy_m.reshape(1, 4))),
    "type": (line, replace(WALK, xy_m=WALK.xy_m.astype(np.int64))),
    "text": (line, replace(WALK, name="b")),
    "function": (dots, WALK),
    "number of arguments": (line, WALK, None),
    "nesting": (line, [WALK]),
}


@pytest.mark.parametrize("other", OTHERS.values(), ids=OTHERS)
def test_drawing_of_other_content_has_other_key(other):
    assert Drawing(line, WALK).key == Drawing(line, replace(WALK, xy_m=WALK.xy_m.copy())).key != Drawing(*other).key


def test_drawing_of_unknown_content_is_never_taken():
    drawing = Drawing(line, object())
    drawing.take(lambda key: {"png": b"another"})
    assert drawing.key == "" and "files" not in vars(drawing)


def test_drawing_is_drawn_once_unless_taken():
    drawing, before = Drawing(line, WALK), {"png": b"kept", "svg": b"kept"}
    assert drawing.files is drawing.files and drawing.files["png"].startswith(b"\x89PNG")
    drawing.take({drawing.key: before}.get)
    assert drawing.files is before
