"""The text of a floor plan as a tree of its parts, each with its place in the file.

The FloorPlan DSL, version 2 (https://github.com/secorolab/FloorPlan-DSL). Blanks may stand or be missing round every
colon, the sections may come in any order, and so may the parts of a section.
"""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeAlias, cast

from lark import Lark, Token, Transformer, UnexpectedInput

from vastflow.sim.model import files
from vastflow.sim.model.faults import Fault, FaultKind, FileError, Place
from vastflow.sim.model.syntax import expectation, line_and_column, misfit, spelling

MOST_BYTES: Final = 1_000_000

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


def parsed(parser: Lark, text: str, file: str) -> Any:
    """Parse a text.

    Raises:
        FileError: nothing; where and why.
    """
    try:
        return parser.parse(text)
    except UnexpectedInput as error:
        wrong = misfit(error, text)
    at = wrong.start
    place = Place(file, *line_and_column(text, at), "syntax")
    if old := WORD_OF_VERSION_1.match(text, at):
        word = " ".join(old[0].removesuffix(":").split()) + ":"
        right = f"{VERSION_1[word]} in version 2, the only one that is read; this is the language's version 1"
        raise FileError([Fault(place, f"got {word!r}", right)])
    found = WORD.match(text, at)
    what = f"got {found[0][:40]!r}" if found else "the file ends here"
    spelled = [spelling(parser, terminal, SPELLED) for terminal in wrong.expected]
    raise FileError([Fault(place, what, _right(found[0] if found else "", text[:at].rstrip(), spelled))])


WORD: Final = re.compile(r"\w+|\S")


def _right(found: str, before: str, spelled: Collection[str]) -> str:
    if found[:1].isalpha() and NUMBER_AT_END.search(before):
        return "a unit, 'm' for a length, 'rad' or 'deg' for an angle"
    if found in (".", "[") and before[-1:].isalnum():
        return "a wall such as hall.walls[0]"
    return expectation(found, spelled)


NUMBER_AT_END: Final = re.compile(r"(?<![\w.])[0-9][0-9.eE+-]*$")


def read_text(path: str | Path) -> str:
    """The text of a file.

    Raises:
        FileError: it can't be read.
    """
    try:
        return files.read_text(path, "a floor plan or variation file", MOST_BYTES)
    except files.Unreadable as error:
        kind: FaultKind = "missing" if isinstance(error, files.Missing) else "error"
        raise FileError([Fault(Place(str(path), *error.place, "file"), error.what, error.right, kind)]) from None


GRAMMAR: Final = r"""
plan: FLOOR_PLAN NAME (defaults | variable | space | feature | opening)*

defaults: DEFAULTS walls?
variable: VAR NAME "=" NUMBER
space: SPACE NAME ":" (shape_part | location | walls | features)*
features: FEATURES feature*
feature: (COLUMN | DIVIDER) NAME ":" (shape_part | location | height)*
opening: (ENTRYWAY | WINDOW) NAME ":" (shape_part | location)*

walls: WALLS (thickness | height)*
thickness: THICKNESS quantity
height: HEIGHT quantity

shape_part: SHAPE (rectangle | polygon | circle)
rectangle: RECTANGLE WIDTH_IS quantity "," (LENGTH_IS | HEIGHT_IS) quantity
polygon: POLYGON _POINTS "[" [point ("," point)*] "]"
circle: CIRCLE RADIUS_IS quantity
point: "(" quantity "," quantity ["," quantity] ")"

location: LOCATION (wrt | of | in_walls | translation | rotation | not_aligned | spaced)*
wrt: WRT frame
of: OF frame
in_walls: IN frame (_AND frame)*
translation: TRANSLATION [coordinate ("," coordinate)*]
rotation: ROTATION [coordinate ("," coordinate)*]
not_aligned: NOT_ALIGNED
spaced: SPACED
coordinate: (X | Y | Z) quantity
frame: WALL_OF | NAME

quantity: NUMBER | [MINUS] NAME

FLOOR_PLAN: /Floor\s+plan\s*:/
DEFAULTS: /Defaults\s*:/
VAR: /var\b/
SPACE: /Space\b/
FEATURES: /features\s*:/
COLUMN: /Column\b/
DIVIDER: /Divider\b/
ENTRYWAY: /Entryway\b/
WINDOW: /Window\b/
WALLS: /walls\s*:/
THICKNESS: /thickness\s*:/
HEIGHT: /height\s*:/
SHAPE: /shape\s*:/
RECTANGLE: /Rectangle\b/
POLYGON: /Polygon\b/
CIRCLE: /Circle\b/
WIDTH_IS: /width\s*=/
LENGTH_IS: /length\s*=/
HEIGHT_IS: /height\s*=/
RADIUS_IS: /radius\s*=/
_POINTS: /points\s*:/
LOCATION: /location\s*:/
WRT: /wrt\s*:/
OF: /of\s*:/
IN: /in\s*:/
TRANSLATION: /translation\s*:/
ROTATION: /rotation\s*:/
NOT_ALIGNED: /not\s+aligned\b/
SPACED: /spaced\b/
_AND: /and\b/
X: /x\s*:/
Y: /y\s*:/
Z: /z\s*:/
WALL_OF.2: /[A-Za-z_][A-Za-z0-9_]*\s*\.\s*walls\s*\[\s*[0-9]+\s*\]/
NUMBER: /[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?:\s*(?:m|rad|deg)\b)?/
MINUS: "-"
NAME: /[A-Za-z_][A-Za-z0-9_]*/
%ignore /\s+/
%ignore /\/\/[^\n]*/
"""

# A keyword and its colon are one terminal, and so are a number and its unit, and a wall and its space: it halves the
# tokens, and with them the time. They are parted again below.


@dataclass(frozen=True, slots=True)
class Quantity:
    """A length or angle as written: a number, with or without a unit, or a variable.

    Attributes:
        text: The number without its unit, or the variable's name; `token` begins with it.
    """

    token: Token
    text: str
    unit: str
    negated: bool

    @property
    def is_variable(self) -> bool:
        """Whether it names a variable."""
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
class ShapeText:
    """A rectangle (`width` and `length` or `height`), polygon (`points`) or circle (`radius`)."""

    token: Token
    sizes: Mapping[str, Quantity]
    points: tuple[tuple[Quantity, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class SectionPart:
    """Something in a section that may stand there once: its keyword and what follows."""

    token: Token
    key: str
    value: Any


SectionParts: TypeAlias = tuple[SectionPart, ...]


@dataclass(frozen=True, slots=True)
class PlanSection:
    """A space, feature or opening: `kind` is its keyword."""

    kind: str
    token: Token
    parts: SectionParts


@dataclass(frozen=True, slots=True)
class VariableText:
    """A variable as it is declared."""

    token: Token
    number: Quantity


@dataclass(frozen=True, slots=True)
class PlanText:
    """A floor plan as it is written.

    Attributes:
        file: Its name for messages.
        text: All of it.
        defaults: Wall values of each `Defaults` section; there should be one section at most.
        features: Those that stand outside of a space.
    """

    file: str
    text: str
    token: Token
    defaults: tuple[SectionPart, ...]
    variables: tuple[VariableText, ...]
    spaces: tuple[PlanSection, ...]
    features: tuple[PlanSection, ...]
    openings: tuple[PlanSection, ...]


@dataclass(frozen=True, slots=True)
class _Plan:
    token: Token
    sections: tuple[Any, ...]


class _Builder(Transformer[Token, _Plan]):
    """Lark's rules to the classes above; called while parsing, so that no tree of Lark's is built."""

    def plan(self, children: list[Any]) -> _Plan:
        return _Plan(children[1], tuple(children[2:]))

    def defaults(self, children: list[Any]) -> SectionPart:
        return SectionPart(children[0], "defaults", tuple(children[1:]))

    def variable(self, children: list[Any]) -> VariableText:
        return VariableText(children[1], _number(children[2]))

    def section(self, children: list[Any]) -> PlanSection:
        return PlanSection(str(children[0]), children[1], tuple(children[2:]))

    space = feature = opening = section

    def block(self, children: list[Any]) -> SectionPart:
        return SectionPart(children[0], _word(children[0]), tuple(child for child in children[1:] if child is not None))

    features = walls = location = in_walls = translation = rotation = block

    def single(self, children: list[Any]) -> SectionPart:
        return SectionPart(children[0], _word(children[0]), children[1])

    thickness = height = shape_part = wrt = of = coordinate = single

    def flag(self, children: list[Any]) -> SectionPart:
        return SectionPart(children[0], " ".join(children[0].split()), None)

    not_aligned = spaced = flag

    def rectangle(self, children: list[Any]) -> ShapeText:
        token, width, width_value, other, other_value = children
        return ShapeText(token, {_word(width): width_value, _word(other): other_value})

    def polygon(self, children: list[Any]) -> ShapeText:
        return ShapeText(children[0], {}, tuple(child for child in children[1:] if child is not None))

    def circle(self, children: list[Any]) -> ShapeText:
        token, radius, value = children
        return ShapeText(token, {_word(radius): value})

    def point(self, children: list[Any]) -> tuple[Quantity, ...]:
        return tuple(child for child in children if child is not None)

    def frame(self, children: list[Any]) -> FrameText:
        (token,) = children
        name, _, wall = token.partition(".")
        # Nine digits are more than any number of walls, and Python refuses to read thousands of them.
        index = int(wall.partition("[")[2].rstrip("]").strip()[-9:]) if wall else None
        return FrameText(token, name.rstrip(), index)

    def quantity(self, children: list[Any]) -> Quantity:
        if len(children) == 1:
            return _number(children[0])
        minus, name = children
        return Quantity(name, str(name), "", minus is not None)


def _number(token: Token) -> Quantity:
    text = token.rstrip("mradeg").rstrip() if token[-1] in "mdg" else str(token)
    return Quantity(token, text, token[len(text) :].strip(), False)


def _word(token: Token) -> str:
    """A keyword without the sign behind it."""
    return token[:-1].rstrip()


@cache
def _parser() -> Lark:
    return Lark(GRAMMAR, start="plan", parser="lalr", transformer=_Builder(), maybe_placeholders=True)


def parse(text: str, file: str) -> PlanText:
    """The parts of a floor plan's text.

    Raises:
        FileError: it is not in the language; the first place where it is not.
    """
    plan = cast(_Plan, parsed(_parser(), text, file))
    by_kind: dict[str, list[Any]] = {kind: [] for kind in ("defaults", "var", "space", "feature", "opening")}
    for section in plan.sections:
        by_kind[_kind_of(section)].append(section)
    return PlanText(file, text, plan.token, *map(tuple, by_kind.values()))


def _kind_of(section: Any) -> str:
    if isinstance(section, SectionPart):
        return "defaults"
    if isinstance(section, VariableText):
        return "var"
    return {"Space": "space", "Column": "feature", "Divider": "feature"}.get(section.kind, "opening")
