"""Parsing by a grammar, and the words for what does not follow it."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from lark import Lark, UnexpectedCharacters, UnexpectedToken

from vastflow.producers.floorplan.faults import complain
from vastflow.sim.model import files
from vastflow.sim.model.names import nearest

MOST_BYTES: Final = 1_000_000

SPELLED: Final[Mapping[str, str]] = {
    "NAME": "a name",
    "NUMBER": "a number",
    "WALL_OF": "a wall such as hall.walls[0]",
    "STRING": "a file name in quotes",
    "$END": "the end of the file",
    "FLOOR_PLAN": "'Floor plan:'",
    "NOT_ALIGNED": "'not aligned'",
    "COLON": "':'",
    "COMMA": "','",
    "DOT": "'.'",
    "EQUAL": "'='",
    "MINUS": "'-'",
    "LPAR": "'('",
    "RPAR": "')'",
    "LSQB": "'['",
    "RSQB": "']'",
    "LBRACE": "'{'",
    "RBRACE": "'}'",
}
"""Terminals whose name does not say how they are written."""

CAPITALS: Final = frozenset(
    {"DEFAULTS", "SPACE", "COLUMN", "DIVIDER", "ENTRYWAY", "WINDOW", "RECTANGLE", "POLYGON", "CIRCLE"}
)
BARE: Final = (CAPITALS - {"DEFAULTS"}) | {
    "VAR",
    "SPACED",
    "_AND",
    "IMPORT",
    "UNIFORM",
    "DISCRETE",
    "NORMAL",
    "_MEAN",
    "_STD",
}
"""Keywords without a colon."""

MOST_EXPECTED: Final = 6

VERSION_1: Final[Mapping[str, str]] = {
    "from:": "'wrt:'",
    "to:": "'of:'",
    "pose:": "'translation:' and 'rotation:' by themselves",
    "wall thickness:": "'walls:' with 'thickness:'",
    "wall height:": "'walls:' with 'height:'",
}
"""Words of the FloorPlan DSL's version 1, and what stands in their place in version 2."""
WORD_OF_VERSION_1: Final = re.compile("|".join(word.replace(" ", r"\s+").replace(":", r"\s*:") for word in VERSION_1))


def parsed(parser: Lark, text: str, file: str) -> Any:
    """What `parser` makes of `text`.

    Raises:
        FloorplanError: nothing; where and why.
    """
    try:
        return parser.parse(text)
    except UnexpectedCharacters as error:
        at, expected = error.pos_in_stream or 0, error.allowed or set()
    except UnexpectedToken as error:
        at = len(text.rstrip()) if error.token.type == "$END" else error.token.start_pos or 0
        expected = error.accepts or error.expected
    before = text[:at]
    place = before.count("\n") + 1, at - (before.rfind("\n") + 1) + 1
    if old := WORD_OF_VERSION_1.match(text, at):
        word = " ".join(old[0].removesuffix(":").split()) + ":"
        right = f"{VERSION_1[word]} in version 2, the only one that is read; this is the language's version 1"
        complain(file, place, "syntax", f"found {word!r}", right)
    found = WORD.match(text, at)
    what = f"found {found[0][:40]!r}" if found else "the file ends here"
    complain(file, place, "syntax", what, _right(found[0] if found else "", before.rstrip(), set(expected)))


WORD: Final = re.compile(r"\w+|\S")


def _right(found: str, before: str, expected: set[str]) -> str:
    if found[:1].isalpha() and NUMBER_AT_END.search(before):
        return "the units are m, rad and deg; 'm' for a length, 'rad' or 'deg' for an angle"
    if found in (".", "[") and before[-1:].isalnum():
        return "a wall is written as in hall.walls[0]"
    spelled = {spelling.strip("'"): spelling for spelling in map(_spelled, expected)}
    if near := nearest(found, [name for name in spelled if " " not in name]):
        return f"did you mean {near!r}?"
    names = sorted(spelled.values())
    if len(names) > MOST_EXPECTED:
        names = [*names[:MOST_EXPECTED], "others"]
    return " or ".join(filter(None, [", ".join(names[:-1]), names[-1]])) if names else "something else here"


NUMBER_AT_END: Final = re.compile(r"(?<![\w.])[0-9][0-9.eE+-]*$")


def _spelled(terminal: str) -> str:
    if terminal in SPELLED:
        return SPELLED[terminal]
    word = terminal.strip("_").lower()
    if word.endswith("_is"):
        return f"'{word[:-3]} ='"
    word = word.capitalize() if terminal in CAPITALS else word
    return f"'{word}'" if terminal in BARE else f"'{word}:'"


def read_text(path: str | Path) -> str:
    """The text of a file.

    Raises:
        FloorplanError: it can't be read.
    """
    try:
        return files.read_text(path, "a floor plan or variation file", MOST_BYTES)
    except files.Unreadable as error:
        complain(str(path), error.place, "file", error.what, error.right, missing=isinstance(error, files.Missing))
