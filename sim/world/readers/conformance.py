"""Conformance checks of world readers, for authors' tests."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.readers.reader import WorldError, WorldReader
from vastflow.sim.world.readers.registry import read_file

Reader = type[WorldReader]


def check_world_reader(reader: Reader, file: Path) -> None:
    """Run all `CHECKS` on a reader and its file; raise an `AssertionError` or the file's `WorldError` otherwise."""
    for check in CHECKS:
        check(reader, file)


def check_suffixes(reader: Reader, file: Path) -> None:
    """Check that it says the ends of its files' names, in small letters."""
    ends = reader.suffixes
    _must(
        bool(ends) and all(end == end.lower() and end.startswith(".") for end in ends),
        reader,
        "must have suffixes such as .sdf",
    )
    _must(file.name.lower().endswith(ends), reader, f"must read {file.name!r} by its suffix")


def check_bodies(reader: Reader, file: Path) -> None:
    """Check that it gives bodies of finite places and sizes, equal ones each time; or cells."""
    found = read_file(file, reader)
    if isinstance(found, OccupancyMap):
        again = read_file(file, reader)
        _must(
            isinstance(again, OccupancyMap) and again.digest == found.digest, reader, "must give equal cells each time"
        )
        return
    _must(found == read_file(file, reader), reader, "must give equal bodies each time")


def check_files(reader: Reader, file: Path) -> None:
    """Check that it names the files that it reads, the given one first."""
    files = [*reader.files(file)]
    _must(files[:1] == [file] and all(each.is_file() for each in files), reader, f"must name its files, found {files}")


def check_refusal(reader: Reader, file: Path) -> None:
    """Check that it refuses what is no file of its kind by a `WorldError` that names it."""
    with tempfile.TemporaryDirectory() as folder:
        wrong = Path(folder, f"wrong{reader.suffixes[0]}")
        wrong.write_text("\u2603 no world")
        try:
            read_file(wrong, reader)
        except WorldError as error:
            _must(str(wrong) in str(error), reader, f"must name the file in its error, found {error}")
        else:
            raise AssertionError(f"{reader.__name__} must refuse a file of another kind")


CHECKS: Final[tuple[Callable[[Reader, Path], None], ...]] = (check_suffixes, check_bodies, check_files, check_refusal)


def _must(holds: bool, reader: Reader, words: str) -> None:
    if not holds:
        raise AssertionError(f"{reader.__name__} {words}")
