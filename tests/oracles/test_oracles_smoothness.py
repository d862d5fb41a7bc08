"""Smoothness against published values and its own invariances."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.catalog.navigation import spectral_arc_length


def bell(step_s: float = 0.01) -> np.ndarray:
    return np.exp(-5.0 * np.arange(-1.0, 1.0, step_s) ** 2)


def test_bell_shaped_movement_has_the_published_value() -> None:
    # The example of the authors' own implementation gives -1.41403.
    assert spectral_arc_length(bell(), 0.01) == pytest.approx(-1.41403, abs=5e-6)


@given(st.floats(0.01, 100.0))
def test_speed_s_scale_changes_nothing(scale: float) -> None:
    assert spectral_arc_length(scale * bell(), 0.01) == pytest.approx(spectral_arc_length(bell(), 0.01), rel=1e-9)


def test_each_stop_on_the_way_makes_a_motion_less_smooth() -> None:
    movements = [np.concatenate([bell(), np.zeros(50)] * n) for n in (1, 2, 3)]
    values = [spectral_arc_length(movement, 0.01) for movement in movements]
    assert values == sorted(values, reverse=True)  # type: ignore[type-var]
    assert len(set(values)) == 3


@each_row("speed", [[], [0.5], [0.0, 0.0, 0.0]])
def test_robot_that_never_moved_has_no_smoothness(speed: list[float]) -> None:
    assert spectral_arc_length(np.array(speed), 0.1) is None
