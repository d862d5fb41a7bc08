"""What a machine must give a computation: said in one sentence, before anything is started."""

import tempfile
from pathlib import Path

import pytest

from vastflow.tasks import surroundings
from vastflow.tasks.surroundings import SurroundingsError, check_surroundings


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A machine whose folders are all below `tmp_path`, where `spoiled` makes one of them unusable."""
    folders = {"XDG_CACHE_HOME": "cache", "XDG_STATE_HOME": "state", "PREFECT_HOME": "prefect", "TMPDIR": "tmp"}
    for variable, name in folders.items():
        (tmp_path / name).mkdir()
        monkeypatch.setenv(variable, str(tmp_path / name))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", None)
    (tmp_path / "shm").mkdir()
    monkeypatch.setattr(surroundings, "_SHARED_MEMORY", tmp_path / "shm")
    monkeypatch.setattr(surroundings.sys, "platform", "linux")

    def spoiled(name: str) -> Path:
        (tmp_path / name).rmdir()
        (tmp_path / name).symlink_to("/proc/self/fd")  # where nobody may make anything, root neither
        return tmp_path / name

    return spoiled


def test_a_machine_that_gives_everything_passes_and_nothing_is_left(machine, tmp_path):
    check_surroundings()
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.parametrize(
    ("name", "variable"), [("cache", "XDG_CACHE_HOME"), ("state", "XDG_STATE_HOME"), ("prefect", "PREFECT_HOME")]
)
def test_a_folder_that_can_not_be_written_is_named_with_the_variable_that_moves_it(machine, name, variable):
    folder = machine(name)
    with pytest.raises(
        SurroundingsError, match=rf"can't write to '{folder}.* \(.+\); set {variable} to a folder of yours"
    ):
        check_surroundings()


@pytest.mark.parametrize("how", ["API", "profile"])
def test_prefect_s_home_is_not_asked_for_where_an_api_is_configured(machine, tmp_path, monkeypatch, how):
    if how == "API":
        machine("prefect")
        monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:1/api")
    else:
        (tmp_path / "prefect" / "profiles.toml").write_text("")
        monkeypatch.setattr(surroundings, "_check_written", refuse_prefect(surroundings._check_written))
    check_surroundings()


def refuse_prefect(check):
    def checked(folder, right):
        assert folder.name != "prefect"
        check(folder, right)

    return checked


def test_no_shared_memory_is_said_with_what_mounts_it(machine, tmp_path):
    (tmp_path / "shm").rmdir()
    with pytest.raises(
        SurroundingsError, match=r"shm' \(No such file or directory\); mount a tmpfs there; a container"
    ):
        check_surroundings()


def test_no_temporary_folder_is_said(machine, monkeypatch):
    def none():
        raise FileNotFoundError("No usable temporary directory found")

    monkeypatch.setattr(tempfile, "gettempdir", none)
    with pytest.raises(SurroundingsError, match="no folder for temporary files can be written; set TMPDIR"):
        check_surroundings()
