import shutil
import sys
from pathlib import Path

import pytest
from table import each_row

import vastflow.sim
from vastflow.sim.model.pose import Pose
from vastflow.tasks.keys import source
from vastflow.tasks.keys.source import SourceTree, installed_tree

PROGRAM = """import math

LIMIT = 3


def area(radius_m):
    return math.pi * radius_m**2  # by Archimedes
"""
MODULES = ["pkg.sim", "pkg.sim.late", "pkg.sim.nav", "pkg.sim.nav.kernel", "pkg.sim.run"]


def package(folder):
    """A package in which `run` uses `kernel`, which uses numba; `other` stands alone."""
    (folder / "sim" / "nav").mkdir(parents=True)
    for file, text in {
        "sim/__init__.py": "",
        "sim/nav/__init__.py": "",
        "sim/run.py": "from .nav import kernel\n\ndef run():\n    from pkg.sim.late import late\n    return late\n",
        "sim/nav/kernel.py": PROGRAM + "import numba\n",
        "sim/late.py": "late = 1\n",
        "sim/other.py": "other = 1\n",
    }.items():
        (folder / file).write_text(text)
    return folder


@pytest.fixture
def tree(tmp_path):
    return package(tmp_path)


def code_of(folder):
    return SourceTree({"pkg.sim": folder / "sim"}).code("pkg.sim.run")


def edit(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_code_has_modules_imported_also_relatively_and_inside_functions(tree):
    before = code_of(tree)
    assert sorted(before.modules) == MODULES
    assert set(before.libraries) == {"llvmlite", "numba", "numpy"}
    edit(tree / "sim/nav/kernel.py", "LIMIT = 3", "LIMIT = 4")
    after = code_of(tree)
    assert [name for name in MODULES if after.modules[name] != before.modules[name]] == ["pkg.sim.nav.kernel"]
    with pytest.raises(ModuleNotFoundError, match=r"no module 'pkg\.sim\.missing' in pkg\.sim"):
        SourceTree({"pkg.sim": tree / "sim"}).digest("pkg.sim.missing")


@each_row(
    "file, old, new, is_same",
    [
        ("nav/kernel", "  # by Archimedes", "", True),
        ("nav/kernel", "\n", "\r\n", True),
        ("other", "1", "2", True),
        ("nav/kernel", "LIMIT = 3", "LIMIT = 4", False),
        ("nav/kernel", "import numba", "import scipy", False),
    ],
)
def test_digest_changes_with_code_and_not_with_text(tmp_path, file, old, new, is_same):
    tree = package(tmp_path / "one")
    before = code_of(tree).digest
    shutil.copytree(tree, tmp_path / "copy")
    assert code_of(tmp_path / "copy").digest == before
    edit(tree / "sim" / f"{file}.py", old, new)
    assert (code_of(tree).digest == before) == is_same


@pytest.mark.parametrize(("library", "is_same"), [("llvmlite", False), ("shapely", True)])
def test_version_of_a_used_library_is_in_the_digest(tree, monkeypatch, library, is_same):
    before, real = code_of(tree).digest, source._version
    monkeypatch.setattr(source, "_version", lambda name: "99.0" if name == library else real(name))
    assert (code_of(tree).digest == before) == is_same


def test_plug_in_file_is_followed_into_the_tree(tmp_path, monkeypatch):
    plug_in = _plug_in(tmp_path, "from vastflow.sim.model.pose import Pose\n\nclass Own:\n    k = 1\n", monkeypatch)
    before = installed_tree().plug_in_digest(plug_in)
    assert _copied_sim(tmp_path).plug_in_digest(plug_in) == before
    edit(tmp_path / "copy/sim/model/pose.py", "yaw_rad: float = 0.0", "yaw_rad: float = 0.5")
    assert _copied_sim(tmp_path).plug_in_digest(plug_in) != before


def test_plug_in_digest_covers_code(tmp_path, monkeypatch):
    tree = installed_tree()
    assert tree.plug_in_digest(Pose) == tree.digest("vastflow.sim.model.pose")
    codes = ("1", "1  # the first", "2")
    plug_ins = [_plug_in(tmp_path, f"class Own:\n    k = {code}\n", monkeypatch) for code in codes]
    digests = []
    for plug_in, code in zip(plug_ins, codes, strict=True):
        (tmp_path / "own.py").write_text(f"class Own:\n    k = {code}\n")
        digests.append(installed_tree().plug_in_digest(plug_in))
    assert digests[0] == digests[1] != digests[2]


def _copied_sim(tmp_path):
    if not (tmp_path / "copy").exists():
        shutil.copytree(Path(vastflow.sim.__file__).parent, tmp_path / "copy" / "sim")
    return SourceTree({"vastflow.sim": tmp_path / "copy" / "sim"})


def _plug_in(tmp_path, text, monkeypatch):
    file = tmp_path / "own.py"
    file.write_text(text)
    module = type(sys)(f"plug_in_{abs(hash(text))}")
    module.__file__ = str(file)
    exec(compile(text, file, "exec"), module.__dict__)  # noqa: S102 - as an import does
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return module.Own
