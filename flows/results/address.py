"""A campaign directory at an address, such as a bucket of S3: uploaded, or copied for reading."""

import json
import os
import re
import shutil
import time
import uuid
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import read_json
from vastflow.tasks.store.artifact import public_address, redacted
from vastflow.tasks.store.store import WRITING_S, Store, StoreError, is_address

if TYPE_CHECKING:
    from vastflow.flows.results.summary import Results


METADATA: Final = "metadata.json"
"""File that makes a folder a campaign directory, and is therefore uploaded last."""


@dataclass(frozen=True, slots=True)
class Delivery:
    """The local folder of a new campaign directory, and its destination; None where it stays there."""

    folder: Path
    address: str | None = None

    def delivered(self, written: "Results") -> "Results":
        """Upload a directory that was written into `folder`, if that is not where it belongs.

        The copy here stays a day, for what shows it to the user.

        Raises:
            StoreError: the address can't be used; the copy stays too.
        """
        if self.address is None:
            return written
        from vastflow.tasks.store.remote_files import file_system

        address = f"{self.address}/{written.directory.name}"
        metadata = written.directory / METADATA
        content = json.loads(metadata.read_text(encoding="utf-8"))
        content["counts"]["results"] = public_address(address)
        metadata.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        files = sorted(path for path in written.directory.rglob("*") if path.is_file() and path != metadata)
        places = [path.relative_to(written.directory).as_posix() for path in files]
        with _using(self.address, f". The campaign directory is in {written.directory}"):
            system, root = file_system(address)
            system.put([str(path) for path in files], [f"{root}/{place}" for place in places])
            system.pipe_file(f"{root}/{METADATA}", metadata.read_bytes())
        return replace(written, summary=replace(written.summary, results=public_address(address)))


def delivery_to(results: str | os.PathLike[str], store: Store) -> Delivery:
    """Return the delivery to a folder or an address; raises `StoreError` if the address can't be written."""
    address = os.fspath(results).rstrip("/")
    if not is_address(address):
        return Delivery(Path(os.fspath(results).removeprefix("file://")))
    from vastflow.tasks.store.remote_files import file_system

    with _using(address):
        system, root = file_system(address)
        probe = f"{root}/.{uuid.uuid4().hex}"
        system.pipe_file(probe, b"vastflow")
        system.rm_file(probe)
    folder = store.local / "results"
    for old in folder.glob("*"):
        with suppress(OSError):
            if time.time() - old.stat().st_mtime > WRITING_S:
                shutil.rmtree(old, ignore_errors=True)
    return Delivery(folder, address)


WITHOUT_RUNS: Final = ("recordings", "traces", "outputs", "logs", "inputs", "environments", "figures")
"""Folders that nobody needs who only reads tables."""


@contextmanager
def at_hand(results: str, leave_out: Collection[str] = ()) -> Iterator[Path]:
    """The folder itself, or a temporary copy of the files at the address.

    Args:
        results: A folder, or the address of one campaign directory such as `s3://bucket/prefix/NAME`.
        leave_out: Names of folders that are not copied.

    Raises:
        StoreError: the address can't be read.
        UnusableDirectory: it is none of a campaign directory.
    """
    if not is_address(results):
        yield Path(results.removeprefix("file://"))
        return
    address = results.rstrip("/")
    with TemporaryDirectory(prefix="vastflow-") as folder:
        copy = Path(folder, address.rpartition("/")[2])
        with _using(address):
            _fetch(address, copy, leave_out)
        yield copy


def _fetch(address: str, copy: Path, leave_out: Collection[str]) -> None:
    from vastflow.tasks.store.remote_files import file_system

    system, root = file_system(address)
    places = [path[len(root) + 1 :] for path in system.find(root)]
    if METADATA not in places:
        found = f"This is not a campaign directory, as it has no {METADATA}. Expected an address that `vastflow run --results` printed."
        if inside := sorted(place.partition("/")[0] for place in places if re.fullmatch(f"[^/]+/{METADATA}", place)):
            found = f"It holds {len(inside)} campaign directories. Name one of them, such as {address}/{inside[-1]}"
        raise UnusableDirectory(redacted(f"{address}: {found}"))
    wanted = [place for place in places if place.partition("/")[0] not in leave_out]
    for parent in {(copy / place).parent for place in wanted}:
        parent.mkdir(parents=True, exist_ok=True)
    system.get([f"{root}/{place}" for place in wanted], [str(copy / place) for place in wanted])


@contextmanager
def _using(address: str, more: str = "") -> Iterator[None]:
    """Report errors of the file system at an address; `more` follows the sentence."""
    from vastflow.tasks.store.remote_files import unusable

    try:
        yield
    except UserError:
        raise
    except Exception as error:  # noqa: BLE001 - a file system may raise anything
        raise StoreError(f"{unusable('results', address, error)}{more}") from None


def meant_address(path: Path) -> str | None:
    """Return the address that lost a slash when it became a path; None for other paths."""
    scheme, colon, rest = str(path).partition(":/")
    found = f"{scheme}://{rest}"
    return found if colon and is_address(found) and not path.exists() else None


def check_directory(results: Path, option: str = "") -> None:
    """Raise `UnusableDirectory` unless a path, given by `option`, is a campaign directory; says where one is."""
    right = "Expected a folder that `vastflow run` wrote."
    if (results / METADATA).is_file():
        return
    if meant_address(results):
        wrong = "Only `vastflow show` and `vastflow export` read an address. Copy it into a folder first."
    elif not results.exists():
        wrong = f"No such folder. {right}"
    elif inside := sorted(results.glob(f"[!.]*/{METADATA}"), key=lambda file: file.stat().st_mtime):
        wrong = f"It holds {len(inside)} campaign directories. Name one of them, the newest is {inside[-1].parent}"
    else:
        wrong = f"This is not a campaign directory, as it has no {METADATA}. {right}"
    raise UnusableDirectory(f"{option} {meant_address(results) or results}: {wrong}".lstrip())


def open_results(directory: str | os.PathLike[str]) -> "Results":
    """Open the directory of a finished campaign; nothing of it is executed.

    Raises:
        UnusableDirectory: it is no campaign directory, or damaged.
    """
    from vastflow.flows.results.summary import Results, summary_of
    from vastflow.tasks.engine.engine import RunFault

    path = Path(directory)
    check_directory(path)
    with reading(path):
        metadata = read_json(path / METADATA)
        faults = tuple(RunFault(**each) for each in metadata["faults"])
        return Results(path, summary_of(metadata["counts"], path), faults, tuple(metadata["notes"]))
