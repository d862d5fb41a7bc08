"""The cache of parsed source files: found by their content and by nothing else."""

import os

import pytest
from table import each_row

from vastflow.tasks.keys import source
from vastflow.tasks.keys.source import SourceTree


@pytest.fixture
def tree(tmp_path):
    """A package whose files are read with a cache; a new tree each time, as in a new process."""
    (tmp_path / "pkg").mkdir()
    (tmp_path / "pkg/__init__.py").write_text("")
    (tmp_path / "pkg/run.py").write_text("from . import kernel\n")
    (tmp_path / "pkg/kernel.py").write_text("k = 1\n")
    return lambda: SourceTree({"pkg": tmp_path / "pkg"}, cache=tmp_path / "cache" / "modules")


@pytest.fixture
def parsed(monkeypatch):
    """The files that are parsed."""
    files = []
    parse = source._module_of
    monkeypatch.setattr(source, "_module_of", lambda *given: files.append(given) or parse(*given))
    return files


def uncached(folder):
    return SourceTree({"pkg": folder / "pkg"}).digest("pkg.run")


def test_edit_that_leaves_size_and_time_as_they_were_is_noticed(tree, tmp_path):
    before = tree().digest("pkg.run")
    file = tmp_path / "pkg/kernel.py"
    stat = file.stat()
    file.write_text("k = 2\n")
    os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    assert (file.stat().st_size, file.stat().st_mtime_ns) == (stat.st_size, stat.st_mtime_ns)
    assert before != tree().digest("pkg.run") == uncached(tmp_path)


def test_moved_file_imports_from_new_folder(tree, tmp_path):
    tree().digest("pkg.run")
    (tmp_path / "pkg/deep").mkdir()
    for file in ("__init__", "run", "kernel"):
        (tmp_path / f"pkg/deep/{file}.py").write_text((tmp_path / f"pkg/{file}.py").read_text())
    assert tuple(tree().code("pkg.deep.run").modules) == ("pkg", "pkg.deep", "pkg.deep.kernel", "pkg.deep.run")


@each_row("damage", [None, b"", b"damaged", b"0" * 64 + b"\n{}", "a changed byte"])
def test_cache_is_used_unless_it_is_damaged(tree, tmp_path, parsed, damage):
    file = tmp_path.parent / "cache/modules"
    before = tree().digest("pkg.run")
    content = bytearray(file.read_bytes())
    content[-20] ^= 1
    if damage is not None:
        file.write_bytes(content if isinstance(damage, str) else damage)
    parsed.clear()
    assert tree().digest("pkg.run") == before
    assert len(parsed) == (0 if damage is None else 3)


def test_cache_that_cannot_be_written_costs_only_time(tree, tmp_path):
    (tmp_path / "cache").write_text("a file, no folder")
    assert tree().digest("pkg.run") == uncached(tmp_path)
