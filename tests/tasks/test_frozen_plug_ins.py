"""A plug-in runs as it was when its key was made, with all that it uses beside it."""

import json
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vastflow.oracles.judgment.registry import OracleError, oracle_of
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import NoReference, Trace
from vastflow.producers.model.producer import draws_of, evaluate, find_producer
from vastflow.sim.model.recording import Run
from vastflow.sim.plug_ins.effects import watched
from vastflow.sim.plug_ins.loading import snapshot_behind
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.tasks.engine.evaluation import packed
from vastflow.tasks.keys.source import installed_tree

ORACLE = """
from vastflow.oracles.judgment.oracle import Oracle, Parameters
{top}

class Limited(Oracle[Parameters]):
    Parameters = Parameters
    metrics = {{"limit": "1"}}
{declared}
    def judge(self, trace, situation):
        return self.passed(trace, limit=float({limit}))
"""

PRODUCER = """
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Parameters, Producer
from helper import LIMIT

class Own(Producer[Parameters]):
    Parameters = Parameters
    reads = ()
    writes = {"scan_noise_std": "system"}

    def produce(self, inputs, draws):
        yield Fragment({"scan_noise_std": LIMIT / 100})
"""

TRACE = Trace(Run(0, "", "succeeded", 0, "", 1.0, 0.0, 0, 0), {"t_s": np.zeros(1)}, NoReference("none is needed"))


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A campaign's folder; nothing of it can be imported by itself."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    home = tmp_path / "campaign"
    home.mkdir()
    return home


def write(home, top="", limit="1", declared="", name="own.py"):
    declared = f"    files = {declared}\n" if declared else ""
    (home / name).write_text(ORACLE.format(top=top, limit=limit, declared=declared))


def oracle(home):
    return oracle_of("own.py:Limited", {}, home)


def said(judge):
    with watched(snapshot_behind(type(judge))):
        (verdict,) = judge.judge_all([TRACE], Situation(None, (), ()))
    return verdict.metrics["limit"].value


def key(judge):
    return installed_tree().plug_in_digest(type(judge))


HELPERS = {
    "a module": ("from helper import LIMIT", "LIMIT", "helper.py"),
    "a module under another name": ("import helper as h", "h.LIMIT", "helper.py"),
    "a relative import": ("from .helper import LIMIT", "LIMIT", "helper.py"),
    "all of a module": ("from helper import *", "LIMIT", "helper.py"),
    "a package": ("from lib import LIMIT", "LIMIT", "lib/__init__.py"),
    "a module of a package": ("from lib.limits import LIMIT", "LIMIT", "lib/limits.py"),
    "a package as a name": ("import lib.limits", "lib.limits.LIMIT", "lib/limits.py"),
    "a folder": ("from folder import limits", "limits.LIMIT", "folder/limits.py"),
    "a helper of a helper": ("from middle import LIMIT", "LIMIT", "deep.py"),
    "a helper of a helper in a package": ("from lib.middle import LIMIT", "LIMIT", "lib/deep.py"),
    "inside of a function": ("def limit():\n    from helper import LIMIT\n    return LIMIT", "limit()", "helper.py"),
    "by its name": ('LIMIT = __import__("helper").LIMIT', "LIMIT", "helper.py"),
}


@pytest.fixture(params=HELPERS.values(), ids=HELPERS.keys())
def helped(request, home):
    """An oracle that reads its limit, 1, from a file beside it."""
    top, limit, name = request.param
    for file, text in {
        "lib/__init__.py": "",
        "lib/middle.py": "from .deep import LIMIT\n",
        "middle.py": "from deep import LIMIT\n",
        name: "LIMIT = 1\n",
    }.items():
        (home / file).parent.mkdir(exist_ok=True)
        (home / file).write_text(text)
    write(home, top, limit)
    return home / name


def test_edited_helper_changes_key_and_verdict(home, helped):
    before = oracle(home)
    key_before = key(before)
    helped.write_text("LIMIT = 5\n")
    after = oracle(home)
    assert (said(before), said(after)) == (1.0, 5.0)
    assert key(after) != key_before == key(before)


def test_comment_in_a_helper_changes_no_key(home, helped):
    before = key(oracle(home))
    helped.write_text('"""A helper."""\nLIMIT = 1  # one\n')
    assert key(oracle(home)) == before


@pytest.mark.parametrize(
    "helped", [HELPERS["a module"], HELPERS["a helper of a helper in a package"], HELPERS["a folder"]], indirect=True
)
def test_snapshot_survives_later_edits_in_other_process(home, helped, tmp_path):
    judge = oracle(home)
    (tmp_path / "oracle").write_bytes(pickle.dumps(judge))
    shutil.rmtree(home)
    code = f"""
import pickle, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
judge = pickle.loads(open({str(tmp_path / "oracle")!r}, "rb").read())
from test_frozen_plug_ins import said
print(said(judge))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout == "1.0\n", done.stderr


def test_plug_ins_may_have_helpers_of_the_same_name(tmp_path):
    for name, limit in (("one", 1), ("two", 2)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "helper.py").write_text(f"LIMIT = {limit}\n")
        write(tmp_path / name, "from helper import LIMIT", "LIMIT")
    assert [said(oracle(tmp_path / name)) for name in ("one", "two", "one")] == [1.0, 2.0, 1.0]


def test_unimported_file_is_in_no_key(home):
    write(home)
    before = key(oracle(home))
    (home / "helper.py").write_text("LIMIT = 1\n")
    assert key(oracle(home)) == before


def test_sibling_folder_does_not_hide_installed_package(home):
    (home / "numpy").mkdir()
    (home / "numpy" / "notes.py").write_text("")
    (home / "vastflow").mkdir()
    (home / "vastflow" / "__init__.py").write_text("raise RuntimeError('not this one')\n")
    write(home, "import numpy", "numpy.float64(3)")
    assert said(oracle(home)) == 3.0


def test_producer_helper_is_in_key_and_snapshot(home):
    (home / "own.py").write_text(PRODUCER)
    (home / "helper.py").write_text("LIMIT = 1\n")
    kind = find_producer("own.py:Own", home)
    producer = kind(kind.Parameters())
    digest = installed_tree().plug_in_digest(kind)
    (home / "helper.py").write_text("LIMIT = 2\n")
    unpacked = packed(producer).unpacked()
    assert evaluate(unpacked, {})[0].values == {"scan_noise_std": 0.01}
    assert draws_of(unpacked, {})(0).random() == draws_of(producer, {})(0).random()
    assert installed_tree().plug_in_digest(find_producer("own.py:Own", home)) != digest


def test_producer_in_a_folder_reads_no_file_of_the_campaign_unnoticed(home):
    (home / "limits.txt").write_text("1")
    (home / "sub").mkdir()
    (home / "sub" / "own.py").write_text(f"LIMIT = open({str(home / 'limits.txt')!r}).read()\n{PRODUCER}")
    with pytest.raises(PlugInError, match=r"own.py reads '../limits.txt', which it does not declare"):
        find_producer("sub/own.py:Own", home)


READS = {
    "open": ("", "open({path}).read()"),
    "json": ("import json", "json.load(open({path}))"),
    "pathlib": ("from pathlib import Path", "Path({path}).read_text()"),
    "numpy": ("import numpy", "numpy.loadtxt({path})"),
    "os": ("import os", "os.read(os.open({path}, os.O_RDONLY), 9)"),
    "io": ("import io", "io.open({path}, 'rb').read()"),
}
BESIDE = '__import__("pathlib").Path(__file__).parent / "limit.json"'


@pytest.mark.parametrize(("top", "read"), READS.values(), ids=READS.keys())
def test_declared_data_is_read_from_the_snapshot_and_is_in_the_key(home, top, read):
    (home / "limit.json").write_text("1")
    write(home, top, read.format(path=BESIDE), declared='["limit.json"]')
    before = oracle(home)
    key_before = key(before)
    (home / "limit.json").write_text("7")
    after = oracle(home)
    assert (said(before), said(after)) == (1.0, 7.0)
    assert key(after) != key_before == key(before)


@pytest.mark.parametrize(("top", "read"), READS.values(), ids=READS.keys())
@pytest.mark.parametrize("place", ["beside", "absolute"])
def test_undeclared_data_is_a_fault_that_names_the_line_to_add(home, top, read, place):
    (home / "limit.json").write_text("1")
    path = BESIDE if place == "beside" else repr(str(home / "limit.json"))
    write(home, top, read.format(path=path))
    right = r"own\.py reads 'limit\.json', which it does not declare.*Add the line files = \[\"limit\.json\"\] to the plug-in's class"
    with pytest.raises(PlugInError, match=right):
        said(oracle(home))


def test_read_while_the_file_is_imported_is_a_fault_of_the_request(home):
    (home / "limit.json").write_text("1")
    write(home, f"LIMIT = open({BESIDE}).read()", "LIMIT")
    with pytest.raises(OracleError, match=r"reads 'limit\.json', which it does not declare"):
        oracle(home)


def test_plug_in_that_swallows_error_is_a_fault(home):
    (home / "limit.json").write_text("1")
    top = f"def limit():\n    try:\n        return open({BESIDE}).read()\n    except Exception:\n        return 9"
    write(home, top, "limit()")
    with pytest.raises(PlugInError, match=r"Add the line files = \[\"limit\.json\"\]"):
        said(oracle(home))


def test_reading_declared_data_outside_snapshot_is_a_fault(home, monkeypatch):
    (home / "limit.json").write_text("1")
    monkeypatch.chdir(home)
    write(home, "", 'open("limit.json").read()', declared='["limit.json"]')
    with pytest.raises(PlugInError, match=r"relative to the working directory.*Read the copy beside the plug-in: Path"):
        said(oracle(home))


def test_guard_ignores_foreign_and_written_files(home, tmp_path):
    (tmp_path / "elsewhere").write_text("3")
    write(home, "", f'open({str(tmp_path / "elsewhere")!r}).read() + "0" * open({str(home / "log")!r}, "w").write("")')
    assert said(oracle(home)) == 3.0


@pytest.mark.parametrize(
    ("declared", "read"),
    [
        ('["data"]', "data/b/limit.json"),
        ('["data/*/*.json"]', "data/b/limit.json"),
        ('["../limit.json"]', "../limit.json"),
    ],
)
def test_folders_patterns_and_files_above_can_be_declared(home, declared, read):
    for file in ("data/b/limit.json", "../limit.json"):
        (home / file).parent.mkdir(parents=True, exist_ok=True)
        (home / file).write_text("4")
    write(home, "from pathlib import Path", f'Path(__file__).parent.joinpath("{read}").read_text()', declared=declared)
    judge = oracle(home)
    (home / read).unlink()
    assert said(judge) == 4.0


@pytest.mark.parametrize(
    ("declared", "message"),
    [
        ('["absent.json"]', r"own\.py declares 'absent\.json' in files\. There is none beside"),
        ("[name for name in ()]", r"expected names of files, such as files = .*, got files = \[.* in line 8"),
        ('["/etc/passwd"]', r"expected a path relative to the plug-in's folder, got '/etc/passwd' in files"),
    ],
)
def test_wrong_declaration_is_named(home, declared, message):
    write(home, declared=declared)
    with pytest.raises(OracleError, match=message):
        oracle(home)


def test_too_large_plug_in_is_refused_with_the_limit(home):
    with open(home / "large.bin", "wb") as file:
        os.truncate(file.fileno(), 100_000_001)
    write(home, declared='["large.bin"]')
    with pytest.raises(OracleError, match=r"large\.bin.* at most 100,000,000, got 100,000,001"):
        oracle(home)


def test_versions_of_imports_are_in_key(home, monkeypatch):
    from vastflow.tasks.keys import source

    write(home, "import httpx, numpy", "1")
    kind = type(oracle(home))
    code = installed_tree().plug_in_code(kind)
    assert {"httpx", "numpy"} <= set(code.libraries)
    before, real = installed_tree().plug_in_digest(kind), source._version
    monkeypatch.setattr(source, "_version", lambda name: "99.0" if name == "httpx" else real(name))
    assert installed_tree().plug_in_digest(kind) != before


def test_local_module_is_in_key_by_code(home, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "own_tools.py").write_text("LIMIT = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path / "elsewhere"))
    write(home, "from own_tools import LIMIT", "LIMIT")
    before = key(oracle(home))
    (tmp_path / "elsewhere" / "own_tools.py").write_text("LIMIT = 2\n")
    assert key(oracle(home)) != before


def test_damaged_copy_is_recreated(home):
    write(home)
    first = snapshot_behind(type(oracle(home)))
    first.file.write_text("damaged")
    again = oracle(home)
    assert said(again) == 1.0
    assert snapshot_behind(type(again)).file.read_text() == (home / "own.py").read_text()


def test_environment_and_other_programs_are_pointed_at(home):
    write(home, "import os, subprocess\nfrom os import environ as e", 'os.getenv("A") or e["B"] or subprocess.run("c")')
    hidden = snapshot_behind(type(oracle(home))).hidden
    assert [each.name for each in hidden] == ["os.getenv", "os.environ", "subprocess.run"]
    assert {each.line for each in hidden} == {11}


NOTEBOOK = 'verdicts = [{"run_index": i, "judgment": "pass", "limit": LIMIT} for i in runs["run_index"].to_pylist()]'


def notebook(home, *cells):
    (home / "own.ipynb").write_text(
        json.dumps(
            {
                "nbformat": 4,
                "cells": [
                    {"cell_type": "code", "source": text} for text in ['metrics = {"limit": "1"}', *cells, NOTEBOOK]
                ],
            }
        )
    )
    return oracle_of("own.ipynb", {}, home)


def test_notebooks_helpers_and_files_are_frozen_too(home):
    (home / "helper.py").write_text("LIMIT = 1\n")
    (home / "limit.json").write_text("2")
    cells = ["from helper import LIMIT", 'files = ["limit.json"]', 'LIMIT += int(open("limit.json").read())']
    before = notebook(home, *cells)
    key_before = key(before)
    assert snapshot_behind(type(before)).files.keys() == {"own.ipynb", "helper.py", "limit.json"}
    (home / "limit.json").write_text("7")
    assert key(notebook(home, *cells)) != key_before
    (home / "helper.py").write_text("LIMIT = 5\n")
    assert (said(before), said(notebook(home, *cells))) == (3.0, 12.0)


def test_undeclared_file_of_notebook_is_a_fault(home):
    (home / "limit.json").write_text("2")
    with pytest.raises(PlugInError, match=r"Add the line files = \[\"limit\.json\"\] to a code cell"):
        said(notebook(home, 'LIMIT = int(open("limit.json").read())'))


def test_output_or_prose_of_a_notebook_changes_no_key(home):
    before = key(notebook(home, "LIMIT = 1"))
    document = json.loads((home / "own.ipynb").read_text())
    document["cells"][1]["outputs"] = [{"output_type": "stream", "name": "stdout", "text": "1"}]
    document["cells"].append({"cell_type": "markdown", "source": "Prose."})
    (home / "own.ipynb").write_text(json.dumps(document))
    assert key(oracle_of("own.ipynb", {}, home)) == before


def test_copies_use_private_folder(home, tmp_path, monkeypatch):
    write(home)
    (tmp_path / "cache").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    with pytest.raises(OracleError, match=r"can't be written below '.*plug-ins' .*Set XDG_CACHE_HOME to a folder"):
        oracle(home)
