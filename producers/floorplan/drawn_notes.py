"""What there is to note of the plans that a variation draws, such as a door that its numbers put beside its wall."""

import re
from collections.abc import Collection, Iterator
from dataclasses import replace
from itertools import islice
from typing import Final

from vastflow.producers.faults import AS_DRAWN, Note
from vastflow.producers.floorplan.building import build
from vastflow.producers.floorplan.faults import FloorplanError
from vastflow.producers.floorplan.reading import plan_of
from vastflow.producers.floorplan.variation import Variation

MOST_LOOKED_AT: Final = 50
"""Of one variation's plans: a plan of 75 rooms takes a fiftieth of a second, whenever its campaign is read."""

_NUMBER: Final = re.compile(r"-?\d+(\.\d+)?(e[-+]\d+)?")


def drawn_notes(variation: Variation, seeds: Collection[int], known: Collection[Note] = ()) -> Iterator[Note]:
    """One note for each that some of the plans have, with the numbers of the first: which plans these are, and what it is.

    Its place is that in the plan as it is written. Plans that can't be built have none.

    Args:
        known: Notes of the plan as it is written, which are not said again.
    """
    found: dict[tuple[int, int, str, str], list[tuple[int, Note]]] = {}
    said = {_kind(note) for note in known}
    for seed in islice(seeds, MOST_LOOKED_AT):
        try:
            notes = build(plan_of(variation.plan, variation.numbers(variation.sample(seed)))).notes
        except FloorplanError:
            continue
        for kind, note in {_kind(note): note for note in notes if _kind(note) not in said}.items():
            found.setdefault(kind, []).append((seed, note))
    looked_at = min(len(seeds), MOST_LOOKED_AT)
    for plans in found.values():
        seed, note = plans[0]
        others = f" and in {len(plans) - 1} more of the first {looked_at} variations" if plans[1:] else ""
        yield replace(note, what=f"{AS_DRAWN} {seed}{others}: {note.what}")


def _kind(note: Note) -> tuple[int, int, str, str]:
    """Equal for notes that differ in numbers only."""
    return note.line, note.column, note.where, _NUMBER.sub("#", note.what)
