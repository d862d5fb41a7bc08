"""Markdown of lines and tables of the terminal, for job summaries and comments."""

import re
from collections.abc import Iterable, Iterator
from itertools import accumulate
from pathlib import Path
from typing import Final

from rich.console import RenderableType
from rich.table import Table

from vastflow.flows.terminal.ending import writing

MAX_BYTES: Final = 30_000
"""Two of these fit in one comment, whose limit at GitHub is 65,536 characters."""
_MAX_TEXT: Final = 500
_MARKS: Final = {"green": "✅ ", "red": "❌ "}
_MARKUP: Final = re.compile(r"[\\`*_{}\[\]<>#|~&!$^@]|^[!-/:-@]|(?<=\d)[.)](?!\S)")
"""Punctuation that is markup anywhere, at the start of a line, or behind the number of an item."""
_LINKED: Final = re.compile(r"[@#!~$&%](?=\w)|:(?=//)|\bwww(?=\.)|\bGH(?=-\d)", re.IGNORECASE)
"""What GitHub and GitLab turn into mentions, references, and links even where it is escaped."""


def escaped(text: str) -> str:
    """Return one line of Markdown that shows `text` and nothing else: no markup, HTML, link, mention, or GitLab command.

    Lines are joined, and texts of more than 500 characters are cut.
    """
    shown = " ".join("".join(each if each.isprintable() else " " for each in text).split())
    shown = shown if len(shown) <= _MAX_TEXT else f"{shown[:_MAX_TEXT]}…"
    return _MARKUP.sub(r"\\\g<0>", _LINKED.sub("\\g<0>\N{ZERO WIDTH SPACE}", shown))


def markdown_of(lines: Iterable[RenderableType]) -> str:
    """Return Markdown of at most `MAX_BYTES`; its last sentence counts the lines that were cut, if any."""
    rows = [row for line in lines for row in (_rows(line) if isinstance(line, Table) else _paragraph(line))]
    ends = accumulate(len(row.encode()) + 1 for row in rows)
    kept = sum(end <= MAX_BYTES - 100 for end in ends)
    cut = [f"\n{len(rows) - kept:,} more lines are left out here. The terminal shows them."] * (kept < len(rows))
    return "\n".join([*rows[:kept], *cut, ""])


def write_markdown(lines: Iterable[RenderableType], file: Path) -> None:
    """Write lines and tables to the file of --markdown."""
    with writing(file, "--markdown"):
        file.write_text(markdown_of(lines), encoding="utf-8")


def _paragraph(line: RenderableType) -> Iterator[str]:
    style = str(getattr(line, "style", ""))
    if text := escaped(str(line)):
        yield f"{_MARKS.get(style, '')}**{text}**\n" if style in ("bold", *_MARKS) else f"{text}\n"


def _rows(table: Table) -> Iterator[str]:
    columns = []
    for column in table.columns:
        cells = (escaped(str(cell)) for cell in (column.header if table.show_header else "", *column.cells))
        columns.append([cell.replace(" ", "\N{NO-BREAK SPACE}") if column.no_wrap else cell for cell in cells])
    head, *rows = (f"| {' | '.join(row)} |" for row in zip(*columns, strict=True))
    rules = ("---:" if column.justify == "right" else "---" for column in table.columns)
    yield f"{head}\n| {' | '.join(rules)} |"
    yield from rows
    yield ""
