"""A campaign directory at hand: a folder of this machine, or a copy of one that lies at an address."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from vastflow.flows.results.delivery import METADATA
from vastflow.oracles.directory.unusable import UnusableDirectory
from vastflow.sim.model.faults import UserError
from vastflow.tasks.store import is_address

WITHOUT_RUNS: Final = ("recordings", "traces", "outputs", "logs", "inputs", "environments", "figures")
"""Folders that nobody needs who only reads tables."""


@contextmanager
def at_hand(results: str, leave_out: Collection[str] = ()) -> Iterator[Path]:
    """The folder itself, or for as long as the body takes a copy of what is at the address.

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
        _fetch(address, copy, leave_out)
        yield copy


def _fetch(address: str, copy: Path, leave_out: Collection[str]) -> None:
    from vastflow.tasks.remote_files import file_system, unusable

    try:
        system, root = file_system(address)
        places = [path[len(root) + 1 :] for path in system.find(root)]
        if METADATA not in places:
            raise UnusableDirectory(_none_there(address, places))
        wanted = [place for place in places if place.partition("/")[0] not in leave_out]
        for parent in {(copy / place).parent for place in wanted}:
            parent.mkdir(parents=True, exist_ok=True)
        system.get([f"{root}/{place}" for place in wanted], [str(copy / place) for place in wanted])
    except UserError:
        raise
    except Exception as error:  # noqa: BLE001 - a file system may raise anything
        raise unusable("results", address, error) from None


def _none_there(address: str, places: Collection[str]) -> str:
    inside = sorted({place.partition("/")[0] for place in places if place.count("/") == 1 and place.endswith(METADATA)})
    if inside:
        return f"{address}: holds {len(inside)} campaign directories; name one of them, such as {address}/{inside[-1]}"
    return (
        f"{address}: not a campaign directory, there is no {METADATA}; an address that `vastflow run --results` printed"
    )


def meant_address(path: Path) -> str | None:
    """The address that a path was meant to be, which has lost a slash of it; None for any other path."""
    scheme, colon, rest = str(path).partition(":/")
    found = f"{scheme}://{rest}"
    return found if colon and is_address(found) and not path.exists() else None


def check_directory(results: Path, option: str = "") -> None:
    """Look whether a path is a campaign directory.

    Args:
        option: That gave the path, for the message, such as `--since`.

    Raises:
        UnusableDirectory: it is none; says where one is.
    """
    if wrong := _wrong(results):
        raise UnusableDirectory(f"{option} {meant_address(results) or results}: {wrong}".lstrip())


def _wrong(results: Path) -> str | None:
    right = "a folder that `vastflow run` wrote"
    if meant_address(results):
        return "only `vastflow show` and `vastflow export` read an address; copy it into a folder first"
    if not results.exists():
        return f"no such folder; {right}"
    if (results / METADATA).is_file():
        return None
    inside = sorted(results.glob(f"[!.]*/{METADATA}"), key=lambda file: file.stat().st_mtime)
    if inside:
        return f"holds {len(inside)} campaign directories; name one of them, the newest is {inside[-1].parent}"
    return f"not a campaign directory, it has no {METADATA}; {right}"
