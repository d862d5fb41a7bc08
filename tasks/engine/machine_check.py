"""The machine: checks before any process of a computation is started."""

import errno
import importlib.metadata
import os
import sys
import tempfile
from pathlib import Path
from typing import Final

import platformdirs
from packaging.requirements import Requirement

from vastflow.sim.model.files import is_file
from vastflow.tasks.store.artifact import StoreError

_SHARED_MEMORY: Final = Path("/dev/shm")
"""Folder of Linux' semaphores, with which worker processes wait for each other."""


def check_machine() -> None:
    """Check that all folders that a computation needs besides store and results are writable.

    Raises:
        StoreError: something can't; workers and Prefect's API would fail later, each in its own words.
    """
    check_numba()
    check_folders()
    home = Path(os.environ.get("PREFECT_HOME") or "~/.prefect").expanduser()
    # With an API of the user's, which a profile may name, Prefect writes nothing there.
    if not os.environ.get("PREFECT_API_URL") and not is_file(home / "profiles.toml"):
        _check_written(home, "Set PREFECT_HOME to a folder of yours")
    if sys.platform == "linux":
        if not _SHARED_MEMORY.is_dir():
            raise _error(_SHARED_MEMORY, os.strerror(errno.ENOENT), _MOUNT)
        _check_written(_SHARED_MEMORY, _MOUNT)


def check_folders() -> None:
    """Check that the folders that units write to besides the store are writable.

    Raises:
        StoreError: the cache, or the folder for temporary files, is not.
    """
    _check_written(Path(platformdirs.user_cache_dir("vastflow")), "Set XDG_CACHE_HOME to a folder of yours")
    try:
        temporary = Path(tempfile.gettempdir())
    except FileNotFoundError:  # it has tried them
        raise StoreError("No folder for temporary files can be written. Set TMPDIR to one of yours.") from None
    _check_written(temporary, _TMPDIR)


def check_numba() -> None:
    """Compare numba with the tested versions, as another may break every run minutes later.

    Raises:
        StoreError: it is not one of them.
    """
    asked = map(Requirement, importlib.metadata.requires("vastflow") or ())
    tested = next(each.specifier for each in asked if each.name == "numba")
    found = importlib.metadata.version("numba")
    if not tested.contains(found, prereleases=True):
        raise StoreError(f"numba: Expected a tested version ({tested}), got {found}. Call pip install 'numba{tested}'.")


def check_temporary(error: OSError) -> None:
    """Check whether an error comes from a full folder for temporary files.

    Raises:
        StoreError: it does.
    """
    if error.errno not in (errno.ENOSPC, errno.EDQUOT):
        return
    temporary = tempfile.gettempdir()
    if error.filename and Path(os.path.realpath(error.filename)).is_relative_to(os.path.realpath(temporary)):
        raise _error(Path(temporary), error.strerror or str(error), _TMPDIR)
    _check_written(Path(temporary), _TMPDIR)  # what fails while it is written names no file


_TMPDIR: Final = "Set TMPDIR to a folder of yours"
_MOUNT: Final = "Mount a tmpfs there (a container has one with --shm-size)"


def _check_written(folder: Path, right: str) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"1" * 4096)
    except OSError as error:
        raise _error(folder, error.strerror or str(error), right) from None


def _error(folder: Path, reason: str, right: str) -> StoreError:
    return StoreError(f"can't write to {str(folder)!r} ({reason}). {right}, or make room.")
