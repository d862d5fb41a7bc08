"""Compiled kernels on disk: used while they are whole, compiled again when they are not."""

import importlib
import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

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
    "truncated": lambda content: content[: len(content) // 2],
    "a byte short": lambda content: content[:-1],
    "changed": lambda content: content[:100] + bytes([content[100] ^ 1]) + content[101:],
    "overwritten": lambda content: b"\0" * len(content),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_damaged_kernels_are_compiled_again_with_one_line_in_the_log(files, damage, caplog):
    used()
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


def test_damaged_kernel_is_compiled_again_alone(files):
    used()
    files(".nbc")[0].write_bytes(b"")
    assert hits(used()) == 1
    assert hits(used()) == 2


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


def test_kernels_that_can_not_be_kept_are_said_once_and_compiled(files, tmp_path, caplog):
    (tmp_path / "kernels").write_text("no folder")
    with caplog.at_level(logging.WARNING, "vastflow.kernels"):
        used()
        used()
    (line,) = [record.getMessage() for record in caplog.records]
    assert line.startswith(f"can't write to '{tmp_path / 'kernels'}")
    assert line.endswith("(File exists): every process compiles the kernels again")


def test_importing_kernels_writes_nothing(files, tmp_path):
    numeric.njit(double)
    assert list(tmp_path.iterdir()) == []


def test_kernel_that_is_in_no_file_is_compiled_and_not_kept(files):
    kernel = numeric.njit(eval("lambda x: 3 * x"))
    assert kernel(2) == 6
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


@pytest.fixture
def installation(tmp_path):
    """Copies the package to a folder of its own; gives what uses kernels there: (their file, loaded, compiled)."""

    def make(name, edit=lambda package: None):
        package = tmp_path / name / "vastflow"
        shutil.copytree(Path(vastflow.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
        edit(package)
        environment = {**os.environ, "PYTHONPATH": str(package.parent), "XDG_CACHE_HOME": str(tmp_path / "cache")}
        command = [sys.executable, "-c", USES_KERNELS]
        done = subprocess.run(command, check=True, env=environment, capture_output=True, text=True, timeout=600)
        file, loaded, compiled = done.stdout.split()
        assert Path(file).is_relative_to(package)
        return int(loaded), int(compiled)

    return make


@pytest.mark.slow
def test_another_installation_of_the_same_version_compiles_nothing(installation):
    assert installation("first") == (0, 3)
    loaded, compiled = installation("second")
    assert loaded > 0 and compiled == 0


@pytest.mark.slow
def test_another_version_of_any_kernel_compiles_its_own(installation):
    def edit(package):
        with (package / "sim/kernels/streams.py").open("a") as file:
            file.write("OTHER = 1\n")

    installation("first")
    assert installation("edited", edit) == (0, 3)
