"""How kernels are compiled: by fewer passes than numba's own, to the same results, and with nothing left behind."""

import math
import operator
import sys
from types import SimpleNamespace
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core import errors, types, typing
from numba.core.compiler import DefaultPassBuilder
from numba.core.runtime import _nrt_python, rtsys
from numba.extending import overload
from table import each_row

from vastflow.sim.kernels import numeric, target
from vastflow.sim.kernels.pipeline import UNNEEDED

NEEDED = [
    *(
        "TranslateByteCode",
        "FixupArgs",
        "IRProcessing",
        "RewriteSemanticConstants",
        "DeadBranchPrune",
        "GenericRewrites",
    ),
    *("DeadBranchPrune", "ReconstructSSA", "DeadBranchPrune"),
    *("NopythonTypeInference", "PreLowerStripPhis", "InlineOverloads", "NopythonRewrites"),
    *("IRLegalization", "NativeLowering", "NoPythonBackend", "DumpParforDiagnostics"),
]


@pytest.fixture
def compiled(tmp_path, monkeypatch):
    """Compiles into a folder of its own."""
    monkeypatch.setattr(numeric, "_FOLDER", tmp_path / "kernels")
    return numeric.njit


def test_numba_has_the_passes_that_kernels_do_without_and_no_others_than_before():
    flags = SimpleNamespace(no_rewrites=False, enable_ssa=True, auto_parallel=SimpleNamespace(enabled=False))
    passes = DefaultPassBuilder.define_nopython_pipeline(SimpleNamespace(flags=flags, func_ir=None)).passes
    names = [each.__name__ for each, _ in passes]
    assert [name for name in names if name not in UNNEEDED] == NEEDED
    assert set(names) >= UNNEEDED


def closure(x):
    def plus(y):
        return x + y

    return plus(1.0)


def loop_over_two_types(x):
    total = 0.0
    for each in numba.literal_unroll((1, 2.5)):
        total += each * x
    return total


def python_within(x):
    with numba.objmode(y="float64"):
        y = x * 2
    return y


def error_with_a_value(x):
    if x < 100.0:
        raise ValueError(x)
    return x


@each_row(
    ("function", "why"),
    [
        (closure, "make_function"),
        (loop_over_two_types, r"getiter with parameters \(Tuple\(int64, float64\)\)"),
        (python_within, "enter_with"),
        (error_with_a_value, "Unsupported constraint encountered: raise"),
    ],
)
def test_a_kernel_that_needs_one_of_those_passes_does_not_compile(compiled, function, why):
    with pytest.raises(errors.NumbaError, match=why):
        compiled(function)(1.5)


def test_an_expression_of_arrays_is_computed_in_one_loop_as_numpy_does(compiled):
    values = np.linspace(-1.0, 1.0, 9)
    assert compiled(lambda a: (a * 2.0 + np.abs(a))[3])(values) == (values * 2.0 + abs(values))[3]


def test_a_part_that_is_called_with_either_flag_is_compiled_for_each(compiled):
    @numeric.inner
    def either(x, doubled):
        return 2.0 * x if doubled else x

    assert compiled(lambda x: either(x, True) - either(x, False))(1.5) == 1.5
    assert len(either.overloads) == 2


def test_a_part_that_is_called_with_several_whole_numbers_is_compiled_once(compiled):
    @numeric.inner
    def plus(x, number):
        return x + number

    assert compiled(lambda x: plus(x, 1) + plus(x, 2) + plus(x, 3))(0.5) == 7.5
    assert len(plus.overloads) == 1


@pytest.fixture
def allocations():
    """How many arrays kernels have made and freed."""
    _nrt_python.memsys_enable_stats()
    yield lambda: np.array(rtsys.get_allocation_stats()[:2])
    _nrt_python.memsys_disable_stats()


class Scan(NamedTuple):
    ranges: Any
    weights: Any
    count: int


def is_counting(part):
    """Whether a part, of types that it has been called with, counts references."""
    (compiled_part,) = part.overloads.values()
    return "NRT_incref" in compiled_part.library.get_llvm_str()


def tuple_of_views(a, b):
    return a[1:], b


def named_tuple(a, b):
    return Scan(a, b[2:], 1)


def view(a, b):
    return a[::2] if a[0] < b[0] else b[::2]


def argument(a, b):
    return b


def fresh_array(a, b):
    a = a + b
    return a


def masked(a, b):
    chosen = a[a > 0.5]
    return chosen.sum() + b[0]


def at_indices(a, b):
    return a[np.array([1, 0])][0] + b[0]


def sorted_copy(a, b):
    order = np.argsort(a)
    return a[order[0]] + b[order[1]]


def reversed_in_place(a, b):
    c = a.copy()
    c[1:] = c[:-1]
    return c[1] + b[0]


def rows(a, b):
    total = 0.0
    for row in np.stack((a, b)):
        total += row[1]
    return total


def kept_in_a_list(a, b):
    kept = [a, b]
    kept[0] = b
    return kept[0][0]


def copies(result):
    return [np.copy(each) for each in (result if isinstance(result, tuple) else (result,))]


@each_row(
    "function",
    [
        *(tuple_of_views, named_tuple, view, argument, fresh_array, masked),
        *(at_indices, sorted_copy, reversed_in_place, rows, kept_in_a_list),
    ],
)
def test_a_part_that_makes_or_returns_arrays_counts_references_so_that_each_is_freed_after_its_last_use(
    compiled, allocations, function
):
    part = numeric.inner(function)

    @compiled
    def last_of_100(values):
        out = part(values, values + 1.0)
        for k in range(100):
            out = part(values + k, values)  # what came before, and all that only it holds, is free now
        return out

    values = np.array([0.0, 1.0, 0.25, 2.0])
    expected = copies(function(values + 99, values))
    last_of_100(values)
    holders, before = sys.getrefcount(values), allocations()
    found = copies(last_of_100(values))
    made, freed = allocations() - before
    for got, right in zip(found, expected, strict=True):
        np.testing.assert_array_equal(got, right)
    assert is_counting(part)
    assert made == freed >= 100
    assert sys.getrefcount(values) == holders


def sum_of_tail(a, b):
    tail = a[2:]
    return tail[0] + tail[1] + b[0]


def of_tuples(a, b):
    scan, (c, _) = Scan(1.0, 2.0, 3), (a, b)
    pair = (c, b)
    return pair[0][1] + pair[1][0] + scan.count


def swapped(a, b):
    for _ in range(3):
        a, b = b, a
    return a[0] - b[1]


def written(a, b):
    a[1] = b[0] + 1.0
    return a[1]


@each_row("function", [sum_of_tail, of_tuples, swapped, written])
def test_a_part_that_only_looks_at_arrays_or_writes_numbers_to_them_counts_nothing(compiled, allocations, function):
    part = numeric.inner(function)

    @compiled
    def total(values):
        found = 0.0
        for k in range(100):
            found += part(values + k, values * 2.0)
        return found

    values = np.array([0.0, 1.0, 0.25, 2.0])
    expected = sum(function(values + k, values * 2.0) for k in range(100))
    assert total(values) == expected
    assert not is_counting(part)
    before = allocations()
    assert total(values) == expected
    made, freed = allocations() - before
    assert made == freed >= 200


def test_numba_s_errors_are_plain_while_a_kernel_is_compiled_and_as_before_afterwards():
    before = errors.termcolor()
    with target._plain_errors():
        assert str(errors.NumbaError("no such type")) == "no such type"
    assert errors.termcolor() is before
    with pytest.raises(errors.NumbaError, match="of a part"), target._plain_errors():
        raise errors.NumbaError("of a part")
    assert errors.termcolor() is before


def test_an_operator_s_result_is_remembered_for_its_types(compiled):
    context = numeric.njit(lambda: 0).targetdescr.typing_context
    multiplied = context.resolve_value_type(operator.mul)
    assert multiplied is context.resolve_value_type(operator.mul)
    first = multiplied.get_call_type(context, (types.float64, types.int64), {})
    assert first.return_type == types.float64
    assert multiplied.get_call_type(context, (types.float64, types.int64), {}) is first
    assert multiplied.get_call_type(context, (types.int64, types.int64), {}).return_type == types.int64


def test_what_an_extension_adds_to_a_remembered_function_counts_from_then_on(compiled):
    first, second, third, fourth = (eval("lambda z: lgamma(z)", {"lgamma": math.lgamma}) for _ in range(4))
    assert compiled(first)(1.0) == 0.0
    with pytest.raises(errors.TypingError, match="lgamma"):
        compiled(first)(1j)

    @overload(math.lgamma)
    def of_complex_numbers(z):
        return (lambda z: z + 1.0) if isinstance(z, types.Complex) else None

    assert compiled(second)(1j) == 1 + 1j

    @overload(math.lgamma)
    def of_complex_numbers_again(z):
        return (lambda z: z + 2.0) if isinstance(z, types.Complex) else None

    assert compiled(third)(1j) == numba.njit(fourth)(1j)
    assert compiled(fourth)(1.0) == 0.0


def test_numba_has_what_kernels_are_compiled_by_instead():
    ours = {
        target._Library: ["_optimize_functions", "_optimize_final_module", "_finalize_final_module"],
        target._Codegen: ["_function_pass_manager", "_pass_builder", "_customize_tm_options", "set_env"],
        target._Context: ["get_abi_sizeof", "get_executable", "nrt", "enable_nrt"],
        target._Dispatcher: ["get_call_template", "compile"],
        target.TypingContext: ["resolve_value_type", "resolve_function_type", "_lookup_global", "_functions"],
        target._Function: ["get_call_type", "get_impl_key"],
    }
    context = typing.Context()
    for each, names in ours.items():
        (numbas,) = each.__bases__
        assert [name for name in names if not hasattr(context if numbas is typing.Context else numbas, name)] == []
