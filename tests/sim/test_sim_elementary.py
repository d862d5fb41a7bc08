"""Elementary functions of vastflow's own: accurate, equal in kernels and in Python, and the only ones on a run's path."""

import ast
import math
from pathlib import Path

import mpmath
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.model import elementary

ROOT = Path(__file__).parents[2]


@njit
def circular(x, y):
    return math.sin(x), math.cos(x), math.tan(x), math.atan2(x, y), math.hypot(x, y)


@njit
def inverse(x):
    return math.asin(x), math.acos(x)


@njit
def exponential(x, y):
    return math.exp(x), math.log(y)


def error_ulp(found, exact):
    """Distance of a number from an exact one, in units of that one's last place."""
    nearest = float(exact)
    return float(abs(mpmath.mpf(found) - exact) / mpmath.mpf(math.ulp(nearest)))


def largest(*pairs):
    with mpmath.workprec(200):
        return max(error_ulp(found, exact(*map(mpmath.mpf, given))) for found, exact, *given in pairs)


angles = st.floats(-1e6, 1e6).filter(lambda x: x == 0.0 or abs(x) > 1e-290)
lengths = st.floats(-1e6, 1e6).filter(lambda x: x == 0.0 or abs(x) > 1e-140)


@given(angles)
@example(-672541.9050393719)
@example(917 * math.pi / 2)
def test_sine_and_cosine_are_right_to_an_ulp_or_little_more(x):
    cosine, sine = elementary.cos_sin(x)
    assert largest((cosine, mpmath.cos, x), (sine, mpmath.sin, x)) < 1.3
    assert largest((elementary.tan(x), mpmath.tan, x)) < 2.5


@given(st.floats(1000001.0, 1e15))
def test_huge_angle_has_the_sine_of_its_rest(x):
    with mpmath.workprec(200):
        exact = mpmath.cos(x), mpmath.sin(x)
    assert elementary.cos_sin(x) == pytest.approx(tuple(map(float, exact)), abs=3e-16 * x)


@given(lengths, lengths)
@example(0.0, -1.0)
def test_angle_and_length_of_vector_are_right_to_an_ulp_or_little_more(y, x):
    if x or y:
        assert largest((elementary.atan2(y, x), mpmath.atan2, y, x)) < 1.5
        assert largest((elementary.hypot(x, y), mpmath.hypot, x, y)) < 1.2


@each_row(
    "y, x, angle",
    [
        *[(0.0, 1.0, "0.0"), (-0.0, 1.0, "-0.0"), (0.0, 0.0, "0.0"), (1.0, 0.0, str(math.pi / 2))],
        *[(0.0, -1.0, str(math.pi)), (-0.0, -1.0, str(-math.pi)), (1.0, 1.0, str(math.pi / 4))],
    ],
)
def test_angle_on_an_axis_has_the_sign_of_its_zero(y, x, angle):
    assert str(elementary.atan2(y, x)) == str(math.atan2(y, x)) == angle


@given(st.floats(-1.0, 1.0).filter(lambda x: x == 0.0 or abs(x) > 1e-290))
def test_inverse_functions_are_right_to_a_few_ulps(x):
    assert largest((elementary.asin(x), mpmath.asin, x), (elementary.acos(x), mpmath.acos, x)) < 2.5


@given(st.floats(-700.0, 709.7), st.floats(1e-300, 1e300))
@example(0.0, 1.0)
def test_exponential_and_logarithm_are_right_to_an_ulp(x, y):
    assert largest((elementary.exp(x), mpmath.exp, x), (elementary.log(y), mpmath.log, y)) < 1.0


def test_ends_of_exponential_and_logarithm():
    assert [elementary.exp(x) for x in (-math.inf, -800.0, 0.0, 800.0)] == [0.0, 0.0, 1.0, math.inf]
    assert [elementary.log(x) for x in (0.0, 1.0, math.inf)] == [-math.inf, 0.0, math.inf]
    assert math.isnan(elementary.exp(math.nan)) and math.isnan(elementary.log(-1.0))


@given(angles, lengths, st.floats(-1.0, 1.0), st.floats(-800.0, 800.0), st.floats(0.0, 1e300))
def test_kernels_have_these_functions_under_the_names_of_math(x, y, share, power, number):
    own = (elementary.sin, elementary.cos, elementary.tan)
    assert circular(x, y) == (*(f(x) for f in own), elementary.atan2(x, y), elementary.hypot(x, y))
    assert inverse(share) == (elementary.asin(share), elementary.acos(share))
    assert exponential(power, number) == (elementary.exp(power), elementary.log(number))


def test_compiled_functions_call_no_library_and_fuse_nothing():
    for kernel in (circular, inverse, exponential):
        kernel(*[0.5] * kernel.py_func.__code__.co_argcount)
        code = "\n".join(kernel.inspect_asm().values())
        assert "vfmadd" not in code
        assert not [name for name in ("sin", "cos", "tan", "atan2", "exp", "log", "hypot") if f"${name}," in code]


@each_row("kind", [np.float32, np.float64])
def test_normal_numbers_are_numpys_but_for_the_last_bit_of_its_tail(kind):
    ours, numpys = np.random.default_rng(7), np.random.default_rng(7)
    found, expected = elementary.normals(ours, (3, 100_000), kind), numpys.standard_normal((3, 100_000), dtype=kind)
    inside = np.abs(expected) < 3.65
    assert np.count_nonzero(~inside) > 50
    assert np.array_equal(found[inside], expected[inside])
    np.testing.assert_array_max_ulp(found, expected, 2, dtype=kind)
    assert ours.bit_generator.state == numpys.bit_generator.state


FOLDERS = ("sim", "oracles/observation", "oracles/judgment", "oracles/catalog", "producers")
NOT_ON_THE_PATH = (
    *("sim/replay.py", "producers/search", "producers/floorplan/mesh.py", "conformance.py"),
    *(
        "sim/nodes/bridge.py",
        "sim/nodes/bridge_messages.py",
        "sim/nodes/bridge_missions.py",
        "sim/nodes/bridge_wheels.py",
    ),
)
"""Modules that draw a run, propose configurations, make a floor plan's solid, test plug-ins, or speak with a user's nodes."""
OURS = {
    **{name: f"elementary.{name}" for name in ("exp", "log", "sin", "cos", "tan", "atan2", "hypot", "dist")},
    **dict.fromkeys(("asin", "acos"), "elementary.asin, acos"),
    **dict.fromkeys(("arctan", "arctan2", "atan"), "elementary.atan2, atan2s"),
    **dict.fromkeys(
        ("log2", "log10", "log1p", "exp2", "expm1", "logaddexp"), "elementary.log, exp; bit_length of a whole number"
    ),
    **dict.fromkeys(("sinh", "cosh", "tanh", "arcsin", "arccos", "cbrt", "erf", "gamma"), "a new one in elementary"),
    **dict.fromkeys(("pow", "power", "float_power"), "a product, or elementary.exp of elementary.log"),
    **dict.fromkeys(("dot", "matmul", "einsum", "linalg", "tensordot", "vdot"), "sums of products, written out"),
    **dict.fromkeys(("partition", "argpartition"), "sort"),
}
METHODS = {
    **dict.fromkeys(("standard_normal", "normal"), "elementary.normals"),
    **dict.fromkeys(("exponential", "gamma", "beta", "lognormal"), "elementary.log of random()"),
    "buffer": "a polygon of points",
    "argsort": 'kind="stable"',
}
WHOLE_NUMBERS = {"producers/catalog/rasterized_path.py", "sim/world/map_file.py"}
"""Modules whose `@` multiplies whole numbers."""
KERNELS = {"njit", "inner", "addressed", "unkept", "kernel"}
EXACT = {
    ("producers/floorplan/variation.py", "normal"): "rounded to documented numbers",
    ("sim/model/elementary.py", "standard_normal"): "mended there",
    ("sim/world/readers/mesh.py", "buffer"): "flat ends and mitered corners have no angles, and its points are rounded",
}


def host_dependent(place, text):
    """Yield line and remedy of what has other last bits on another host."""
    tree = ast.parse(text)
    kernels = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and any(getattr(getattr(each, "func", each), "id", "") in KERNELS for each in node.decorator_list)
    ]
    in_kernels = {id(node) for kernel in kernels for node in ast.walk(kernel)}
    for node in ast.walk(tree):
        in_kernel = id(node) in in_kernels
        if isinstance(node, ast.ImportFrom) and node.module in ("math", "numpy", "cmath"):
            yield node.lineno, f"import {node.module}"
        elif isinstance(node, ast.Attribute) and getattr(node.value, "id", "") in ("math", "np", "cmath"):
            is_ours = in_kernel and node.value.id == "math" and hasattr(elementary, node.attr)
            if node.attr in OURS and not is_ours:
                yield node.lineno, OURS[node.attr]
        if isinstance(node, ast.Call) and getattr(node.func, "attr", "") in METHODS:
            stable = any(keyword.arg == "kind" and keyword.value.value == "stable" for keyword in node.keywords)
            drawn = node.func.attr != "buffer" or getattr(node.func.value, "attr", "") != "stdin"
            if drawn and not stable and (place, node.func.attr) not in EXACT:
                yield node.lineno, METHODS[node.func.attr]
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult) and place not in WHOLE_NUMBERS:
            yield node.lineno, "sums of products, written out"
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            whole = isinstance(node.right, ast.Constant) and isinstance(node.right.value, int)
            if not (isinstance(node.left, ast.Constant) or (in_kernel and whole)):
                yield node.lineno, "a product"


def modules():
    for folder in FOLDERS:
        for file in sorted((ROOT / folder).rglob("*.py")):
            place = file.relative_to(ROOT).as_posix()
            if not any(place.startswith(left) or place.endswith(left) for left in NOT_ON_THE_PATH):
                yield place, file.read_text("utf-8")


def test_modules_of_runs_path_have_no_function_whose_last_bits_depend_on_host():
    found = [f"{place}:{line}: use {ours}" for place, text in modules() for line, ours in host_dependent(place, text)]
    assert found == []


@each_row(
    "text, ours",
    [
        *[("np.exp(x)", "elementary.exp"), ("math.hypot(x, y)", "elementary.hypot"), ("x**2", "a product")],
        *[
            ("a @ b", "sums of products, written out"),
            ("np.argsort(x)", 'kind="stable"'),
            ("rng.normal()", "elementary.normals"),
        ],
        *[
            ("point.buffer(1.0)", "a polygon of points"),
            ("from math import sin", "import math"),
            ("math.sqrt(x)", None),
        ],
        *[("@njit\ndef f(x):\n    return math.exp(x) + x**2", None), ("2.0**-53", None)],
        ("@njit\ndef f(x):\n    return np.exp(x)", "elementary.exp"),
        ("@inner\ndef f(x):\n    return x**0.5", "a product"),
    ],
)
def test_function_that_depends_on_the_host_is_refused_with_the_name_of_ours(text, ours):
    found = [told for _, told in host_dependent("sim/new.py", text)]
    assert found == ([] if ours is None else [ours])


ADD_WHOLE_NUMBERS = {
    "producers/campaign.py": "configurations",
    "producers/campaign_file/containers.py": "keys that are given",
    "producers/catalog/obstacle.py": "obstacles",
    "producers/catalog/one_of.py": "choices",
    "producers/catalog/triggered_obstacle.py": "obstacles",
    "producers/constraints/constraint.py": "letters",
    "producers/constraints/quantities.py": "obstacles",
    "producers/designs/covering_array.py": "combinations",
    "producers/designs/space.py": "items",
    "producers/instantiation/coverage.py": "configurations",
    "producers/instantiation/instantiate.py": "results",
    "producers/places/clearance.py": "obstacles",
    "producers/places/placement.py": "obstacles",
    "producers/places/route.py": "cells",
    "sim/model/archive.py": "bytes",
    "sim/model/files.py": "letters",
    "sim/model/parquet.py": "bytes",
    "sim/nav2/system/system.py": "findings",
    "sim/plug_ins/snapshot.py": "bytes",
    "sim/scenario/language/grammar.py": "letters",
    "sim/scenario/programs/resources.py": "CPU time, which is in no key",
    "sim/scenario/programs/run.py": "CPU time, which is in no key",
    "sim/scenario/tree/state.py": "nodes",
    "sim/world/map_file.py": "at most one number",
}


def test_sum_adds_only_whole_numbers():
    """From Python 3.12 on `sum` of floats has other last bits; `math.fsum` has the same."""
    calls = {
        place
        for place, text in modules()
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "sum"
    }
    assert calls == ADD_WHOLE_NUMBERS.keys()
