"""The campaign directory as a place: its name, and that it appears whole or not at all."""

import itertools
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path


@dataclass(frozen=True, slots=True)
class NewDirectory:
    """A campaign directory that is being written.

    Attributes:
        partial: Where to write.
        final: Where everything will be once it is whole.
    """

    partial: Path
    final: Path


@contextmanager
def new_directory(root: Path, name: str, created: datetime) -> Iterator[NewDirectory]:
    """A folder `root/<name>-<YYYY-MM-DD-HHMMSS>` that appears when the body ends, and doesn't when the body raises.

    Two that begin in one second get different names (`-2` appended). A process killed meanwhile leaves
    a hidden `.<name>.partial`, never half a campaign directory.
    """
    root.mkdir(parents=True, exist_ok=True)
    directory = _reserved(root, f"{directory_name(name)}-{created:%Y-%m-%d-%H%M%S}")
    try:
        yield directory
        directory.partial.rename(directory.final)
    except BaseException:
        shutil.rmtree(directory.partial, ignore_errors=True)
        raise


def directory_name(name: str) -> str:
    """`name` as a folder is called: `_` and everything that is trouble in a file name become `-`."""
    return re.sub(r"[^A-Za-z0-9.-]+", "-", name).strip("-.") or "campaign"


def _reserved(root: Path, name: str) -> NewDirectory:
    for k in itertools.count(1):
        final = root / (name if k == 1 else f"{name}-{k}")
        partial = root / f".{final.name}.partial"
        try:
            partial.mkdir()
        except FileExistsError:
            continue
        if not final.exists():  # looked at after the reservation, so that nobody can finish in between
            return NewDirectory(partial, final)
        partial.rmdir()
    raise AssertionError("unreachable: itertools.count never ends")
