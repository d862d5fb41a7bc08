"""The Variation DSL: from the text of a `.variation` file to the numbers that it draws for a plan."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from lark import Lark, Token, Transformer

from vastflow.producers.floorplan.building import Building, build
from vastflow.producers.floorplan.syntax import Part, PlanText, Quantity, parsed
from vastflow.sim.model.faults import Complaint, Fault, FileError, Got, Place, Problem
from vastflow.sim.model.names import did_you_mean

GRAMMAR: Final = r"""
variation: /import\b/ STRING item+
item: path ":" distribution -> variable
    | path ":" "{" attribute* "}"
attribute: path ":" distribution
path: NAME ("." NAME)*
?distribution: uniform | discrete | normal
uniform: /uniform\b/ "(" "[" NUMBER ("," NUMBER)* "]" ")"
discrete: /discrete\b/ "(" "[" pair ("," pair)* "]" ")"
pair: "(" NUMBER "," NUMBER ")"
normal: /normal\b/ "(" _MEAN "=" NUMBER "," _STD "=" NUMBER ")"

_MEAN: /mean\b/
_STD: /std\b/
STRING: /"[^"\n]*"|'[^'\n]*'/
NUMBER: /[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?/
NAME: /[A-Za-z_][A-Za-z0-9_]*/
%ignore /\s+/
%ignore /\/\/[^\n]*/
"""

PROBABILITY_ROUNDING: Final = 1e-8
"""Tolerance of a choice's total probability; numpy allows 1.5e-8."""

DECIMALS: Final = 2
"""Draws of a normal distribution are rounded to centimeters, or hundredths of their unit."""

Path: TypeAlias = tuple[Token, ...]
"""Names that are joined by dots."""


@dataclass(frozen=True, slots=True)
class Distribution:
    """The distribution of a number: values, with their probabilities if it is discrete, or mean and std."""

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
    def fault(self) -> Complaint | None:
        """The fault of the distribution and what would be right; None if it has none."""
        if not np.isfinite([*self.values, *self.probabilities]).all():
            return Got("an infinite number"), "finite numbers"
        if self.kind == "normal" and self.values[1] < 0.0:
            return Got(f"std {self.values[1]:g}"), "0 or more"
        if self.kind == "discrete" and min(self.probabilities) < 0.0:
            return f"the probability {min(self.probabilities):g} is negative", "each pair begins with a probability"
        if self.kind == "discrete" and abs(math.fsum(self.probabilities) - 1.0) > PROBABILITY_ROUNDING:
            what = f"the probabilities add up to {math.fsum(self.probabilities):g}"
            return what, "they must add up to 1, and each pair begins with one"
        return None


@dataclass(frozen=True, slots=True)
class Item:
    """A number that is drawn: a variable or an attribute; `token` is the keyword of its distribution."""

    path: Path
    attribute: Path
    token: Token
    distribution: Distribution

    def __str__(self) -> str:
        return ".".join([*self.path, *self.attribute])


@dataclass(frozen=True, slots=True)
class VariationText:
    """A variation file as it is written; the path of the plan is relative to it."""

    file: str
    imported: str
    imported_at: tuple[int, int]
    items: tuple[Item, ...]


class _Builder(Transformer[Token, Any]):
    """Lark's rules to values; called while parsing."""

    def path(self, children: list[Any]) -> tuple[Any, ...]:
        return tuple(children)

    pair = attribute = variation = path

    def uniform(self, children: list[Any]) -> tuple[Token, Distribution]:
        return children[0], Distribution("uniform", tuple(map(float, children[1:])))

    def normal(self, children: list[Any]) -> tuple[Token, Distribution]:
        return children[0], Distribution("normal", tuple(map(float, children[1:])))

    def discrete(self, children: list[Any]) -> tuple[Token, Distribution]:
        probabilities, values = zip(*children[1:], strict=True)
        return children[0], Distribution("discrete", tuple(map(float, values)), tuple(map(float, probabilities)))

    def variable(self, children: list[Any]) -> tuple[Path, list[Item]]:
        path, drawn = children
        return path, [Item(path, (), *drawn)]

    def item(self, children: list[Any]) -> tuple[Path, list[Item]]:
        path, *attributes = children
        return path, [Item(path, attribute, *drawn) for attribute, drawn in attributes]


@cache
def _parser() -> Lark:
    return Lark(GRAMMAR, start="variation", parser="lalr", transformer=_Builder())


def parse_variation(text: str, file: str) -> VariationText:
    """The parts of a variation file.

    Raises:
        FileError: it is not in the language, or a distribution is none.
    """
    _, imported, *entries = parsed(_parser(), text, file)
    faults = [
        Fault(Place(file, *_place(item.token), str(item)), *wrong)
        for _, items in entries
        for item in items
        if (wrong := item.distribution.fault) is not None
    ]
    right = "add an attribute, such as shape.width: uniform([1.0, 2.0])"
    faults += [
        Fault(Place(file, *_place(path[0]), ".".join(path)), "there is nothing between the braces", right)
        for path, items in entries
        if not items
    ]
    if faults:
        raise FileError(faults)
    items = tuple(item for _, each in entries for item in each)
    return VariationText(file, str(imported)[1:-1], _place(imported), items)


def _place(token: Token) -> tuple[int, int]:
    return token.line or 1, token.column or 1


GREATEST_SEED: Final = 2**32 - 1
"""Greatest seed of numpy's legacy generator."""


@dataclass(frozen=True, slots=True)
class Varied:
    """A number of the plan's text that is drawn, called as in the variation file, such as `study.post.height`."""

    name: str
    distribution: Distribution
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class PlanSample:
    """One variation of a plan.

    Attributes:
        values: Name to the number drawn, in the order of drawing.
        text: The plan with these numbers; whether it can be built is not known.
    """

    seed: int
    values: Mapping[str, float]
    text: str


@dataclass(frozen=True, slots=True)
class Variation:
    """A variation file and its plan, with the drawn numbers in the order of the file."""

    source: str
    plan: PlanText
    varied: tuple[Varied, ...]

    def sample(self, seed: int) -> PlanSample:
        """Draw every varied number of the plan from `RandomState(seed)`, at most `GREATEST_SEED`."""
        rng = np.random.RandomState(seed)
        drawn = [(varied, varied.distribution.draw(rng)) for varied in self.varied]
        text = [f"// Variation of the floor plan {self.plan.token}, drawn from {self.source}\n// Seed {seed}\n"]
        behind = 0
        for varied, value in sorted(drawn, key=lambda pair: pair[0].start):
            text += [self.plan.text[behind : varied.start], repr(value)]
            behind = varied.end
        values = {varied.name: value for varied, value in drawn}
        return PlanSample(seed, values, "".join([*text, self.plan.text[behind:]]))

    def building(self, sample: PlanSample) -> Building:
        """The building of a sample with places of the plan as it is written; raises as `build` does."""
        return build(self.plan, {each.start: sample.values[each.name] for each in self.varied})


def variation_of(text: VariationText, plan: PlanText) -> Variation:
    """A variation file on the plan it names.

    Raises:
        FileError: it varies what the plan does not have, or one number twice.
    """
    numbers = _Numbers(plan)
    faults: list[Fault] = []
    varied: list[Varied] = []
    taken: set[int] = set()
    for item in text.items:
        found = numbers.attribute(item.path, item.attribute) if item.attribute else numbers.variable(item.path)
        if isinstance(found, Quantity) and found.span[0] in taken:
            twice = f"the number in line {found.token.line} of the plan is varied a second time"
            found = (item.attribute or item.path)[0], twice, "keep one of the distributions"
        if isinstance(found, Quantity):
            taken.add(found.span[0])
            varied.append(Varied(str(item), item.distribution, *found.span))
        else:
            token, what, right = found
            faults.append(Fault(Place(text.file, *_place(token), str(item)), what, right))
    if faults:
        raise FileError(faults)
    return Variation(text.file, plan, tuple(varied))


_Wrong: TypeAlias = tuple[Token, Problem, str]
"""Place, problem, and expected value."""


class _Numbers:
    """The numbers of a plan's text by the paths that name them."""

    def __init__(self, plan: PlanText) -> None:
        self._variables: dict[str, Quantity] = {str(variable.token): variable.value for variable in plan.of("var")}
        spaces = plan.of("Space")
        own = [*spaces, *plan.of("Entryway", "Window"), *plan.of("Column", "Divider")]
        self._sections = {str(section.token): section for section in own}
        self._sections |= {
            f"{space.token}.{feature.token}": feature
            for space in spaces
            for part in space.value
            if part.key == "features"
            for feature in part.value
        }
        count = Counter(str(section.token) for section in own)
        self._ambiguous = {name for name in count if count[name] > 1}

    def variable(self, path: Path) -> Quantity | _Wrong:
        """The number that a variable is declared with."""
        name = ".".join(path)
        if name in self._variables:
            return self._variables[name]
        if name in self._sections:
            return path[0], f"{name!r} is not a variable", f"write '{name}: {{ ... }}' with its attributes"
        right = did_you_mean(name, self._variables, "it declares none")
        return path[0], f"the plan has no variable {name!r}", right

    def attribute(self, path: Path, attribute: Path) -> Quantity | _Wrong:
        """The number of an attribute of a space, feature or opening."""
        name, wanted = ".".join(path), ".".join(attribute)
        section = self._sections.get(name)
        if section is None and name in self._variables:
            return path[0], f"{name!r} is a variable", "write its distribution without braces"
        if section is None:
            what = f"the plan has no space, feature or opening {name!r}"
            return path[0], what, did_you_mean(name, self._sections)
        if name in self._ambiguous:
            return path[0], f"the plan has more than one {name!r}", "use a name that is unique"
        known = dict(_attributes(section))
        quantity = known.get(wanted, known.get(_of_today(wanted, section.key)))
        if quantity is None:
            return attribute[0], f"{section.key} {name} states no {wanted!r}", did_you_mean(wanted, known)
        if quantity.is_variable:
            variable = quantity.text
            what = f"{wanted} of {name} is the variable {variable!r}"
            return attribute[0], what, f"vary {variable!r} itself, or write a number in the plan"
        return quantity


def _of_today(attribute: str, kind: str) -> str:
    """Return an attribute's path in version 2 of the language, from its drafts' or version 1's."""
    if attribute in ("wall_thickness", "wall_height"):
        return attribute.replace("wall_", "defaults.wall.")
    words = [word for word in attribute.split(".") if word not in ("location", "pose", "transformation")]
    if words == ["rotation"]:
        words.append("y" if kind in ("Entryway", "Window") else "z")
    return ".".join(["location", *words])


def _attributes(section: Part) -> Iterator[tuple[str, Quantity]]:
    """Every number that a section states and that may be varied, variables included, by its path."""
    parts = section.by_key
    if "shape" in parts and parts["shape"].key != "Polygon":
        for name, size in parts["shape"].by_key.items():
            yield f"shape.{name}", size
    if "height" in parts:
        yield "height", parts["height"]
    for part in parts.get("walls", ()):
        yield f"defaults.wall.{part.key}", part.value
    for part in parts.get("location", ()):
        if part.key in ("translation", "rotation"):
            for coordinate in part.value:
                yield f"location.{part.key}.{coordinate.key}", coordinate.value
