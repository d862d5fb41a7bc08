"""Checks of the machine before anything is started."""

import errno
import pickle
import tempfile
from pathlib import Path

import pytest

from vastflow.tasks.engine import machine_check
from vastflow.tasks.engine.machine_check import check_machine
from vastflow.tasks.engine.work import Broken, answered
from vastflow.tasks.store.store import StoreError


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A machine whose folders are all below `tmp_path`, where `spoiled` makes one of them unusable."""
    folders = {"XDG_CACHE_HOME": "cache", "PREFECT_HOME": "prefect", "TMPDIR": "tmp"}
    for variable, name in folders.items():
        (tmp_path / name).mkdir()
        monkeypatch.setenv(variable, str(tmp_path / name))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", None)
    (tmp_path / "shm").mkdir()
    monkeypatch.setattr(machine_check, "_SHARED_MEMORY", tmp_path / "shm")
    monkeypatch.setattr(machine_check.sys, "platform", "linux")

    def spoiled(name: str) -> Path:
        (tmp_path / name).rmdir()
        (tmp_path / name).symlink_to("/proc/self/fd")  # where nobody may make anything, root neither
        return tmp_path / name

    return spoiled


def test_sound_machine_passes_checks_without_leftovers(machine, tmp_path):
    check_machine()
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.parametrize(("name", "variable"), [("cache", "XDG_CACHE_HOME"), ("prefect", "PREFECT_HOME")])
def test_unwritable_folder_is_named_with_its_variable(machine, name, variable):
    folder = machine(name)
    with pytest.raises(StoreError, match=rf"can't write to '{folder}.* \(.+\)\. Set {variable} to a folder of yours"):
        check_machine()


@pytest.mark.parametrize("how", ["API", "profile"])
def test_prefect_home_is_unused_with_configured_api(machine, tmp_path, monkeypatch, how):
    if how == "API":
        machine("prefect")
        monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:1/api")
    else:
        (tmp_path / "prefect" / "profiles.toml").write_text("")
        monkeypatch.setattr(machine_check, "_check_written", refuse_prefect(machine_check._check_written))
    check_machine()


def refuse_prefect(check):
    def checked(folder, right):
        assert folder.name != "prefect"
        check(folder, right)

    return checked


def test_missing_shared_memory_is_named_with_a_remedy(machine, tmp_path):
    (tmp_path / "shm").rmdir()
    with pytest.raises(StoreError, match=r"shm' \(No such file or directory\)\. Mount a tmpfs there \(a container"):
        check_machine()


def test_missing_temporary_folder_is_named(machine, monkeypatch):
    def none():
        raise FileNotFoundError("No usable temporary directory found")

    monkeypatch.setattr(tempfile, "gettempdir", none)
    with pytest.raises(StoreError, match=r"No folder for temporary files can be written\. Set TMPDIR"):
        check_machine()


def no_room(*name):
    raise OSError(errno.ENOSPC, "No space left on device", *name)


TMPDIR_IS_FULL = r"can't write to '.*tmp' \(.+\)\. Set TMPDIR to a folder of yours, or make room"


def test_full_temporary_folder_ends_the_campaign(machine, tmp_path):
    with pytest.raises(StoreError, match=TMPDIR_IS_FULL) as found:
        answered(no_room, str(tmp_path / "tmp" / "vastflow-run-x"))
    sent = pickle.loads(pickle.dumps(found.value))  # from a worker's process
    assert (type(sent), str(sent)) == (StoreError, str(found.value))


def test_unnamed_full_file_is_attributed_to_a_full_temporary_folder(machine):
    tempfile.gettempdir()  # while it can be written
    machine("tmp")
    with pytest.raises(StoreError, match=r"can't write to '.+' \(.+\)\. Set TMPDIR to a folder of yours"):
        answered(no_room)


def test_full_plug_in_folder_is_a_plug_in_fault(machine, tmp_path):
    assert answered(no_room, str(tmp_path / "elsewhere" / "file")) == Broken(
        f"OSError: [Errno 28] No space left on device: '{tmp_path}/elsewhere/file'"
    )


def test_untested_numba_is_reported_before_anything_is_computed(machine, monkeypatch):
    monkeypatch.setattr(machine_check.importlib.metadata, "version", lambda _: "9.0.0")
    with pytest.raises(
        StoreError, match=r"numba: Expected a tested version \(.*>=0.62.*\), got 9.0.0\. Call pip install"
    ):
        check_machine()
