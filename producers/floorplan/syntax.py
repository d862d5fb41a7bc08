"""The text of a floor plan as a tree of its parts, each with its place in the file.

The FloorPlan DSL, version 2 (https://github.com/secorolab/FloorPlan-DSL). Blanks may stand or be missing round every
colon, the sections may come in any order, and so may the parts of a section.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from lark import Lark, Token, Transformer, UnexpectedInput

from vastflow.sim.model.faults import Fault, FileError, Got, Place, Problem
from vastflow.sim.model.syntax import line_and_column, misfit, misplaced, spelling

SPELLED: Final[Mapping[str, str]] = {
    "NAME": "a name",
    "NUMBER": "a number",
    "WALL_OF": "a wall such as hall.walls[0]",
    "STRING": "a file name in quotes",
    "$END": "the end of the file",
}
"""Terminals that are more than a keyword or a sign."""

VERSION_1: Final[Mapping[str, str]] = {
    "from:": "'wrt:'",
    "to:": "'of:'",
    "pose:": "'translation:' and 'rotation:' by themselves",
    "wall thickness:": "'walls:' with 'thickness:'",
    "wall height:": "'walls:' with 'height:'",
}
"""Words of the FloorPlan DSL's version 1, and what stands in their place in version 2."""
WORD_OF_VERSION_1: Final = re.compile("|".join(word.replace(" ", r"\s+").replace(":", r"\s*:") for word in VERSION_1))
WORD: Final = re.compile(r"\w+|\S")
NUMBER_AT_END: Final = re.compile(r"(?<![\w.])[0-9][0-9.eE+-]*$")


def parsed(parser: Lark, text: str, file: str) -> Any:
    """Parse a text; raises a FileError of the first place where it is not in the language."""
    try:
        return parser.parse(text)
    except UnexpectedInput as error:
        wrong = misfit(error, text)
    at, before = wrong.start, text[: wrong.start].rstrip()
    match = WORD.match(text, at)
    found = match[0] if match else ""
    what: Problem = (got := Got(repr(found[:40]) if found else "the end of the file"))
    if old := WORD_OF_VERSION_1.match(text, at):
        word = " ".join(old[0].removesuffix(":").split()) + ":"
        what = Got(repr(word))
        right = f"{VERSION_1[word]} in version 2 of the language, as version 1 is not read"
    elif found[:1].isalpha() and NUMBER_AT_END.search(before):
        right = "a unit, 'm' for a length, 'rad' or 'deg' for an angle"
    elif found in (".", "[") and before[-1:].isalnum():
        right = SPELLED["WALL_OF"]
    else:
        what, right = misplaced(got, found, [spelling(parser, terminal, SPELLED) for terminal in wrong.expected])
    raise FileError([Fault(Place(file, *line_and_column(text, at), "syntax"), what, right)])


# A keyword and its colon are one terminal, and so are a number and its unit, and a wall and its space: it halves the
# tokens, and with them the time. The builder parts them again.
GRAMMAR: Final = r"""
plan: /Floor\s+plan\s*:/ NAME (defaults | variable | space | feature | opening)*

defaults: /Defaults\s*:/ walls? -> block
variable: /var\b/ NAME "=" NUMBER
space: /Space\b/ NAME ":" (shape | location | walls | features)* -> section
features: /features\s*:/ feature* -> block
feature: (/Column\b/ | /Divider\b/) NAME ":" (shape | location | height)* -> section
opening: (/Entryway\b/ | /Window\b/) NAME ":" (shape | location)* -> section

walls: /walls\s*:/ (thickness | height)* -> block
thickness: /thickness\s*:/ quantity -> single
height: /height\s*:/ quantity -> single

shape: /shape\s*:/ (rectangle | polygon | circle) -> single
rectangle: /Rectangle\b/ width "," (length | upright) -> block
width: /width\s*=/ quantity -> single
length: /length\s*=/ quantity -> single
upright: /height\s*=/ quantity -> single
polygon: /Polygon\b/ _POINTS "[" [point ("," point)*] "]" -> block
point: "(" quantity "," quantity ["," quantity] ")"
circle: /Circle\b/ radius -> block
radius: /radius\s*=/ quantity -> single

location: /location\s*:/ (wrt | of | in_walls | translation | rotation | not_aligned | spaced)* -> block
wrt: /wrt\s*:/ frame -> single
of: /of\s*:/ frame -> single
in_walls: /in\s*:/ frame (_AND frame)* -> block
translation: /translation\s*:/ [coordinate ("," coordinate)*] -> block
rotation: /rotation\s*:/ [coordinate ("," coordinate)*] -> block
coordinate: (/x\s*:/ | /y\s*:/ | /z\s*:/) quantity -> single
not_aligned: /not\s+aligned\b/ -> block
spaced: /spaced\b/ -> block

frame: WALL_OF | NAME
quantity: NUMBER | [MINUS] NAME

_POINTS: /points\s*:/
_AND: /and\b/
WALL_OF.2: /[A-Za-z_][A-Za-z0-9_]*\s*\.\s*walls\s*\[\s*[0-9]+\s*\]/
NUMBER: /[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?:\s*(?:m|rad|deg)\b)?/
MINUS: "-"
NAME: /[A-Za-z_][A-Za-z0-9_]*/
%ignore /\s+/
%ignore /\/\/[^\n]*/
"""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A length or angle as written: a number, with or without a unit, or a variable.

    Attributes:
        text: The number without its unit, or the variable's name; `token` begins with it.
    """

    token: Token
    text: str
    unit: str = ""
    negated: bool = False

    @property
    def is_variable(self) -> bool:
        return self.token.type == "NAME"

    @property
    def span(self) -> tuple[int, int]:
        """Start and end of `text` in the file."""
        start = self.token.start_pos or 0
        return start, start + len(self.text)


@dataclass(frozen=True, slots=True)
class FrameText:
    """`world`, `this`, a space, or a wall of a space."""

    token: Token
    name: str
    wall: int | None


@dataclass(frozen=True, slots=True)
class Part:
    """A section or a part of one.

    Attributes:
        token: The name of a section or variable, the keyword of anything else.
        key: The keyword without the sign behind it, such as `Space`, `walls`, or `not aligned`.
        value: Value after the keyword: a `Quantity`, a `FrameText`, a part, or a tuple of such; corners of a polygon as tuples of
            quantities.
    """

    token: Token
    key: str
    value: Any

    @property
    def by_key(self) -> dict[str, Any]:
        """The values of its parts, the last of each key."""
        return {part.key: part.value for part in self.value}


@dataclass(frozen=True, slots=True)
class PlanText:
    """A floor plan as it is written; `token` is its name."""

    file: str
    text: str
    token: Token
    sections: tuple[Part, ...]

    def of(self, *keys: str) -> list[Part]:
        """Return the sections with these keywords."""
        return [section for section in self.sections if section.key in keys]


class _Builder(Transformer[Token, Any]):
    """Transformer from Lark's rules to the classes above, called while parsing, so that Lark builds no tree."""

    def plan(self, children: list[Any]) -> tuple[Token, tuple[Part, ...]]:
        return children[1], tuple(children[2:])

    def variable(self, children: list[Any]) -> Part:
        return Part(children[1], "var", self.quantity(children[2:]))

    def section(self, children: list[Any]) -> Part:
        return Part(children[1], str(children[0]), tuple(children[2:]))

    def block(self, children: list[Any]) -> Part:
        return Part(children[0], _key(children[0]), self.point(children[1:]))

    def single(self, children: list[Any]) -> Part:
        return Part(children[0], _key(children[0]), children[1])

    def point(self, children: list[Any]) -> tuple[Any, ...]:
        return tuple(child for child in children if child is not None)

    def frame(self, children: list[Any]) -> FrameText:
        (token,) = children
        name, _, wall = token.partition(".")
        # Nine digits are more than any number of walls, and Python refuses to read thousands of them.
        index = int(wall.partition("[")[2].rstrip("]").strip()[-9:]) if wall else None
        return FrameText(token, name.rstrip(), index)

    def quantity(self, children: list[Any]) -> Quantity:
        token = children[-1]
        if len(children) == 2:
            return Quantity(token, str(token), negated=children[0] is not None)
        text = token.rstrip("mradeg").rstrip() if token[-1] in "mdg" else str(token)
        return Quantity(token, text, token[len(text) :].strip())


def _key(token: Token) -> str:
    return " ".join(token.rstrip(":=").split())


@cache
def _parser() -> Lark:
    return Lark(GRAMMAR, start="plan", parser="lalr", transformer=_Builder(), maybe_placeholders=True)


def parse(text: str, file: str) -> PlanText:
    """The parts of a floor plan's text; raises as `parsed` does."""
    return PlanText(file, text, *parsed(_parser(), text, file))
