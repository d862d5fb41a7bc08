"""Places that a command writes to: what is wrong with one ends the command with a sentence."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vastflow.sim.model.faults import UserError


@contextmanager
def writing(place: Path, option: str = "") -> Iterator[None]:
    """Write to `place` in the body.

    Args:
        option: That gave the place, for the message.

    Raises:
        UserError: it can't be written.
    """
    try:
        yield
    except UserError:  # some are OSErrors too
        raise
    except OSError as error:
        wrong = f"{place}: can't be written ({error.strerror}); name another folder"
        raise UserError(f"{option} {wrong}".lstrip()) from None


def check_writable(folder: Path, option: str = "") -> None:
    """Look whether a folder can be made, or written to, before hours are spent.

    Raises:
        UserError: it can't.
    """
    if wrong := _wrong(folder.absolute(), folder.parts):
        raise UserError(f"{option} {folder}: {wrong}".lstrip())


def _wrong(place: Path, parts: tuple[str, ...]) -> str | None:
    right = "name a folder, or one that can be made"
    try:
        while not place.exists():
            if place.is_symlink():
                return f"{place} is a link that leads nowhere; {right}"
            if place.name == "..":
                return f"{place.parent} is not there; {right}"
            place = place.parent
        if any(len(os.fsencode(part)) > os.pathconf(place, "PC_NAME_MAX") for part in parts):
            raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
    except OSError as error:
        return f"{error.strerror}; {right}"
    if not place.is_dir():
        return f"{place} is not a folder; {right}"
    if not os.access(place, os.W_OK | os.X_OK):
        return f"no permission to write in {place}; name a folder of yours"
    return None
