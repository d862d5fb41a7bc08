"""A campaign directory as a pandas table: one row for each run."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


def frame(directory: Path) -> "pd.DataFrame":
    """One row for each run: factors, what happened, metrics and verdicts, each in a column of its own.

    `passed` is what all oracles say together, `passed.<oracle>` what one does: true, false, or missing where it was not judged. Metrics are
    `<oracle>.<metric> (<unit>)`. A factor whose values are not all numbers is text. Needs nothing but the directory: no
    plug-in of the campaign is loaded.

    Raises:
        OSError, ValueError: no campaign directory, or a damaged one.
    """
    import pandas as pd

    from vastflow.oracles.evidence.wide import TextColumn, wide_table
    from vastflow.oracles.results.tables import read_tables

    found = wide_table(read_tables(directory))
    columns: dict[str, Any] = {}
    for name, column in found.columns.items():
        if isinstance(column, TextColumn):
            columns[name] = pd.Categorical.from_codes(column.codes, list(column.known))
        elif name in found.truths:
            columns[name] = pd.arrays.BooleanArray(column == 1, column < 0)
        else:
            columns[name] = column
    return pd.DataFrame(columns)
