"""From the parts of a floor plan's text to what it says; every fault is found in one go."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from lark import Token

from vastflow.producers.floorplan.geometry import SMALLEST_M, circle, outline_fault, rectangle, signed_area
from vastflow.producers.floorplan.plan import Feature, FloorPlan, Offset, Opening, Outline, PlanFrame, PlanSpace
from vastflow.producers.floorplan.syntax import (
    FrameText,
    PlanSection,
    PlanText,
    Quantity,
    SectionPart,
    SectionParts,
    ShapeText,
    parse,
)
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.sim.model.names import did_you_mean

LARGEST_M: Final = 10_000.0
"""No length is greater: a building of that size is a slip, and its grid would fill the memory."""

WORLD: Final = "world"
THIS: Final = "this"

IN_A_LOCATION: Final[Mapping[str, tuple[str, ...]]] = {
    "Space": ("wrt", "of", "translation", "rotation", "not aligned", "spaced"),
    "Column": ("wrt", "translation", "rotation"),
    "Divider": ("wrt", "translation", "rotation"),
    "Entryway": ("in", "translation", "rotation"),
    "Window": ("in", "translation", "rotation"),
}
NEEDED_IN_A_LOCATION: Final[Mapping[str, Mapping[str, str]]] = {
    "Space": {"wrt": "wrt: world, another space or one of its walls", "of": "of: this, or one of its walls"},
    "Column": {"wrt": "wrt: this, this.walls[...] or another space"},
    "Divider": {"wrt": "wrt: this, this.walls[...] or another space"},
    "Entryway": {"in": "in: space.walls[...]"},
    "Window": {"in": "in: space.walls[...]"},
}
MOVES: Final[Mapping[str, tuple[str, str]]] = {
    "Space": ("xy", "z"),
    "Column": ("xy", "z"),
    "Divider": ("xy", "z"),
    "Entryway": ("xz", "y"),
    "Window": ("xz", "y"),
}
"""Kind to the axes it is moved along and turned about; on the others only 0 may stand."""


def read_plan(text: str, file: str) -> FloorPlan:
    """The floor plan that `text` describes.

    Raises:
        FileError: every fault in it, or the first where it is not in the language at all.
    """
    return plan_of(parse(text, file))


def plan_of(text: PlanText, drawn: Mapping[int, float] | None = None) -> FloorPlan:
    """The floor plan of a parsed text.

    Args:
        drawn: Numbers that take the place of those in the text, by where these begin.

    Raises:
        FileError: every fault in it.
    """
    reader = _Reader(text, drawn or {})
    plan = reader.plan()
    if reader.faults:
        raise FileError(reader.faults)
    return replace(plan, notes=tuple(reader.notes))


class _Reader:
    """Reader of one plan.

    A value that is wrong is NaN or a stand-in; with a fault, no plan leaves this module.
    """

    def __init__(self, text: PlanText, drawn: Mapping[int, float]) -> None:
        self.faults: list[Fault] = []
        self.notes: list[Fault] = []
        self._text = text
        self._drawn = drawn
        self._variables = self._read_variables()
        self._corners: dict[str, int | None] = {}

    def plan(self) -> FloorPlan:
        text = self._text
        defaults = self._defaults()
        self._distinct("space", (section.token for section in text.spaces))
        self._distinct("opening", (section.token for section in text.openings))
        if not text.spaces:
            self._fault(text.token, f"Floor plan {text.token}", "no space", "at least one 'Space name:'")
        parts = [(section, self._once(section.parts, f"Space {section.token}")) for section in text.spaces]
        outlines = [self._outline(section, given) for section, given in parts]
        for section, outline in zip(text.spaces, outlines, strict=True):
            self._corners.setdefault(str(section.token), len(outline) or None)
        spaces = [
            self._space(section, given, outline, defaults)
            for (section, given), outline in zip(parts, outlines, strict=True)
        ]
        features = [
            feature
            for section, given in parts
            for feature in self._features(given["features"].value if "features" in given else (), str(section.token))
        ]
        features += self._features(text.features, None)
        openings = [self._opening(section) for section in text.openings]
        return FloorPlan(str(text.token), text.file, tuple(spaces), tuple(features), tuple(openings))

    # Faults

    def _fault(self, token: Token, where: str, what: str, right: str) -> None:
        self.faults.append(Fault(Place(self._text.file, *_place(token), where), what, right))

    def _note(self, token: Token, where: str, what: str, right: str) -> None:
        self.notes.append(Fault(Place(self._text.file, *_place(token), where), what, right, "warning"))

    def _distinct(self, kind: str, names: Iterable[Token]) -> None:
        first: dict[str, Token] = {}
        for name in names:
            if first.setdefault(str(name), name) is not name:
                right = f"another name; line {first[name].line} has it"
                self._fault(name, f"{kind} {name}", f"a second {kind} {str(name)!r}", right)

    def _once(self, parts: SectionParts, where: str, known: Sequence[str] | None = None) -> dict[str, SectionPart]:
        """Parts by key: the first of each, those that are not `known` left out."""
        found: dict[str, SectionPart] = {}
        for part in parts:
            if known is not None and part.key not in known:
                self._fault(part.token, where, f"got {part.key!r}", f"only {', '.join(known)} can stand here")
            elif part.key in found:
                right = f"one; line {found[part.key].token.line} has it"
                self._fault(part.token, where, f"a second {part.key!r}", right)
            else:
                found[part.key] = part
        return found

    # Numbers

    def _read_variables(self) -> dict[str, tuple[float, str]]:
        self._distinct("variable", (variable.token for variable in self._text.variables))
        values: dict[str, tuple[float, str]] = {}
        for variable in self._text.variables:
            unit = variable.number.unit
            if not unit:
                where = f"variable {variable.token}"
                self._fault(variable.number.token, where, "no unit", "m for a length, rad or deg for an angle")
            values.setdefault(str(variable.token), (self._number(variable.number), unit or "m"))
        return values

    def _number(self, quantity: Quantity) -> float:
        drawn = self._drawn.get(quantity.span[0])
        return float(quantity.text) if drawn is None else drawn

    def _value(self, quantity: Quantity, where: str, unit: str, what: str) -> tuple[float, str]:
        """A number and its unit, NaN where a variable is unknown."""
        token = quantity.token
        if not quantity.is_variable:
            return self._number(quantity), quantity.unit or unit
        if token not in self._variables:
            right = did_you_mean(str(token), self._variables) if self._variables else f"'var {token} = ...' declares it"
            self._fault(token, where, f"no variable {str(token)!r}", right)
            return math.nan, unit
        value, found = self._variables[token]
        if (found == "m") != (unit == "m"):
            self._fault(token, where, f"variable {str(token)!r} is in {found}", f"{what}, in {unit}")
        return (-value if quantity.negated else value), found

    def _length(self, quantity: Quantity, where: str) -> float:
        value, unit = self._value(quantity, where, "m", "a length")
        if unit != "m" and not quantity.is_variable:
            self._fault(quantity.token, where, f"got {quantity.token}", "a length, in m")
        if abs(value) > LARGEST_M:
            self._fault(quantity.token, where, f"got {value:g} m", f"a length of at most {LARGEST_M:g} m")
        return value

    def _size(self, quantity: Quantity, where: str, what: str) -> float:
        value = self._length(quantity, where)
        if value < SMALLEST_M:
            self._fault(quantity.token, where, f"{what} is {value:g} m", f"at least {SMALLEST_M:g} m")
        return value

    def _angle(self, quantity: Quantity, where: str) -> float:
        value, unit = self._value(quantity, where, "rad", "an angle")
        if unit == "m" and not quantity.is_variable:
            self._fault(quantity.token, where, f"got {quantity.token}", "an angle, in rad or deg")
        if not quantity.is_variable and not quantity.unit and abs(value) > math.tau:
            right = f"{quantity.text} deg, or at most one turn"
            self._note(quantity.token, where, f"got {quantity.text}, which is in radians without a unit", right)
        if math.isinf(value):
            self._fault(quantity.token, where, f"got {quantity.token}", "a finite number")
            return math.nan
        return math.radians(value) if unit == "deg" else value

    # Shapes

    def _outline(self, section: PlanSection, given: Mapping[str, SectionPart]) -> Outline:
        """Corners in the section's own frame, of an opening as (x, z); empty where they can't be told."""
        where = f"{section.kind} {section.token}"
        if "shape" not in given:
            self._fault(section.token, where, "no 'shape'", "shape: Rectangle, Polygon or Circle")
            return ()
        shape: ShapeText = given["shape"].value
        if shape.points or str(shape.token) == "Polygon":
            return self._polygon(shape, where, upright=section.kind in ("Entryway", "Window"))
        sizes = {name: self._size(quantity, where, f"the {name}") for name, quantity in shape.sizes.items()}
        if "radius" in sizes:
            return circle(sizes["radius"])
        wanted, other = ("height", "length") if section.kind in ("Entryway", "Window") else ("length", "height")
        if other in sizes:
            right = f"width and {wanted}, for it {'stands upright' if wanted == 'height' else 'lies on the floor'}"
            self._fault(shape.token, where, f"got a Rectangle with {other}", right)
            return ()
        return rectangle(sizes["width"], sizes[wanted])

    def _polygon(self, shape: ShapeText, where: str, *, upright: bool) -> Outline:
        known_faults = len(self.faults)
        points = []
        for point in shape.points:
            numbers = [self._length(quantity, where) for quantity in point]
            across = numbers[1 if upright else 2] if len(numbers) == 3 else 0.0
            if across != 0.0 and not math.isnan(across):
                axis = "y" if upright else "z"
                self._fault(point[1 if upright else 2].token, where, f"got {axis} = {across:g} m", f"{axis} = 0")
            points.append((numbers[0], numbers[-1] if upright else numbers[1]))
        if len(points) > 1 and points[0] == points[-1]:
            del points[-1]
        outline = tuple(points)
        if len(self.faults) > known_faults:
            return ()
        if (wrong := outline_fault(outline)) is not None:
            self._fault(shape.token, where, *wrong)
            return ()
        return outline

    # Locations

    def _location(self, section: PlanSection, given: Mapping[str, SectionPart], where: str) -> dict[str, SectionPart]:
        """Return the parts of a section's location; a missing one is a fault."""
        if "location" not in given:
            needed = " and ".join(NEEDED_IN_A_LOCATION[section.kind])
            self._fault(section.token, where, "no 'location'", f"location: with {needed}")
            return {}
        found = self._once(given["location"].value, f"{where}: location", IN_A_LOCATION[section.kind])
        for key, right in NEEDED_IN_A_LOCATION[section.kind].items():
            if key not in found:
                self._fault(section.token, where, f"no {key!r} in its location", right)
        return found

    def _offset(self, kind: str, given: Mapping[str, SectionPart], where: str) -> Offset:
        """Translation and turn; of an opening, z for y and the turn about y."""
        along, about = MOVES[kind]
        moved_m = self._axes(given.get("translation"), f"{where}: translation", self._length)
        turned_rad = self._axes(given.get("rotation"), f"{where}: rotation", self._angle)
        self._zero(moved_m, along, f"{where}: translation", "m", f"moves along {' and '.join(along)}")
        self._zero(turned_rad, about, f"{where}: rotation", "rad", f"turns about {about}")
        first_m, second_m = (moved_m[axis][0] for axis in along)
        return Offset(first_m, second_m, turned_rad[about][0])

    def _axes(
        self, part: SectionPart | None, where: str, read: Callable[[Quantity, str], float]
    ) -> dict[str, tuple[float, Token | None]]:
        """Axis to its value and where it stands; 0 where nothing does."""
        found = self._once(part.value, where) if part is not None else {}
        return {
            axis: (read(found[axis].value, where.rpartition(": ")[0]), found[axis].token)
            if axis in found
            else (0.0, None)
            for axis in "xyz"
        }

    def _zero(
        self, values: Mapping[str, tuple[float, Token | None]], free: str, where: str, unit: str, does: str
    ) -> None:
        """Complain of a value on another axis than the `free` ones, unless it is 0."""
        for axis, (value, token) in values.items():
            if axis not in free and token is not None and value != 0.0 and not math.isnan(value):
                self._fault(token, where, f"got {axis}: {value:g} {unit}", f"{axis}: 0 or nothing, for it {does} only")

    def _frame(self, text: FrameText, where: str, this: str | None) -> PlanFrame:
        """The frame that is named; the world's in place of one that does not exist."""
        name = text.name
        if name == WORLD and text.wall is None:
            return PlanFrame(None, None, _place(text.token))
        if name == THIS:
            if this is None:
                self._fault(text.token, where, "got 'this'", "the name of a space; this is inside of none")
                return PlanFrame(None, None, _place(text.token))
            name = this
        if name not in self._corners:
            self._fault(text.token, where, f"no space {name!r}", did_you_mean(name, self._corners))
            return PlanFrame(None, None, _place(text.token))
        corners = self._corners[name]
        if corners is not None and text.wall is not None and text.wall >= corners:
            right = f"0 to {corners - 1}, for {name} has {corners} walls"
            self._fault(text.token, where, f"no wall {name}.walls[{text.wall}]", right)
        return PlanFrame(name, text.wall, _place(text.token))

    def _wrt(self, section: PlanSection, given: Mapping[str, SectionPart], where: str, this: str | None) -> PlanFrame:
        if "wrt" not in given:
            return PlanFrame(None, None, _place(section.token))
        return self._frame(given["wrt"].value, f"{where}: location", this)

    # Sections

    def _defaults(self) -> dict[str, SectionPart]:
        sections = self._text.defaults
        for section in sections[1:]:
            right = f"one; line {sections[0].token.line} has it"
            self._fault(section.token, "Defaults", "a second 'Defaults'", right)
        walls = next((walls for section in sections[:1] for walls in section.value), None)
        return self._once(walls.value, "Defaults: walls") if walls is not None else {}

    def _space(
        self, section: PlanSection, given: Mapping[str, SectionPart], outline: Outline, defaults: dict[str, SectionPart]
    ) -> PlanSpace:
        name = str(section.token)
        where = f"Space {name}"
        own = self._once(given["walls"].value, f"{where}: walls") if "walls" in given else {}
        values: dict[str, float] = {}
        for key in ("thickness", "height"):
            part = own.get(key) or defaults.get(key)
            if part is None:
                what = f"no {key} of its walls, of its own or by Defaults"
                self._fault(section.token, where, what, f"walls: {key}: ... here or in Defaults")
            values[key] = self._size(part.value, where, f"the walls' {key}") if part is not None else math.nan
        location = self._location(section, given, where)
        wrt = self._wrt(section, location, where, name)
        of_wall = self._of(section, location, where)
        offset = self._offset("Space", location, where)
        spaced, straight = location.get("spaced"), location.get("not aligned")
        if spaced is not None and wrt.space is None and "wrt" in location:
            self._fault(spaced.token, where, "got 'spaced' beside 'wrt: world'", "no 'spaced'; the world has no wall")
        elif spaced is not None and offset.y_m != 0.0:
            right = "one of the two: 'spaced' leaves room for both walls"
            self._fault(spaced.token, where, f"got 'spaced' and y: {offset.y_m:g} m", right)
        if straight is not None and offset.yaw_rad != 0.0:
            self._fault(straight.token, where, "got 'not aligned' and a rotation", "the rotation alone says it")
        if outline and signed_area(outline) > 0.0:
            what = "its corners run counter-clockwise, so its walls grow inwards"
            self._note(section.token, where, what, "corners in clockwise order for walls outside of the floor")
        return PlanSpace(
            name,
            outline,
            values["thickness"],
            values["height"],
            wrt,
            of_wall,
            offset,
            spaced is not None,
            straight is None,
            _place(section.token),
        )

    def _of(self, section: PlanSection, location: Mapping[str, SectionPart], where: str) -> int | None:
        name = str(section.token)
        if "of" not in location:
            return None
        text: FrameText = location["of"].value
        if text.name not in (THIS, name):
            right = f"this or this.walls[...]: it says which frame of {name} is placed"
            self._fault(text.token, f"{where}: location", f"got 'of: {text.token}'", right)
            return None
        return self._frame(text, f"{where}: location", name).wall

    def _features(self, sections: Iterable[PlanSection], space: str | None) -> list[Feature]:
        sections = list(sections)
        self._distinct("feature", (section.token for section in sections))
        return [self._feature(section, space) for section in sections]

    def _feature(self, section: PlanSection, space: str | None) -> Feature:
        where = f"{section.kind} {f'{space}.' if space else ''}{section.token}"
        given = self._once(section.parts, where)
        if "height" not in given:
            self._fault(section.token, where, "no 'height'", "height: ... m")
        height_m = self._size(given["height"].value, where, "the height") if "height" in given else math.nan
        location = self._location(section, given, where)
        wrt = self._wrt(section, location, where, space)
        if wrt.space is None and "wrt" in location and str(location["wrt"].value.token) == WORLD:
            right = "a space or one of its walls; a feature belongs to a room"
            self._fault(location["wrt"].value.token, where, "got 'wrt: world'", right)
        return Feature(
            "Column" if section.kind == "Column" else "Divider",
            str(section.token),
            space,
            self._outline(section, given),
            height_m,
            wrt,
            self._offset(section.kind, location, where),
            _place(section.token),
        )

    def _opening(self, section: PlanSection) -> Opening:
        where = f"{section.kind} {section.token}"
        given = self._once(section.parts, where)
        outline = self._outline(section, given)
        location = self._location(section, given, where)
        walls = self._walls(section, location, where)
        offset = self._offset(section.kind, location, where)
        return Opening(
            "Entryway" if section.kind == "Entryway" else "Window",
            str(section.token),
            walls,
            tuple(_upright(point, offset) for point in outline),
            _place(section.token),
        )

    def _walls(self, section: PlanSection, location: Mapping[str, SectionPart], where: str) -> tuple[PlanFrame, ...]:
        if "in" not in location:
            return ()
        texts: tuple[FrameText, ...] = location["in"].value
        if len(texts) > 2:
            self._fault(texts[2].token, where, f"got {len(texts)} walls", "one wall, or two with 'and'")
        for text in texts:
            if text.wall is None and text.name in (WORLD, *self._corners):
                right = (
                    "the wall of a space" if text.name == WORLD else f"one of its walls, such as {text.name}.walls[0]"
                )
                self._fault(text.token, where, f"got {text.name!r}", right)
        frames = tuple(self._frame(text, f"{where}: location", None) for text in texts)
        if len(set(frames)) < len(frames) and not self.faults:
            self._fault(texts[1].token, where, f"got {frames[1]} twice", "two walls, or one of them once")
        return frames


def _upright(point: tuple[float, float], offset: Offset) -> tuple[float, float]:
    """A point in the wall's x–z plane, turned about y and moved; `offset` has z for y."""
    (x, z), cos, sin = point, math.cos(offset.yaw_rad), math.sin(offset.yaw_rad)
    return round(offset.x_m + cos * x + sin * z, 9), round(offset.y_m - sin * x + cos * z, 9)


def _place(token: Token) -> tuple[int, int]:
    return token.line or 1, token.column or 1
