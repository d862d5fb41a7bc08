"""The campaign directory as a place: its name, and that it appears whole or not at all."""

import errno
import itertools
import json
import re
import shutil
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final

from vastflow.oracles.results.events import EVENTS
from vastflow.oracles.results.unfinished import PARTIAL, RUNNING, STOP, WRITER, place_of, unfinished, writer, writer_of
from vastflow.sim.model.faults import UserError
from vastflow.tasks.store.store import StoreError

ABANDONED_S: Final = 24 * 3600.0

_OF_THE_DISK: Final = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EFBIG, errno.EACCES, errno.EPERM)
_LONGEST_NAME: Final = 150
"""Characters; file systems have room for 255 bytes, of which time, number and the mark of a half written folder take some."""
_OF_THE_CALL: Final = frozenset({EVENTS, STOP, WRITER})
"""Files of a call that computes a campaign, which are there before anything is written."""


@dataclass(frozen=True, slots=True)
class NewDirectory:
    """A campaign directory: `running` while it is computed, `partial` while it is written, `final` once it is whole."""

    running: Path
    partial: Path
    final: Path

    @property
    def place(self) -> Path:
        """The present path."""
        return place_of(self.final) or self.running

    @contextmanager
    def writing(self) -> Iterator[Path]:
        """A folder for the content of the directory, which is whole when the body ends; nothing stays when it raises.

        Raises:
            UserError: the disk is full or broken, or may not be written, or the folder was deleted meanwhile.
        """
        root = self.final.parent
        with _report_disk_errors(root):
            self._take_over()
        try:
            with _report_disk_errors(root, _OF_THE_DISK):
                yield self.partial
                for name in (WRITER, STOP):
                    (self.partial / name).unlink(missing_ok=True)
                self.partial.rename(self.final)
        except BaseException as error:
            gone = isinstance(error, FileNotFoundError) and not self.partial.exists()
            self._take_back()
            if gone:
                raise UserError(
                    f"results: {str(root)!r} was deleted while it was being written. What was computed is in the "
                    "store, and the same command writes it again."
                ) from None
            raise

    def _take_over(self) -> None:
        try:
            self.running.rename(self.partial)
        except FileNotFoundError:  # deleted while the campaign was computed
            self.partial.mkdir(parents=True)
            _sign(self.partial)

    def _take_back(self) -> None:
        with suppress(OSError):
            for child in self.partial.iterdir():
                if child.is_dir():
                    shutil.rmtree(child, ignore_errors=True)
                elif child.name not in _OF_THE_CALL:
                    child.unlink(missing_ok=True)
            self.partial.rename(self.running)

    def leave(self) -> None:
        """Let it be known that nobody writes it any more, and remove it if nothing is in it."""
        for name in (WRITER, STOP):
            for folder in (self.running, self.partial):
                with suppress(OSError):
                    (folder / name).unlink()
        with suppress(OSError):
            self.running.rmdir()


@contextmanager
def new_directory(root: Path, name: str, created: datetime) -> Iterator[NewDirectory]:
    """A campaign directory `root/<name>-<YYYY-MM-DD-HHMMSS>` that is computed in the body, and written in its `writing`.

    Two that begin in one second get different names (`-2` appended). Without content it leaves no more than its events, in a
    hidden `.<name>.running`; a process killed meanwhile leaves that or a hidden `.<name>.partial`, never half a campaign
    directory. One that was left a day ago is removed first.

    Raises:
        UserError: the disk is full or broken, or may not be written.
    """
    with _report_disk_errors(root):
        root.mkdir(parents=True, exist_ok=True)
        sweep(root)
        directory = _reserved(root, f"{directory_name(name)}-{created:%Y-%m-%d-%H%M%S}")
    try:
        yield directory
    finally:
        directory.leave()


@contextmanager
def _report_disk_errors(root: Path, codes: Collection[int] | None = None) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if isinstance(error, StoreError) or (codes is not None and error.errno not in codes):
            raise
        raise UserError(
            f"results: can't write to {str(root)!r} ({error.strerror}). Make room there or give another folder "
            "with --results. What was computed is in the store."
        ) from None


def directory_name(name: str) -> str:
    """Return `name` as a folder name: `-` for other characters, cut to a limit."""
    return re.sub(r"[^A-Za-z0-9.-]+", "-", name)[:_LONGEST_NAME].strip("-.") or "campaign"


def sweep(root: Path) -> None:
    """Remove what processes that are gone left half written in `root` a day ago or longer."""
    for place in unfinished(root):
        with suppress(OSError):
            written_s = max(path.stat().st_mtime for path in (place, *place.rglob("*")))
            if time.time() - written_s > ABANDONED_S and writer_of(place) is None:
                shutil.rmtree(place, ignore_errors=True)


def left_behind(directory: Path) -> Path | None:
    """Return the folder of a campaign directory that is not whole, or None."""
    if directory.name.startswith(".") and directory.name.endswith((".partial", ".running")):
        return directory if directory.is_dir() else None
    place = place_of(directory)
    return None if place == directory else place


def _reserved(root: Path, name: str) -> NewDirectory:
    for k in itertools.count(1):
        final = root / (name if k == 1 else f"{name}-{k}")
        directory = NewDirectory(root / RUNNING.format(final.name), root / PARTIAL.format(final.name), final)
        try:
            directory.running.mkdir()
        except FileExistsError:
            continue
        # Looked at after the reservation, so that nobody can finish in between.
        if not directory.partial.exists() and not final.exists():
            _sign(directory.running)
            return directory
        with suppress(OSError):  # its owner, who took it back meanwhile
            directory.running.rmdir()
    raise AssertionError("unreachable: itertools.count never ends")


def _sign(place: Path) -> None:
    (place / WRITER).write_text(json.dumps(writer()), encoding="utf-8")
