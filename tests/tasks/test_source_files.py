"""A process that imported other source than that of its keys stores no artifact."""

import os
import pickle
import subprocess
import sys
import time

import pytest

from vastflow.flows.results.current_report import written_by
from vastflow.tasks.keys.source import SourceTree
from vastflow.tasks.store.source_files import source_files
from vastflow.tasks.store.store import StoreError, open_store

CODE = """
import importlib, pickle, sys, time
store = pickle.load(open(sys.argv[1], "rb"))
import vastflow.made_up.one
from vastflow.tasks.store.store import StoreError
for name in sys.argv[3:]:
    print("ready", flush=True)
    sys.stdin.readline()
    if name != "-":
        importlib.import_module(name)
    try:
        store.put(f"observe/ab/{len(sys.argv)}{name}", {"a": b"1"})
        print("stored", flush=True)
    except StoreError as error:
        print(error, flush=True)
"""


@pytest.fixture
def package(tmp_path):
    """A package below `vastflow`, as an installation for editing has them."""
    package = tmp_path / "src" / "vastflow" / "made_up"
    package.mkdir(parents=True)
    for name in ("__init__", "one", "two"):
        (package / f"{name}.py").write_text("VALUE = 1\n")
    return package


@pytest.fixture
def worker(tmp_path, package):
    """Starts a process that imports `one`, and then puts something into the store at each turn."""
    started = []

    def start(*turns):
        store = open_store(tmp_path / "store").for_sources(source_files([package]))
        (tmp_path / "store.pickle").write_bytes(pickle.dumps(store))
        code = f"import vastflow.tasks\nvastflow.__path__ = [*vastflow.__path__, {str(package.parent)!r}]\n{CODE}"
        command = [sys.executable, "-c", code, str(tmp_path / "store.pickle"), "-", *turns]
        started.append(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True))

        def turn(edit=lambda: None):
            assert started[-1].stdout.readline() == "ready\n"
            edit()
            started[-1].stdin.write("\n")
            started[-1].stdin.flush()
            return started[-1].stdout.readline().rstrip("\n")

        return turn

    yield start
    for process in started:
        process.kill()
        process.communicate()


def test_process_stores_nothing_after_importing_an_edited_file(worker, package):
    turn = worker("-", "vastflow.made_up.two", "-")
    assert turn() == "stored"
    said = turn(lambda: (package / "two.py").write_text("VALUE = 2\n"))
    assert said.startswith(
        f"store: {package / 'two.py'} changed while the campaign ran, so nothing more of it is kept. "
    )
    assert turn() == said


def test_edit_after_import_is_ignored(worker, package):
    turn = worker("-", "vastflow.made_up.two")
    assert turn() == "stored"
    assert turn(lambda: (package / "one.py").write_text("VALUE = 2\n")) == "stored"


def test_file_that_was_only_touched_is_the_same(worker, package):
    turn = worker("vastflow.made_up.two")
    assert turn(lambda: os.utime(package / "two.py", ns=(1, 1))) == "stored"


def test_new_module_is_in_no_key(worker, package):
    turn = worker("vastflow.made_up.new")
    assert "new.py changed while the campaign ran" in turn(lambda: (package / "new.py").write_text("VALUE = 2\n"))


def last_year(*files):
    for file in files:
        os.utime(file, (time.time() - 365 * 24 * 3600,) * 2)


def test_process_older_than_source_stores_no_report(tmp_path, package):
    source_files([package]).check()
    with pytest.raises(StoreError, match="changed while the campaign ran"):
        source_files([package]).check_since_start()
    last_year(*package.glob("*.py"))
    source_files([package]).check_since_start()


@pytest.mark.parametrize("name", ["tables.py", "report.html.j2", "report.css", "report.js"])
def test_process_older_than_report_code_stores_no_report(tmp_path, package, name):
    last_year(*package.glob("*.py"))
    (tmp_path / "page").mkdir()
    (tmp_path / "page" / name).write_text("edited")
    (tmp_path / "page" / "tables.pyc").write_text("compiled meanwhile")
    with pytest.raises(StoreError, match=f"{name} changed while the campaign ran"):
        source_files([package]).check_since_start([tmp_path])
    last_year(tmp_path / "page" / name)
    source_files([package]).check_since_start([tmp_path])


def test_writers_of_tables_and_pages_are_checked():
    assert {"results.py", "campaign_file.py", "report.html.j2"} <= {
        file.name for folder in written_by() for file in folder.rglob("*")
    }


def test_files_of_a_tree_are_all_of_its_packages(package):
    assert SourceTree({"vastflow.made_up": package}).files() == source_files([package])
