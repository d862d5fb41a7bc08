import shutil
import sys
from pathlib import Path

import pytest

import vastflow.sim
from vastflow.tasks.keys import source
from vastflow.tasks.keys.source import SourceTree, installed_tree

PROGRAM = '''"""A module."""
import math

LIMIT = 3
"""An attribute's docstring."""


def area(radius_m):
    """In square meters."""
    return math.pi * radius_m**2  # by Archimedes
'''


@pytest.fixture
def tree(tmp_path):
    """A package in which `run` uses `kernel`, which uses numba; `other` stands alone."""
    (tmp_path / "sim" / "nav").mkdir(parents=True)
    for file, text in {
        "sim/__init__.py": "",
        "sim/nav/__init__.py": "",
        "sim/run.py": "from pkg.sim.nav import kernel\n\ndef run():\n    from pkg.sim.late import late\n    return late\n",
        "sim/nav/kernel.py": PROGRAM + "import numba\n",
        "sim/late.py": "late = 1\n",
        "sim/other.py": "other = 1\n",
    }.items():
        (tmp_path / file).write_text(text)
    return tmp_path


def digest_of(folder):
    return SourceTree({"pkg.sim": folder / "sim"}).digest("pkg.sim.run")


def edit(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_closure_holds_what_is_imported_also_inside_functions(tree):
    assert SourceTree({"pkg.sim": tree / "sim"}).closure("pkg.sim.run") == (
        "pkg.sim",
        "pkg.sim.late",
        "pkg.sim.nav",
        "pkg.sim.nav.kernel",
        "pkg.sim.run",
    )


def test_code_behind_a_digest_tells_which_module_was_edited(tree):
    before = SourceTree({"pkg.sim": tree / "sim"}).code("pkg.sim.run")
    edit(tree / "sim/nav/kernel.py", "LIMIT = 3", "LIMIT = 4")
    after = SourceTree({"pkg.sim": tree / "sim"}).code("pkg.sim.run")
    assert [name for name in after.modules if after.modules[name] != before.modules[name]] == ["pkg.sim.nav.kernel"]
    assert after.digest == digest_of(tree) != before.digest
    assert set(after.libraries) == {"llvmlite", "numba", "numpy"}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("  # by Archimedes", ""),
        ("  # by Archimedes", "  # by somebody else"),
        ('"""In square meters."""', '"""Square meters,\n\n    of a circle.\n    """'),
        ('"""A module."""', ""),
        ('"""An attribute\'s docstring."""', ""),
        ("\n\n\ndef area", "\n\n\n\n\ndef area"),
        ("math.pi * radius_m**2", "math.pi*radius_m ** 2"),
        ("\n", "\r\n"),
    ],
)
def test_edit_that_changes_no_code_changes_no_digest(tree, old, new):
    before = digest_of(tree)
    edit(tree / "sim/nav/kernel.py", old, new)
    assert digest_of(tree) == before


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("LIMIT = 3", "LIMIT = 4"),
        ("radius_m**2", "radius_m**3"),
        ("    return math", "    radius_m += 1\n    return math"),
        ("import numba", "import scipy"),
    ],
)
def test_edit_of_code_changes_the_digest(tree, old, new):
    before = digest_of(tree)
    edit(tree / "sim/nav/kernel.py", old, new)
    assert digest_of(tree) != before


def test_module_that_is_not_imported_does_not_matter(tree):
    before = digest_of(tree)
    edit(tree / "sim/other.py", "1", "2")
    assert digest_of(tree) == before


def test_copy_elsewhere_has_the_same_digest(tree, tmp_path):
    shutil.copytree(tree / "sim", tmp_path / "copy" / "sim")
    assert digest_of(tmp_path / "copy") == digest_of(tree)


def test_another_version_of_a_numeric_library_changes_the_digest(tree, monkeypatch):
    before = digest_of(tree)
    real = source._version
    monkeypatch.setattr(source, "_version", lambda name: "99.0" if name == "llvmlite" else real(name))
    assert digest_of(tree) != before


def test_another_version_of_a_library_that_is_not_used_changes_nothing(tree, monkeypatch):
    before = digest_of(tree)
    real = source._version
    monkeypatch.setattr(source, "_version", lambda name: "99.0" if name == "shapely" else real(name))
    assert digest_of(tree) == before


def test_relative_imports_are_followed(tmp_path):
    (tmp_path / "sim").mkdir()
    (tmp_path / "sim/__init__.py").touch()
    (tmp_path / "sim/run.py").write_text("from . import kernel\nfrom .late import late\n")
    (tmp_path / "sim/kernel.py").touch()
    (tmp_path / "sim/late.py").touch()
    closure = SourceTree({"sim": tmp_path / "sim"}).closure("sim.run")
    assert closure == ("sim", "sim.kernel", "sim.late", "sim.run")


def test_entry_that_does_not_exist_is_named(tree):
    with pytest.raises(ModuleNotFoundError, match=r"no module 'pkg\.sim\.missing' in pkg\.sim"):
        SourceTree({"pkg.sim": tree / "sim"}).digest("pkg.sim.missing")


def test_plug_ins_file_is_followed_into_the_tree(tmp_path, monkeypatch):
    plug_in = _plug_in(tmp_path, "from vastflow.sim.model.pose import Pose\n\nclass Own:\n    k = 1\n", monkeypatch)
    before = installed_tree().plug_in_digest(plug_in)
    tree = _copied_sim(tmp_path)
    assert tree.plug_in_digest(plug_in) == before
    edit(tmp_path / "copy/sim/model/pose.py", "yaw_rad: float = 0.0", "yaw_rad: float = 0.5")
    assert _copied_sim(tmp_path).plug_in_digest(plug_in) != before


def test_comment_in_a_plug_in_costs_nothing_and_code_does(tmp_path, monkeypatch):
    digests = [
        installed_tree().plug_in_digest(_plug_in(tmp_path, f"class Own:\n    k = {code}\n", monkeypatch))
        for code in ("1", "1  # the first", "2")
    ]
    assert digests[0] == digests[1] != digests[2]


def test_class_of_the_tree_has_its_modules_digest():
    tree = installed_tree()
    from vastflow.sim.model.pose import Pose

    assert tree.plug_in_digest(Pose) == tree.digest("vastflow.sim.model.pose")


def test_simulators_code_is_found_and_reaches_no_other_stage():
    closure = installed_tree().closure("vastflow.sim.run")
    assert "vastflow.sim.model.recording" in closure
    assert all(name.startswith("vastflow.sim") for name in closure)


def test_comment_in_a_kernel_changes_no_key_and_its_code_does(tmp_path):
    before = _copied_sim(tmp_path).digest("vastflow.sim.run")
    kernels = [file for file in (tmp_path / "copy/sim").rglob("*.py") if "@njit" in file.read_text()]
    assert kernels
    for kernel in kernels:
        text = kernel.read_text()
        kernel.write_text(text.replace("@njit", "# compiled\n@njit", 1))
    assert _copied_sim(tmp_path).digest("vastflow.sim.run") == before
    used = SourceTree({"vastflow.sim": tmp_path / "copy/sim"}).closure("vastflow.sim.run")
    names = {
        file: "vastflow.sim." + ".".join(file.relative_to(tmp_path / "copy/sim").with_suffix("").parts)
        for file in kernels
    }
    kernel = next(file for file in kernels if names[file] in used)
    kernel.write_text(kernel.read_text() + "\nLATER = 1\n")
    assert _copied_sim(tmp_path).digest("vastflow.sim.run") != before


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
