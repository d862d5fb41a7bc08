"""Compilation of kernels by a target of our own, and compiled kernels on disk."""

import importlib
import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba import types
from table import each_row

import vastflow
from vastflow.sim.kernels import content, numeric


def double(x):
    return 2 * x


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Compiles kernels into an empty folder; gives the files of kernels there."""
    monkeypatch.setattr(numeric, "_FOLDER", tmp_path / "kernels")
    return lambda suffix: sorted(tmp_path.rglob(f"*{suffix}"))


def used():
    """The kernel as a process that starts now has it."""
    kernel = numeric.njit(double)
    assert kernel(21) == 42
    assert kernel(0.25) == 0.5
    return kernel


def hits(kernel):
    return sum(kernel.stats.cache_hits.values())


def test_compiled_kernel_is_loaded_by_the_next_process(files):
    assert hits(used()) == 0
    assert hits(used()) == 2
    assert len(files(".nbc")) == 2


DAMAGE = {
    "emptied": lambda content: b"",
    "a byte short": lambda content: content[:-1],
    "changed": lambda content: content[:100] + bytes([content[100] ^ 1]) + content[101:],
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_damaged_kernels_are_compiled_again_with_one_line_in_the_log(files, damage, caplog):
    used()
    files(".nbc")[0].write_bytes(damage(files(".nbc")[0].read_bytes()))
    with caplog.at_level(logging.ERROR, "vastflow.kernels"):
        assert hits(used()) == 1
    for file in files(".nbc"):
        file.write_bytes(damage(file.read_bytes()))
    with caplog.at_level(logging.WARNING, "vastflow.kernels"):
        assert hits(used()) == 0
        assert [record.getMessage().partition(": ")[2] for record in caplog.records] == [
            "compiled kernels are damaged (files: 2) and compiled again"
        ]
        caplog.clear()
        assert hits(used()) == 2
    assert caplog.records == []


SCALED = """import math
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from vastflow.plugins import kernel, wrapped

FACTOR, TABLE, OTHER = 3.0, np.array([1.0, 2.0]), SimpleNamespace(gain=1.0)

class Memory(NamedTuple):
    first: float
    second: float

@kernel
def table(x):
    return x * TABLE[1]

def plain(x):
    return x + 1.0

@kernel
def scale(x, memory):
    return math.floor(wrapped(FACTOR) + table(x)) + memory.first
"""


@pytest.fixture
def scaled(files, tmp_path, monkeypatch):
    """Compiles the kernel `scale` of a plug-in as a process that starts now does; whether it was compiled before."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # two texts of one second and one length have one bytecode

    def scaled(old="import", new="import"):
        assert old in SCALED
        (tmp_path / "scaled.py").write_text(SCALED.replace(old, new))
        importlib.invalidate_caches()
        sys.modules.pop("scaled", None)
        module = importlib.import_module("scaled")
        kernel = module.scale
        kernel.compile((types.float64, numba.typeof(module.Memory(1.0, 2.0))))
        assert isinstance(kernel.stats.cache_hits, dict)
        return hits(kernel) == 1

    return scaled


@each_row(
    ("old", "new", "is_same"),
    [
        ("return x + 1.0", "return x + 2.0", True),  # which it does not call
        ("kernel, wrapped\n", "kernel, wrapped  # a comment\n", True),
        ("FACTOR, TABLE, OTHER = 3.0", "FACTOR, TABLE, OTHER = 4.0", False),
        ("[1.0, 2.0]", "[1.0, 3.0]", False),
        ("x * TABLE[1]", "x + TABLE[1]", False),
        ("x * TABLE[1]", "x * TABLE[0]", False),
        ("math.floor(", "math.ceil(", False),
        ("first: float\n    second: float", "second: float\n    first: float", False),
    ],
)
def test_plug_in_kernel_is_loaded_until_its_content_changes(scaled, old, new, is_same):
    text = (old, new)
    scaled()
    assert scaled()
    assert scaled(*text) == is_same
    assert scaled(*text)


def test_plug_in_kernel_with_value_of_unknown_content_is_not_kept(tmp_path):
    names = {"settings": {"gain": 2.0}, "gain": 2.0}
    known, unknown = (eval(f"lambda x: x * {name}", names) for name in ("gain", "settings"))
    assert content.content_of(known) is not None
    assert content.content_of(unknown) is None


def test_built_in_plug_in_may_be_compiled_by_decorator_of_plug_ins(copied):
    before = numeric.kernel_cache_dir()
    for line in (
        "from vastflow.plugins import Planner, kernel",
        "from vastflow.sim.kernels.plug_in import kernel",
        "from vastflow.sim.kernels.plug_in import (\n    kernel,\n)",
    ):
        (copied / "nav2/planners/new.py").write_text(f"{line}\n")
        assert numeric.kernel_cache_dir() != before


def test_kernel_cache_warns_once_when_folder_is_not_writable(files, tmp_path, caplog):
    (tmp_path / "kernels").write_text("no folder")
    with caplog.at_level(logging.WARNING, "vastflow.kernels"):
        used()
        used()
    (line,) = [record.getMessage() for record in caplog.records]
    assert line.startswith(f"can't write to '{tmp_path / 'kernels'}")
    assert line.endswith("(File exists): every process compiles the kernels again")


def test_uncalled_kernel_and_one_without_file_are_not_kept(files, tmp_path):
    numeric.njit(double)
    assert list(tmp_path.iterdir()) == []
    assert numeric.njit(eval("lambda x: 3 * x"))(2) == 6
    assert files(".nbc") == []


USES_KERNELS = """
from vastflow.sim.kernels import numba_target, streams
stream = streams.streams_of([1])[0]
streams.normal_pair(stream)
streams.integer_below(stream, 9)
kernels = [streams.uniform, streams.normal_pair, streams.integer_below]
counts = [sum(sum(getattr(kernel.stats, what).values()) for kernel in kernels) for what in ("cache_hits", "cache_misses")]
print(numba_target.__file__, *counts)
"""


@pytest.mark.slow
def test_second_installation_reuses_compiled_kernels(tmp_path):
    for name, compiles in (("first", True), ("second", False)):
        package = tmp_path / name / "vastflow"
        shutil.copytree(Path(vastflow.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
        environment = {**os.environ, "PYTHONPATH": str(package.parent), "XDG_CACHE_HOME": str(tmp_path / "cache")}
        command = [sys.executable, "-c", USES_KERNELS]
        done = subprocess.run(command, check=True, env=environment, capture_output=True, text=True, timeout=600)
        file, loaded, compiled = done.stdout.split()
        assert Path(file).is_relative_to(package)
        assert (int(loaded) == 0, int(compiled) > 0) == (compiles, compiles)


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """A copy of the simulator's source that the cache folder is computed from."""
    source = Path(numeric.__file__).parents[1]
    shutil.copytree(source, tmp_path / "sim", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(numeric, "__file__", str(tmp_path / "sim" / "kernels" / "numeric.py"))
    return tmp_path / "sim"


@each_row(
    ("module", "line", "is_another"),
    [
        ("world/lidar.py", "X = 1", True),
        ("nav2/parameters/mppi.py", "X = 1", True),  # imported by kernels
        ("nav2/new.py", "", False),
        ("nav2/new.py", "from vastflow.sim.kernels.numeric import inner", True),
        ("run.py", "X = 1", False),
    ],
)
def test_edit_changes_the_folder_of_kernels_that_may_follow_from_it(copied, module, line, is_another):
    before = numeric.kernel_cache_dir()
    with (copied / module).open("a") as file:
        file.write(f"\n{line}\n")
    assert (numeric.kernel_cache_dir() != before) == is_another


def test_equal_source_and_numba_have_one_folder_of_kernels(copied, monkeypatch):
    there = numeric.kernel_cache_dir()
    monkeypatch.undo()
    assert numeric.kernel_cache_dir() == there
    monkeypatch.setattr(numeric.numba, "__version__", "0.0.0")
    assert numeric.kernel_cache_dir() != there


@pytest.mark.slow
def test_kernels_without_checks_are_not_taken_where_indices_are_checked(tmp_path):
    file = tmp_path / "beyond.py"
    file.write_text(
        "import numpy as np\nfrom vastflow.sim.kernels.numeric import njit\n\n"
        "@njit\ndef read(values, index):\n    return values[index]\n\nread(np.zeros(3), 3)\n"
    )
    said = []
    for checked in ("0", "1", "0"):
        environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "NUMBA_BOUNDSCHECK": checked}
        command = [sys.executable, file]
        ended = subprocess.run(command, check=False, env=environment, capture_output=True, text=True, timeout=600)
        said.append(ended.stderr.splitlines()[-1:])
    assert said == [[], ["IndexError: index is out of bounds"], []]


@pytest.mark.usefixtures("files")
def test_expression_of_arrays_is_computed_in_one_loop_as_numpy_does():
    values = np.linspace(-1.0, 1.0, 9)
    assert numeric.njit(lambda a: (a * 2.0 + np.abs(a))[3])(values) == (values * 2.0 + abs(values))[3]


@pytest.mark.usefixtures("files")
def test_part_is_compiled_for_either_flag_and_once_for_all_whole_numbers():
    @numeric.inner
    def either(x, number, doubled):
        return 2.0 * x + number if doubled else x - number

    assert numeric.njit(lambda x: either(x, 1, True) - either(x, 2, False) + either(x, 3, False))(1.5) == 3.0
    assert len(either.overloads) == 2
