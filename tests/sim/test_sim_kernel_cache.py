"""Compilation of kernels by a target of our own, and compiled kernels on disk."""

import importlib
import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from table import each_row

import vastflow
from vastflow.sim.kernels import numeric


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


def test_kernel_is_compiled_again_when_its_file_has_changed(files, tmp_path, monkeypatch):
    file = tmp_path / "tripled.py"
    monkeypatch.syspath_prepend(tmp_path)

    def compiled(text):
        file.write_text(text)
        sys.modules.pop("tripled", None)
        kernel = numeric.njit(importlib.import_module("tripled").triple)
        return kernel(2), hits(kernel)

    text = "def triple(x):\n    return 3 * x\n"
    assert [compiled(text), compiled(f"{text}\nFACTOR = 3\n")] == [(6, 0), (6, 0)]


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
