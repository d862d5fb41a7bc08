"""Tables of the terminal, all of one form."""

from collections.abc import Iterable, Sequence

from rich.console import Console, RenderableType
from rich.table import Table


def terminal_table(
    names: Sequence[str] = (),
    numbers: Sequence[str] = (),
    words: Sequence[str] = (),
    rows: Iterable[Sequence[str]] = (),
) -> Table:
    """Return a table without lines, and without header if no column is named; `names` and `words` are columns of text."""
    table = Table(
        box=None, show_header=bool(names or numbers), header_style="bold", padding=(0, 2, 0, 0), pad_edge=False
    )
    for name in names:
        table.add_column(name, overflow="fold")
    for name in numbers:
        table.add_column(name, justify="right", no_wrap=True)
    for name in words:
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def printed(lines: Iterable[RenderableType]) -> None:
    """Print lines and tables on stdout, each row on one line unless it is a terminal."""
    console = Console(markup=False, highlight=False)
    if not console.is_terminal:
        console = Console(markup=False, highlight=False, width=200)
    for line in lines:
        console.print(line)
