"""Notes as a terminal shows them: every one of the campaign file's, and of a long parameter file the first few."""

from collections.abc import Iterator, Sequence
from typing import Final

from vastflow.producers.faults import Note

MOST_UNMODELLED: Final = 4


def terminal_lines(notes: Sequence[Note]) -> Iterator[str]:
    """A line for each note; what of one file is not modelled beyond a few is counted, and where to see it is said."""
    unmodelled: dict[str, list[Note]] = {}
    for note in notes:
        if note.kind == "not modelled":
            unmodelled.setdefault(note.file, []).append(note)
        else:
            yield str(note)
    for file, found in unmodelled.items():
        shown = found if len(found) <= MOST_UNMODELLED else found[: MOST_UNMODELLED - 1]
        yield from map(str, shown)
        if len(shown) < len(found):
            more = len(found) - len(shown)
            yield f"{file}: and {more} more that are not modelled; `vastflow params {file}` shows them all"
