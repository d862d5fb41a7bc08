"""Outputs of a run's programs: members of an archive, and plots of their tables."""

import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.archive import MAX_UNPACKED_BYTES, columns_of, members_of
from vastflow.sim.model.faults import Got
from vastflow.sim.model.files import Unreadable, open_file
from vastflow.sim.model.parquet import open_table

MOST_ROWS: Final = 2000
"""Rows of a table that a plot draws, evenly spread over the table."""
MOST_PLOTS: Final = 24
_NUMBERS: Final = "biuf"


@contextmanager
def _archive(directory: Path, configuration: str) -> Iterator[zipfile.ZipFile]:
    with open_file(directory / "outputs" / f"{configuration}.zip") as file, zipfile.ZipFile(file) as archive:
        yield archive


def written_by(directory: Path, configuration: str, run_index: int) -> Mapping[str, Any]:
    """Return `files`, the name and size in bytes of each member of a run, and `plots`, see `plots_of` of frames.

    Raises:
        ValueError, OSError, zipfile.BadZipFile: a damaged archive.
    """
    if not (directory / "outputs" / f"{configuration}.zip").is_file():
        return {"files": [], "plots": []}
    with _archive(directory, configuration) as archive:
        members = members_of(archive)
        own = {f"{kind}/{name}": entry for (run, kind, name), entry in members.items() if run == run_index}
        tables = [name for name in own if name.startswith("tables/")]
        plots = list(
            islice((each for name in tables for each in _plots(name, _content(archive, own[name]))), MOST_PLOTS)
        )
    return {"files": [(name, entry.file_size) for name, entry in own.items()], "plots": plots}


def content_of(directory: Path, configuration: str, run_index: int, name: str) -> bytes | None:
    """Return the content of a run's member by its name, or None; raises as `written_by`."""
    if not (directory / "outputs" / f"{configuration}.zip").is_file():
        return None
    with _archive(directory, configuration) as archive:
        kind, _, path = name.partition("/")
        entry = members_of(archive).get((run_index, kind, path))
        return None if entry is None else _content(archive, entry)


def _content(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    if entry.file_size > MAX_UNPACKED_BYTES:
        raise Unreadable(Got(f"{entry.file_size:,} bytes in {entry.filename}"), f"at most {MAX_UNPACKED_BYTES:,}")
    return archive.read(entry)


def _plots(name: str, content: bytes) -> Iterator[Mapping[str, Any]]:
    """Yield a plot of each column of numbers over the first column, in shares of both ranges."""
    table = open_table(content).read()
    rows = np.unique(np.linspace(0, max(len(table) - 1, 0), MOST_ROWS).astype(np.int64))
    columns = columns_of(table.take(rows[: len(table)]))
    first, *others = ((column, values) for column, values in columns.items() if values.dtype.kind in _NUMBERS)
    if next(iter(columns)) != first[0]:
        return
    over, x = first[0], first[1].astype(np.float64)
    for column, values in others:
        y = values.astype(np.float64)
        known = np.isfinite(x) & np.isfinite(y)
        if not known.any():
            continue
        (left, right), (low, high) = _ends(x[np.isfinite(x)]), _ends(y[known])
        pens = np.where(known & ~np.r_[False, known[:-1]], "M", "L")[known].tolist()
        shares = zip(((x - left) / (right - left))[known], ((y - low) / (high - low))[known], strict=True)
        line = "".join(f"{pen}{to_right:.5g} {-up:.5g}" for pen, (to_right, up) in zip(pens, shares, strict=True))
        title = (
            f"{name.removeprefix('tables/').removesuffix('.parquet')}: {column} over {over} from {left:g} to {right:g}"
        )
        lines = [{"side": 0, "n": 0, "words": "", "column": None, "d": line}]
        yield {"key": "", "title": title, "unit": "", "low": low, "high": high, "drawn": (0, 1), "lines": lines}


def _ends(values: NDArray[np.float64]) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    return low, high if high > low else low + max(abs(low), 1.0)
