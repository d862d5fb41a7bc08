"""The text of a variation file as its parts, each with its place in the file."""

from dataclasses import dataclass
from functools import cache
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from lark import Lark, Token, Transformer

from vastflow.producers.faults import Fault
from vastflow.producers.floorplan.faults import FloorplanError
from vastflow.producers.floorplan.parsing import parsed

GRAMMAR: Final = r"""
variation: IMPORT STRING item+
item: path ":" (distribution | "{" attribute* "}")
attribute: path ":" distribution
path: NAME ("." NAME)*
?distribution: uniform | discrete | normal
uniform: UNIFORM "(" "[" NUMBER ("," NUMBER)* "]" ")"
discrete: DISCRETE "(" "[" pair ("," pair)* "]" ")"
pair: "(" NUMBER "," NUMBER ")"
normal: NORMAL "(" _MEAN "=" NUMBER "," _STD "=" NUMBER ")"

IMPORT: /import\b/
UNIFORM: /uniform\b/
DISCRETE: /discrete\b/
NORMAL: /normal\b/
_MEAN: /mean\b/
_STD: /std\b/
STRING: /"[^"\n]*"|'[^'\n]*'/
NUMBER: /[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?/
NAME: /[A-Za-z_][A-Za-z0-9_]*/
%ignore /\s+/
%ignore /\/\/[^\n]*/
"""

PROBABILITY_ROUNDING: Final = 1e-8
"""What the probabilities of a choice may miss 1 by; numpy allows 1.5e-8."""

DECIMALS: Final = 2
"""Draws of a normal distribution are rounded to centimeters, or hundredths of their unit."""

Path: TypeAlias = tuple[Token, ...]
"""Names that are joined by dots."""


@dataclass(frozen=True, slots=True)
class Distribution:
    """What a number is drawn from.

    Attributes:
        values: Those to choose from; mean and standard deviation of a normal distribution.
        probabilities: Of each value of a discrete distribution; otherwise empty.
    """

    kind: Literal["uniform", "discrete", "normal"]
    values: tuple[float, ...]
    probabilities: tuple[float, ...] = ()

    def draw(self, rng: np.random.RandomState) -> float:
        """One number, by the very calls that the documented numbers come from."""
        if self.kind == "uniform":
            return self.values[int(rng.randint(0, len(self.values)))]
        if self.kind == "discrete":
            return float(rng.choice(self.values, 1, p=self.probabilities)[0])
        mean, std = self.values
        return float(np.around(rng.normal(mean, abs(std)), DECIMALS))

    @property
    def fault(self) -> tuple[str, str] | None:
        """What is wrong with it and what would be right."""
        if not np.isfinite([*self.values, *self.probabilities]).all():
            return "found an infinite number", "finite numbers"
        if self.kind == "normal" and self.values[1] < 0.0:
            return f"std is {self.values[1]:g}", "0 or more"
        if self.kind == "discrete" and min(self.probabilities) < 0.0:
            return f"found the probability {min(self.probabilities):g}", "0 or more; in each pair it stands first"
        if self.kind == "discrete" and abs(sum(self.probabilities) - 1.0) > PROBABILITY_ROUNDING:
            what = f"the probabilities add up to {sum(self.probabilities):g}"
            return what, "1; in each pair the probability stands first"
        return None


@dataclass(frozen=True, slots=True)
class Item:
    """A number that is drawn.

    Attributes:
        path: A variable, or a space, feature or opening.
        attribute: Which number of it; empty for a variable.
    """

    path: Path
    attribute: Path
    distribution: Distribution

    def __str__(self) -> str:
        return ".".join([*self.path, *self.attribute])


@dataclass(frozen=True, slots=True)
class VariationText:
    """A variation file as it is written.

    Attributes:
        file: Its name for messages.
        imported: Path of the plan, relative to the file.
        imported_at: Line and column where it stands.
    """

    file: str
    imported: str
    imported_at: tuple[int, int]
    items: tuple[Item, ...]


@dataclass(frozen=True, slots=True)
class _Drawn:
    token: Token
    distribution: Distribution


class _Builder(Transformer[Token, Any]):
    """Lark's rules to values; called while parsing."""

    def path(self, children: list[Any]) -> Path:
        return tuple(children)

    pair = attribute = path

    def uniform(self, children: list[Any]) -> _Drawn:
        return _Drawn(children[0], Distribution("uniform", tuple(map(float, children[1:]))))

    def discrete(self, children: list[Any]) -> _Drawn:
        probabilities, values = zip(*children[1:], strict=True)
        return _Drawn(
            children[0], Distribution("discrete", tuple(map(float, values)), tuple(map(float, probabilities)))
        )

    def normal(self, children: list[Any]) -> _Drawn:
        return _Drawn(children[0], Distribution("normal", tuple(map(float, children[1:]))))

    def item(self, children: list[Any]) -> tuple[Path, list[tuple[Path, _Drawn]]]:
        path, *rest = children
        return path, [((), each) if isinstance(each, _Drawn) else each for each in rest]

    def variation(self, children: list[Any]) -> tuple[Token, list[tuple[Path, list[tuple[Path, _Drawn]]]]]:
        _, imported, *items = children
        return imported, items


@cache
def _parser() -> Lark:
    return Lark(GRAMMAR, start="variation", parser="lalr", transformer=_Builder())


def parse_variation(text: str, file: str) -> VariationText:
    """The parts of a variation file.

    Raises:
        FloorplanError: it is not in the language, or a distribution is none.
    """
    imported, entries = parsed(_parser(), text, file)
    faults: list[Fault] = []
    items: list[Item] = []
    for path, attributes in entries:
        if not attributes:
            right = "one attribute or more, such as shape.width: uniform([1.0, 2.0])"
            faults.append(Fault(file, *_place(path[0]), ".".join(path), "nothing between the braces", right))
        for attribute, drawn in attributes:
            items.append(Item(path, attribute, drawn.distribution))
            if (wrong := drawn.distribution.fault) is not None:
                faults.append(Fault(file, *_place(drawn.token), str(items[-1]), *wrong))
    if faults:
        raise FloorplanError(faults)
    return VariationText(file, str(imported)[1:-1], _place(imported), tuple(items))


def _place(token: Token) -> tuple[int, int]:
    return token.line or 1, token.column or 1
