"""What was read of source files is found by their content and by nothing else."""

import os
from pathlib import Path

import pytest

from vastflow.tasks.keys import source
from vastflow.tasks.keys.source import SourceTree


@pytest.fixture
def tree(tmp_path):
    """A package whose files are read with a cache; a new tree each time, as in a new process."""
    (tmp_path / "pkg").mkdir()
    (tmp_path / "pkg/__init__.py").write_text("")
    (tmp_path / "pkg/run.py").write_text("from pkg import kernel\n")
    (tmp_path / "pkg/kernel.py").write_text("k = 1\n")
    return lambda: SourceTree({"pkg": tmp_path / "pkg"}, cache=tmp_path / "cache" / "modules")


@pytest.fixture
def parsed(monkeypatch):
    """Counts the files that are parsed."""
    files = []
    parse = source._module_of
    monkeypatch.setattr(source, "_module_of", lambda *given: files.append(given) or parse(*given))
    return files


def uncached(folder: Path) -> str:
    return SourceTree({"pkg": folder / "pkg"}).digest("pkg.run")


def test_file_that_was_read_by_another_process_is_not_parsed_again(tree, parsed):
    first = tree().digest("pkg.run")
    assert len(parsed) == 3
    assert tree().digest("pkg.run") == first
    assert len(parsed) == 3


def test_edit_that_leaves_size_and_time_as_they_were_is_noticed(tree, tmp_path):
    before = tree().digest("pkg.run")
    file = tmp_path / "pkg/kernel.py"
    stat = file.stat()
    file.write_text("k = 2\n")
    os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    assert (file.stat().st_size, file.stat().st_mtime_ns) == (stat.st_size, stat.st_mtime_ns)
    after = tree().digest("pkg.run")
    assert after != before
    assert after == uncached(tmp_path)


def test_file_that_is_moved_has_what_its_new_place_makes_of_it(tree, tmp_path):
    (tmp_path / "pkg/run.py").write_text("from . import kernel\n")
    tree().digest("pkg.run")
    (tmp_path / "pkg/deep").mkdir()
    (tmp_path / "pkg/deep/__init__.py").write_text("")
    (tmp_path / "pkg/deep/run.py").write_text("from . import kernel\n")
    (tmp_path / "pkg/deep/kernel.py").write_text("k = 3\n")
    assert tuple(tree().code("pkg.deep.run").modules) == ("pkg", "pkg.deep", "pkg.deep.kernel", "pkg.deep.run")


@pytest.mark.parametrize("damage", [b"", b"damaged", b"0" * 64 + b"\n{}"])
def test_damaged_cache_is_read_anew(tree, tmp_path, parsed, damage):
    before = tree().digest("pkg.run")
    (tmp_path / "cache/modules").write_bytes(damage)
    assert tree().digest("pkg.run") == before
    assert len(parsed) == 6


def test_changed_byte_in_the_cache_is_noticed(tree, tmp_path, parsed):
    before = tree().digest("pkg.run")
    file = tmp_path / "cache/modules"
    content = bytearray(file.read_bytes())
    content[-20] ^= 1
    file.write_bytes(content)
    assert tree().digest("pkg.run") == before
    assert len(parsed) == 6


def test_cache_that_can_not_be_written_costs_nothing_but_time(tree, tmp_path):
    (tmp_path / "cache").write_text("a file, no folder")
    assert tree().digest("pkg.run") == uncached(tmp_path)
