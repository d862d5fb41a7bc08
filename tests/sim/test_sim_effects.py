"""Tests of the watch over effects of code that is only looked at."""

import importlib.util
import sys

import pytest

from vastflow.sim.plug_ins.effects import EffectRefused, looking_only, plug_in_code

EFFECTS = {
    "open('new', 'w')": r"write to a file \('new'\)",
    "open('there', 'a')": r"write to a file \('there'\)",
    "import numpy; numpy.savetxt('new', [1.0])": "write to a file",
    "import os; os.remove('there')": r"remove a file \('there'\)",
    "import os; os.rename('there', 'new')": "rename a file",
    "import os; os.makedirs('a/b')": r"make a folder \('a'\)",
    "import shutil; shutil.rmtree('folder')": "remove",
    "import os; os.system('touch new')": "start a program",
    "import subprocess; subprocess.run(['touch', 'new'])": "start a program",
    "import os; os.fork() or os._exit(0)": "start a process",
    "import socket; socket.create_connection(('127.0.0.1', 9))": "open a connection",
    "import tempfile; tempfile.mkdtemp(dir='.')": "make a folder",
    "import sqlite3; sqlite3.connect('new')": "open a database",
}  # fmt: skip
HARMLESS = (
    "open('there').read()",
    "open('/dev/null', 'w').write('x')",
    "import json, numpy, wave; numpy.arange(3).sum()",
    "import sys; sys.stdout.write('')",
)


@pytest.fixture
def imported(tmp_path, monkeypatch):
    """Imports a plug-in of this code, in a folder with a file `there`."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").write_text("kept")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "file").write_text("kept")
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def load(code):
        (tmp_path / "plug_in.py").write_text(code)
        spec = importlib.util.spec_from_file_location("plug_in", tmp_path / "plug_in.py")
        module = importlib.util.module_from_spec(spec)
        with plug_in_code():
            spec.loader.exec_module(module)

    return load


def there(folder):
    return {file: file.read_text() if file.is_file() else None for file in folder.rglob("*")}


@pytest.mark.parametrize("code", EFFECTS)
def test_effects_during_validation_are_refused(imported, tmp_path, code):
    imported("")
    before = {**there(tmp_path), tmp_path / "plug_in.py": code}
    with looking_only(), pytest.raises(EffectRefused, match=f"it would {EFFECTS[code]}.*, and is only looked at"):
        imported(code)
    assert there(tmp_path) == before


def test_harmless_code_and_vastflow_itself_are_not_refused(imported, tmp_path):
    with looking_only():
        for code in HARMLESS:
            imported(code)
        (tmp_path / "own").write_text("x")


def test_executed_code_may_have_effects(imported, tmp_path):
    imported("open('new', 'w').write('x')")
    assert (tmp_path / "new").read_text() == "x"


def test_effects_of_imported_library_are_allowed(imported, tmp_path, monkeypatch):
    library = tmp_path / "site"
    library.mkdir()
    (library / "some_library.py").write_text("open('cache', 'w').write('x')\ndef write(): open('new', 'w')\n")
    monkeypatch.syspath_prepend(library)
    monkeypatch.setattr("vastflow.sim.plug_ins.effects._libraries", lambda: (str(library), "<frozen "))
    with looking_only():
        imported("import some_library")
        assert (tmp_path / "cache").is_file()
        with pytest.raises(EffectRefused, match="write to a file"):
            imported("import some_library; some_library.write()")
    assert not (tmp_path / "new").exists()
