"""The answer to a request that was asked before: given at once while nothing that it follows from has changed, and not otherwise."""

import os
import shutil
import sys
import time
from pathlib import Path

import pytest

import vastflow
from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results import answer as module
from vastflow.flows.results.answer import Basis, keep_answer, kept_answer
from vastflow.flows.results.found import RunFault
from vastflow.flows.results.summary import Results, Summary
from vastflow.oracles.evidence.rates import Counts

PLUG_IN = "from helper import LIMIT\n\n\nclass Own:\n    limit = LIMIT\n"


def same_size_and_time(file: Path, old: str, new: str) -> None:
    """Edit a file so that neither its size nor the time of its last change tells of it."""
    before = file.stat()
    text = file.read_text()
    assert old in text and len(old) == len(new)
    file.write_text(text.replace(old, new))
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A copy of vastflow's package that stands for the one that is installed."""
    copy = tmp_path / "installed" / "vastflow"
    (copy / "sim").mkdir(parents=True)
    (copy / "__init__.py").write_text("")
    (copy / "sim" / "robot.py").write_text("RADIUS_M = 0.175\n")
    monkeypatch.setattr(vastflow, "__path__", [str(copy)])
    return copy


@pytest.fixture
def library(tmp_path, monkeypatch):
    """The metadata of an installed distribution, version 1.0."""
    place = tmp_path / "libraries"
    (place / "fast_math-1.0.dist-info").mkdir(parents=True)
    metadata = place / "fast_math-1.0.dist-info" / "METADATA"
    metadata.write_text("Metadata-Version: 2.1\nName: fast-math\nVersion: 1.0\n")
    monkeypatch.syspath_prepend(str(place))
    return metadata


@pytest.fixture
def folder(tmp_path):
    """A campaign with a map and a plug-in that uses a helper."""
    place = tmp_path / "campaign"
    place.mkdir()
    for name, text in {
        "a.vast": "version: 1\n",
        "map.yaml": "x\n",
        "own.py": PLUG_IN,
        "helper.py": "LIMIT = 1\n",
    }.items():
        (place / name).write_text(text)
    return place


@pytest.fixture
def request_of_it(folder, tmp_path):
    return RunRequest(
        campaign=str(folder / "a.vast"), results=str(tmp_path / "results"), store=str(tmp_path / "store"), runs=2
    )


def basis(folder):
    read = {
        str(folder / name): module._content(str(folder / name))
        for name in ("a.vast", "map.yaml", "own.py", "helper.py")
    }
    return Basis({**read, str(folder / "beside.yaml"): None}, [str(folder / "own.py")], ["fast-math", "numpy"])


def results_in(root):
    directory = root / "a-2026-01-31-120000"
    (directory / "figures").mkdir(parents=True, exist_ok=True)
    (directory / "metadata.json").write_text("{}")
    (directory / "report.html").write_text("<p>7 of 8</p>")
    (directory / "figures" / "rates.png").write_bytes(b"picture")
    summary = Summary(4, 0, 0, 8, 6, 2, 7, 1, 0, 120.5, 9.0, 4.0, str(directory), {"success": Counts(7, 1, 0)})
    return Results(directory, summary, (), ("a.vast:1:1: warning",))


@pytest.fixture
def kept(package, library, folder, request_of_it, tmp_path, monkeypatch):
    """The results that were kept, with all files a while old."""
    later_s = time.time() + 60
    monkeypatch.setattr(module, "_process_s", lambda: later_s)
    results = results_in(tmp_path / "results")
    assert keep_answer(request_of_it, basis(folder), results, later_s)
    return results


def test_the_same_request_is_answered_with_the_same_directory(kept, request_of_it):
    answer = kept_answer(request_of_it)
    assert (answer.directory, answer.notes, answer.faults) == (kept.directory, kept.notes, ())
    assert answer.summary.oracles == kept.summary.oracles
    assert (answer.summary.executed, answer.summary.reused, answer.summary.simulated_s) == (0, 8, 0.0)
    assert (answer.summary.passed, answer.summary.failed, answer.summary.runs) == (7, 1, 8)


def test_it_is_answered_from_another_folder_too(kept, request_of_it, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    request = request_of_it.model_copy(update={"campaign": "campaign/a.vast", "results": "results"})
    assert kept_answer(request).summary.results == f"results/{kept.directory.name}"


@pytest.mark.parametrize(
    "other",
    [{"runs": 3}, {"only": ("a",)}, {"sample": 1}, {"as_v1": True}, {"map_dir": "maps"}, {"workers": 2}, {"pool": "p"}],
    ids=lambda other: next(iter(other)),
)
def test_another_option_is_another_request(kept, request_of_it, other):
    assert kept_answer(request_of_it.model_copy(update=other)) is None


def test_other_results_and_another_store_have_answers_of_their_own(kept, request_of_it, tmp_path):
    for name in ("results", "store"):
        assert kept_answer(request_of_it.model_copy(update={name: str(tmp_path / "elsewhere")})) is None


def test_a_store_that_was_deleted_has_no_answers(kept, request_of_it, tmp_path):
    shutil.rmtree(tmp_path / "store")
    assert kept_answer(request_of_it) is None


def test_a_constant_of_vastflow_that_was_edited_is_noticed_whatever_the_file_s_time_and_size(
    kept, request_of_it, package
):
    same_size_and_time(package / "sim" / "robot.py", "0.175", "0.215")
    assert kept_answer(request_of_it) is None


def test_a_file_that_came_to_vastflow_is_noticed(kept, request_of_it, package):
    (package / "sim" / "extra.py").write_text("")
    assert kept_answer(request_of_it) is None


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [("a.vast", "1", "2"), ("map.yaml", "x", "y"), ("own.py", "Own", "Owl"), ("helper.py", "1", "2")],
)
def test_an_input_that_was_edited_is_noticed_whatever_its_time_and_size(kept, request_of_it, folder, name, old, new):
    same_size_and_time(folder / name, old, new)
    assert kept_answer(request_of_it) is None


def test_an_input_that_is_gone_is_noticed(kept, request_of_it, folder):
    (folder / "map.yaml").unlink()
    assert kept_answer(request_of_it) is None


def test_a_file_that_would_be_read_now_is_noticed(kept, request_of_it, folder):
    (folder / "beside.yaml").write_text("a map where there was none")
    assert kept_answer(request_of_it) is None


def test_a_module_that_a_plug_in_takes_from_beside_it_now_is_noticed(
    package, library, folder, request_of_it, tmp_path, monkeypatch
):
    later_s = time.time() + 60
    monkeypatch.setattr(module, "_process_s", lambda: later_s)
    (folder / "own.py").write_text(f"import fractions_of\n{PLUG_IN}")
    assert keep_answer(request_of_it, basis(folder), results_in(tmp_path / "results"), later_s)
    (folder / "fractions_of.py").write_text("HALF = 0.5\n")
    assert kept_answer(request_of_it) is None


def test_a_link_that_leads_to_another_campaign_is_noticed(kept, request_of_it, folder, tmp_path, monkeypatch):
    link, later_s = tmp_path / "current", time.time() + 60
    link.symlink_to(folder)
    request = request_of_it.model_copy(update={"campaign": str(link / "a.vast")})
    assert keep_answer(request, basis(folder), kept, later_s) and kept_answer(request)
    shutil.copytree(folder, tmp_path / "copy")
    link.unlink()
    link.symlink_to(tmp_path / "copy")
    assert kept_answer(request) is None


def test_another_version_of_a_library_is_noticed(kept, request_of_it, library):
    same_size_and_time(library, "Version: 1.0", "Version: 1.1")
    assert kept_answer(request_of_it) is None


def test_a_library_that_was_installed_is_noticed(kept, request_of_it, library):
    (library.parents[1] / "other-2.0.dist-info").mkdir()
    assert kept_answer(request_of_it) is None


@pytest.mark.parametrize("name", ["NUMBA_OPT", "NPY_DISABLE_CPU_FEATURES", "GLIBC_TUNABLES", "VASTFLOW_OTHER"])
def test_a_variable_that_numbers_follow_from_is_noticed(kept, request_of_it, monkeypatch, name):
    monkeypatch.setenv(name, "1")
    assert kept_answer(request_of_it) is None


def test_another_python_is_noticed(kept, request_of_it, monkeypatch):
    monkeypatch.setattr(sys, "version", "3.99.0")
    assert kept_answer(request_of_it) is None


@pytest.mark.parametrize("settled_s", [0.0, 60.0], ids=["by its times", "by its content"])
def test_a_campaign_directory_that_was_damaged_is_no_answer(
    package, library, folder, request_of_it, tmp_path, monkeypatch, settled_s
):
    monkeypatch.setattr(module, "SETTLED_S", settled_s)
    later_s = time.time() + 120
    monkeypatch.setattr(module, "_process_s", lambda: later_s)
    for damage in (
        lambda directory: (directory / "figures" / "rates.png").unlink(),
        lambda directory: same_size_and_time(directory / "report.html", "7 of 8", "8 of 8"),
        lambda directory: (directory / "metadata.json").write_text(""),
        shutil.rmtree,
    ):
        results = results_in(tmp_path / "results")
        assert keep_answer(request_of_it, basis(folder), results, later_s)
        assert kept_answer(request_of_it) is not None
        damage(results.directory)
        assert kept_answer(request_of_it) is None


def test_a_damaged_record_is_no_answer(kept, request_of_it, tmp_path):
    (record,) = (tmp_path / "store" / "answers").glob("*.json")
    record.write_bytes(record.read_bytes().replace(b"7", b"8"))
    assert kept_answer(request_of_it) is None


def test_what_has_faults_is_not_kept(kept, request_of_it, folder):
    broken = Results(kept.directory, kept.summary, (RunFault("a", 0, "execute", "MemoryError"),), ())
    assert not keep_answer(request_of_it, basis(folder), broken, time.time() + 60)


def test_what_changed_while_it_ran_or_just_before_is_not_kept(
    package, library, folder, request_of_it, tmp_path, monkeypatch
):
    results, now_s = results_in(tmp_path / "results"), time.time()
    monkeypatch.setattr(module, "_process_s", lambda: now_s + 60)
    assert not keep_answer(request_of_it, basis(folder), results, now_s), "the inputs are younger"
    monkeypatch.setattr(module, "_process_s", lambda: now_s)
    assert not keep_answer(request_of_it, basis(folder), results, now_s + 60), "vastflow is younger than its process"
    before = basis(folder)
    (folder / "map.yaml").write_text("y\n")
    monkeypatch.setattr(module, "_process_s", lambda: now_s + 60)
    assert not keep_answer(request_of_it, before, results, now_s + 60), "another map was read"


def test_nothing_is_kept_for_a_store_or_results_at_an_address(kept, request_of_it, folder):
    for name in ("store", "results"):
        request = request_of_it.model_copy(update={name: "s3://bucket/prefix"})
        assert not keep_answer(request, basis(folder), kept, time.time() + 60)
        assert kept_answer(request) is None


def test_a_store_that_can_t_be_written_costs_the_next_run_time_and_no_more(kept, request_of_it, folder, tmp_path):
    (tmp_path / "file").write_text("")
    request = request_of_it.model_copy(update={"store": str(tmp_path / "file" / "store")})
    assert not keep_answer(request, basis(folder), kept, time.time() + 60)
