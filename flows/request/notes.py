"""Notes as a terminal shows them: every one of the campaign file's, and of the files that it names the first few of each."""

from collections.abc import Iterator, Sequence
from typing import Final

from vastflow.producers.model.faults import AS_DRAWN, Note

MOST_OF_A_FILE: Final = 4


def terminal_lines(notes: Sequence[Note]) -> Iterator[str]:
    """A line for each note; of a parameter file or floor plan those beyond a few are counted, and where to see them is said."""
    elsewhere: dict[tuple[str, str], list[Note]] = {}
    for note in notes:
        if rest := _rest(note):
            elsewhere.setdefault((note.file, rest), []).append(note)
        else:
            yield str(note)
    for (file, rest), found in elsewhere.items():
        shown = found if len(found) <= MOST_OF_A_FILE else found[: MOST_OF_A_FILE - 1]
        yield from map(str, shown)
        if len(shown) < len(found):
            yield f"{file}: and {len(found) - len(shown)} more {rest}"


def _rest(note: Note) -> str:
    """What those are that are not shown, and which command shows them; empty for a note that is shown in any case."""
    if note.kind == "not modeled":
        return f"that are not modeled; `vastflow params {note.file}` shows them all"
    if note.file.endswith((".fpm", ".fpm2")) and note.what.startswith(AS_DRAWN):
        return "warnings of its variations; `vastflow floorplan variations` shows them all"
    if note.file.endswith((".fpm", ".fpm2")):
        return f"warnings; `vastflow floorplan geometry {note.file}` shows them all"
    return ""
