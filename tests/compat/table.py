"""A table of what vastflow makes of the files in a folder: campaigns, scenarios, floor plans, variations, Nav2 parameter files.

Campaigns are instantiated and their runs executed in this process and its workers, without Prefect and without a store; a
scenario file alone is executed once in an empty room with values made up for its parameters; a floor plan becomes a map, a
variation two plans. Nothing is written into the folder: its files are copied first.

    python tests/compat/table.py FOLDER [--runs N] [--sample N] [--workers N] [--json]

`--sample N` tries N configurations of a campaign, else all. Exit code 0 whatever the table says.
"""

import argparse
import json
import os
import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

from rows import Row, Trial, rows_of  # beside this script

HEADER = ("file", "kind", "result", "configurations", "runs", "drove 1 m", "median m", "passed", "broken", "why")


def cells(row: Row) -> list[str]:
    """A row in words; what a kind does not have is empty."""
    return [
        *(row.file, row.kind, row.outcome, str(row.configurations or ""), str(row.runs or "")),
        f"{row.drove}/{row.sent}" if row.sent else "",
        "" if row.distance_m is None else f"{row.distance_m:.1f}",
        f"{row.passed}/{row.passed + row.failed}" if row.runs else "",
        *(str(row.broken or ""), row.reason),
    ]


def text(rows: Iterable[Row]) -> str:
    """The table for a page."""
    head, *body = (
        "| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in (HEADER, *map(cells, rows))
    )
    return "\n".join([head, "|---" * len(HEADER) + "|", *body])


def main() -> None:
    """Print the table of a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=lambda given: Path(given).resolve())
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--sample", type=int)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    if not asked.folder.is_dir():
        parser.error(f"{asked.folder}: no such folder")
    with tempfile.TemporaryDirectory(prefix="vastflow-") as aside:
        folder = Path(
            shutil.copytree(asked.folder, Path(aside, asked.folder.name))
        )  # programs and caches may write there
        found = list(rows_of(folder, Trial(asked.runs, asked.sample, asked.workers)))
    print(json.dumps([asdict(row) for row in found], indent=1) if asked.json else text(found))


if __name__ == "__main__":
    main()
