"""Compilation of kernels by the target of vastflow's own in numba."""

import numpy as np
import pytest

from vastflow.sim.kernels import numba_target, numeric


@pytest.fixture
def compiled(tmp_path, monkeypatch):
    """Compiles into a folder of its own."""
    monkeypatch.setattr(numeric, "_FOLDER", tmp_path / "kernels")
    return numeric.njit


def test_expression_of_arrays_is_computed_in_one_loop_as_numpy_does(compiled):
    values = np.linspace(-1.0, 1.0, 9)
    assert compiled(lambda a: (a * 2.0 + np.abs(a))[3])(values) == (values * 2.0 + abs(values))[3]


def test_part_that_is_called_with_either_flag_is_compiled_for_each(compiled):
    @numeric.inner
    def either(x, doubled):
        return 2.0 * x if doubled else x

    assert compiled(lambda x: either(x, True) - either(x, False))(1.5) == 1.5
    assert len(either.overloads) == 2


def test_part_that_is_called_with_several_whole_numbers_is_compiled_once(compiled):
    @numeric.inner
    def plus(x, number):
        return x + number

    assert compiled(lambda x: plus(x, 1) + plus(x, 2) + plus(x, 3))(0.5) == 7.5
    assert len(plus.overloads) == 1


def test_numba_has_the_names_that_the_target_overrides():
    ours = {
        numba_target._Library: ["_optimize_final_module", "_finalize_final_module"],
        numba_target._Codegen: ["_pass_builder", "_customize_tm_options", "set_env"],
        numba_target._Context: ["get_executable"],
        numba_target._Dispatcher: ["get_call_template", "compile"],
    }
    for each, names in ours.items():
        (base,) = each.__bases__
        assert [name for name in names if not hasattr(base, name)] == []
