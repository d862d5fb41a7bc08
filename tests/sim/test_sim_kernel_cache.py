"""Compiled kernels on disk: used while they are whole, compiled again when they are not."""

import logging

import pytest

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


def test_a_compiled_kernel_is_loaded_by_the_next_process(files):
    assert hits(used()) == 0
    assert hits(used()) == 2
    assert len(files(".nbi")) == 1 and len(files(".nbc")) == 2


DAMAGE = {
    "emptied": lambda content: b"",
    "truncated": lambda content: content[: len(content) // 2],
    "a byte short": lambda content: content[:-1],
    "changed": lambda content: content[:100] + bytes([content[100] ^ 1]) + content[101:],
    "overwritten": lambda content: b"\0" * len(content),
}


@pytest.mark.parametrize("suffix", [".nbi", ".nbc", ".nb?"])
@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_damaged_kernels_are_compiled_again_with_one_line_in_the_log(files, suffix, damage, caplog):
    used()
    for file in files(suffix):
        file.write_bytes(damage(file.read_bytes()))
    damaged = len(files(suffix))
    with caplog.at_level(logging.WARNING, "vastflow.kernels"):
        assert hits(used()) == 0
        assert [record.getMessage().partition(": ")[2] for record in caplog.records] == [
            f"compiled kernels are damaged (files: {damaged}) and compiled again"
        ]
        caplog.clear()
        assert hits(used()) == 2
    assert caplog.records == []


def test_a_kernel_that_another_process_removes_is_compiled_again(files):
    used()
    for file in files(".nbc"):
        file.unlink()
    assert hits(used()) == 0
    assert hits(used()) == 2


def test_kernels_that_can_not_be_kept_are_said_once_and_compiled(files, tmp_path, caplog):
    (tmp_path / "kernels").write_text("no folder")
    with caplog.at_level(logging.WARNING, "vastflow.kernels"):
        used()
        used()
    (line,) = [record.getMessage() for record in caplog.records]
    assert line.startswith(f"can't write to '{tmp_path / 'kernels'}")
    assert line.endswith("(Not a directory): every process compiles the kernels again")


def test_importing_kernels_writes_nothing(files, tmp_path):
    numeric.njit(double)
    assert list(tmp_path.iterdir()) == []


def test_a_kernel_that_is_in_no_file_is_compiled_and_not_kept(files):
    kernel = numeric.njit(eval("lambda x: 3 * x"))
    assert kernel(2) == 6
    assert files(".nb?") == []
