"""Delivery: a campaign directory that is made on this machine and belongs at an address, such as a bucket of S3."""

import json
import os
import shutil
import time
import uuid
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from vastflow.tasks.store import WRITING_S, Store, is_address

if TYPE_CHECKING:
    from vastflow.flows.results.summary import Results

METADATA: Final = "metadata.json"
"""It makes a folder a campaign directory, so it goes last: half a delivery is none."""

_FOLDER: Final = "results"


@dataclass(frozen=True, slots=True)
class Delivery:
    """Where a campaign directory is made, and where it is to be.

    Attributes:
        folder: On this machine.
        address: None where it stays there.
    """

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
        from vastflow.tasks.remote_files import file_system, unusable

        address = f"{self.address}/{written.directory.name}"
        metadata = written.directory / METADATA
        content = json.loads(metadata.read_text(encoding="utf-8"))
        content["counts"]["results"] = address
        metadata.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        files = sorted(path for path in written.directory.rglob("*") if path.is_file() and path != metadata)
        places = [path.relative_to(written.directory).as_posix() for path in files]
        try:
            system, root = file_system(address)
            system.put([str(path) for path in files], [f"{root}/{place}" for place in places])
            system.pipe_file(f"{root}/{METADATA}", metadata.read_bytes())
        except Exception as error:  # noqa: BLE001 - a file system may raise anything
            said = unusable("results", self.address, error)
            said.args = (f"{said}; the campaign directory is in {written.directory}",)
            raise said from None
        return replace(written, summary=replace(written.summary, results=address))


def delivery_to(results: str | os.PathLike[str], store: Store) -> Delivery:
    """How results get to where they are asked for.

    Raises:
        StoreError: it is an address that can't be written.
    """
    address = os.fspath(results).rstrip("/")
    if not is_address(address):
        return Delivery(Path(os.fspath(results).removeprefix("file://")))
    from vastflow.tasks.remote_files import file_system, unusable

    try:
        system, root = file_system(address)
        probe = f"{root}/.{uuid.uuid4().hex}"
        system.pipe_file(probe, b"vastflow")
        system.rm_file(probe)
    except Exception as error:  # noqa: BLE001 - a file system may raise anything
        raise unusable("results", address, error) from None
    folder = store.local / _FOLDER
    for old in folder.glob("*"):
        with suppress(OSError):
            if time.time() - old.stat().st_mtime > WRITING_S:
                shutil.rmtree(old, ignore_errors=True)
    return Delivery(folder, address)
