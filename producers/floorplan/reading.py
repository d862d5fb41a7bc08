"""The meaning of a floor plan's text, in meters and radians; every fault is found in one go."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final, NamedTuple

from lark import Token

from vastflow.producers.floorplan.geometry import (
    SMALLEST_M,
    Outline,
    Transform,
    circle,
    outline_fault,
    rectangle,
    signed_area,
)
from vastflow.producers.floorplan.plan import (
    WORLD,
    Feature,
    FeatureKind,
    FloorPlan,
    Opening,
    OpeningKind,
    PlanFrame,
    PlanSpace,
)
from vastflow.producers.floorplan.syntax import FrameText, Part, PlanText, Quantity
from vastflow.sim.model.elementary import cos_sin
from vastflow.sim.model.faults import Fault, FaultKind, FileError, Got, Place, Problem
from vastflow.sim.model.files import TextPlace
from vastflow.sim.model.names import did_you_mean

LARGEST_M: Final = 10_000.0
"""No length is greater: a building of that size is a slip, and its grid would fill the memory."""

THIS: Final = "this"


class _Rules(NamedTuple):
    """The rules of a location: optional and required parts, and the axes that accept offsets."""

    known: tuple[str, ...]
    needed: Mapping[str, str]
    along: str
    about: str


_FEATURE: Final = _Rules(
    ("wrt", "translation", "rotation"), {"wrt": "write 'wrt:' with this, this.walls[...] or another space"}, "xy", "z"
)
_OPENING: Final = _Rules(("in", "translation", "rotation"), {"in": "write 'in: space.walls[...]'"}, "xz", "y")
RULES: Final[Mapping[str, _Rules]] = {
    "Space": _Rules(
        ("wrt", "of", "translation", "rotation", "not aligned", "spaced"),
        {
            "wrt": "write 'wrt:' with world, another space or one of its walls",
            "of": "write 'of:' with this, or one of its walls",
        },
        "xy",
        "z",
    ),
    "Column": _FEATURE,
    "Divider": _FEATURE,
    "Entryway": _OPENING,
    "Window": _OPENING,
}


def plan_of(text: PlanText, drawn: Mapping[int, float] | None = None) -> FloorPlan:
    """The floor plan of a parsed text; raises a FileError of every fault in it.

    Args:
        drawn: Numbers that take the place of those in the text, by where these begin.
    """
    reader = _Reader(text, drawn or {})
    plan = reader.plan()
    if reader.faults:
        raise FileError(reader.faults)
    return plan


class _Section(NamedTuple):
    """A section with its parts by key, the parts of its location, and the space called `this`."""

    kind: str
    token: Token
    where: str
    parts: Mapping[str, Part]
    location: Mapping[str, Part]
    this: str | None


class _Reader:
    """A value that is wrong is NaN or a stand-in; with a fault, no plan leaves this module."""

    def __init__(self, text: PlanText, drawn: Mapping[int, float]) -> None:
        self.faults: list[Fault] = []
        self._notes: list[Fault] = []
        self._text = text
        self._drawn = drawn
        self._corners: dict[str, int | None] = {}
        self._variables: dict[str, tuple[float, str]] = {}
        self._distinct("variable", text.of("var"))
        for variable in text.of("var"):
            number: Quantity = variable.value
            if not number.unit:
                where = f"variable {variable.token}"
                self._fault(number.token, where, "the unit is missing", "add m for a length, rad or deg for an angle")
            self._variables.setdefault(str(variable.token), (self._number(number), number.unit or "m"))

    def plan(self) -> FloorPlan:
        text = self._text
        defaults = text.of("Defaults")
        for second in defaults[1:]:
            right = f"line {defaults[0].token.line} has it already"
            self._fault(second.token, "Defaults", "duplicate 'Defaults'", right)
        walls = self._parts(defaults[0].by_key.get("walls", ()), "Defaults: walls") if defaults else {}
        openings = text.of("Entryway", "Window")
        self._distinct("space", text.of("Space"))
        self._distinct("opening", openings)
        spaces = [self._section(each, str(each.token)) for each in text.of("Space")]
        if not spaces:
            self._fault(text.token, f"Floor plan {text.token}", "there is no space", "add a 'Space name:'")
        outlines = [self._outline(space) for space in spaces]
        for space, outline in zip(spaces, outlines, strict=True):
            self._corners.setdefault(str(space.token), len(outline) or None)
        read = tuple(self._space(space, outline, walls) for space, outline in zip(spaces, outlines, strict=True))
        features = [
            feature
            for space in spaces
            if "features" in space.parts
            for feature in self._features(space.parts["features"].value, space.this)
        ]
        features += self._features(text.of("Column", "Divider"), None)
        cut = tuple(self._opening(self._section(each, None)) for each in openings)
        return FloorPlan(str(text.token), text.file, read, tuple(features), cut, tuple(self._notes))

    def _fault(self, token: Token, where: str, what: Problem, right: str, kind: FaultKind = "error") -> None:
        found = Fault(Place(self._text.file, *_place(token), where), what, right, kind)
        (self.faults if kind == "error" else self._notes).append(found)

    def _distinct(self, kind: str, parts: Iterable[Part]) -> None:
        first: dict[str, Token] = {}
        for name in (part.token for part in parts):
            if first.setdefault(str(name), name) is not name:
                right = f"line {first[name].line} has it already"
                self._fault(name, f"{kind} {name}", f"duplicate {kind} {str(name)!r}", right)

    def _parts(self, parts: Iterable[Part], where: str, known: Sequence[str] | None = None) -> dict[str, Part]:
        """Parts by key: the first of each, unknown ones omitted."""
        found: dict[str, Part] = {}
        for part in parts:
            if known is not None and part.key not in known:
                self._fault(part.token, where, Got(repr(part.key)), " or ".join(known))
            elif part.key in found:
                right = f"line {found[part.key].token.line} has it already"
                self._fault(part.token, where, f"duplicate {part.key!r}", right)
            else:
                found[part.key] = part
        return found

    def _section(self, section: Part, this: str | None) -> _Section:
        inside = f"{this}." if this and section.key != "Space" else ""
        where = f"{section.key} {inside}{section.token}"
        parts, rules = self._parts(section.value, where), RULES[section.key]
        if "location" not in parts:
            right = f"add 'location:' with {' and '.join(rules.needed)}"
            self._fault(section.token, where, "'location' is missing", right)
            return _Section(section.key, section.token, where, parts, {}, this)
        location = self._parts(parts["location"].value, f"{where}: location", rules.known)
        for key, right in rules.needed.items():
            if key not in location:
                self._fault(section.token, where, f"{key!r} is missing in its location", right)
        return _Section(section.key, section.token, where, parts, location, this)

    # Numbers

    def _number(self, quantity: Quantity) -> float:
        drawn = self._drawn.get(quantity.span[0])
        return float(quantity.text) if drawn is None else drawn

    def _value(self, quantity: Quantity, where: str, unit: str, what: str) -> tuple[float, str]:
        token = quantity.token
        if not quantity.is_variable:
            return self._number(quantity), quantity.unit or unit
        if token not in self._variables:
            right = did_you_mean(str(token), self._variables, f"declare it by 'var {token} = ...'")
            self._fault(token, where, f"unknown variable {str(token)!r}", right)
            return math.nan, unit
        value, found = self._variables[token]
        if (found == "m") != (unit == "m"):
            self._fault(token, where, Got(f"variable {str(token)!r} in {found}"), f"{what}, in {unit}")
        return (-value if quantity.negated else value), found

    def _length(self, quantity: Quantity, where: str) -> float:
        value, unit = self._value(quantity, where, "m", "a length")
        if unit != "m" and not quantity.is_variable:
            self._fault(quantity.token, where, Got(quantity.token), "a length, in m")
        if abs(value) > LARGEST_M:
            self._fault(quantity.token, where, Got(f"{value:g} m"), f"a length of at most {LARGEST_M:g} m")
        return value

    def _size(self, quantity: Quantity, where: str, what: str) -> float:
        value = self._length(quantity, where)
        if value < SMALLEST_M:
            self._fault(quantity.token, where, f"{what} is {value:g} m", f"it must be at least {SMALLEST_M:g} m")
        return value

    def _angle(self, quantity: Quantity, where: str) -> float:
        value, unit = self._value(quantity, where, "rad", "an angle")
        if unit == "m" and not quantity.is_variable:
            self._fault(quantity.token, where, Got(quantity.token), "an angle, in rad or deg")
        if not quantity.is_variable and not quantity.unit and abs(value) > math.tau:
            what = f"without a unit, {quantity.text} is in radians and more than a turn"
            self._fault(quantity.token, where, what, f"did you mean '{quantity.text} deg'?", "warning")
        if math.isinf(value):
            self._fault(quantity.token, where, Got(quantity.token), "a finite number")
            return math.nan
        return math.radians(value) if unit == "deg" else value

    # Shapes

    def _outline(self, section: _Section) -> Outline:
        """Corners in the section's own frame, of an opening as (x, z); empty if unknown."""
        where, upright = section.where, RULES[section.kind] is _OPENING
        if "shape" not in section.parts:
            self._fault(section.token, where, "'shape' is missing", "add a Rectangle, Polygon or Circle")
            return ()
        shape: Part = section.parts["shape"].value
        if shape.key == "Polygon":
            return self._polygon(shape, where, upright)
        sizes = {name: self._size(quantity, where, f"the {name}") for name, quantity in shape.by_key.items()}
        if "radius" in sizes:
            return circle(sizes["radius"])
        wanted, other = ("height", "length") if upright else ("length", "height")
        if other in sizes:
            right = f"width and {wanted}, for it {'stands upright' if upright else 'lies on the floor'}"
            self._fault(shape.token, where, Got(f"a Rectangle with {other}"), right)
            return ()
        return rectangle(sizes["width"], sizes[wanted])

    def _polygon(self, shape: Part, where: str, upright: bool) -> Outline:
        known_faults, axis, k = len(self.faults), *(("y", 1) if upright else ("z", 2))
        points = []
        for point in shape.value:
            numbers = [self._length(quantity, where) for quantity in point]
            across = numbers[k] if len(numbers) == 3 else 0.0
            if across != 0.0 and not math.isnan(across):
                self._fault(point[k].token, where, Got(f"{axis} = {across:g} m"), f"{axis} = 0")
            points.append((numbers[0], numbers[-1] if upright else numbers[1]))
        if len(points) > 1 and points[0] == points[-1]:
            del points[-1]
        if len(self.faults) > known_faults:
            return ()
        if (wrong := outline_fault(tuple(points))) is not None:
            self._fault(shape.token, where, *wrong)
            return ()
        return tuple(points)

    # Locations

    def _offset(self, section: _Section) -> Transform:
        """Translation and turn; of an opening, z for y and the turn about y."""
        rules = RULES[section.kind]
        along, about = rules.along, rules.about
        moved_m = self._axes(section, "translation", self._length, along, "m", f"moves along {' and '.join(along)}")
        turned_rad = self._axes(section, "rotation", self._angle, about, "rad", f"turns about {about}")
        first_m, second_m = (moved_m.get(axis, 0.0) for axis in along)
        return Transform(first_m, second_m, turned_rad.get(about, 0.0))

    def _axes(
        self, section: _Section, key: str, read: Callable[[Quantity, str], float], free: str, unit: str, does: str
    ) -> dict[str, float]:
        """Value of each axis that is given; anything but 0 on another axis than the `free` ones is a fault."""
        where = f"{section.where}: {key}"
        given = self._parts(section.location[key].value, where) if key in section.location else {}
        values = {axis: read(part.value, section.where) for axis, part in given.items()}
        for axis, value in values.items():
            if axis not in free and value != 0.0 and not math.isnan(value):
                right = f"{axis}: 0 or nothing, as it {does} only"
                self._fault(given[axis].token, where, Got(f"{axis}: {value:g} {unit}"), right)
        return values

    def _frame(self, text: FrameText, section: _Section) -> PlanFrame:
        """The named frame, or the world's if it does not exist."""
        name, where, world = text.name, f"{section.where}: location", PlanFrame(None, None, _place(text.token))
        if name == WORLD and text.wall is None:
            return world
        if name == THIS:
            if section.this is None:
                self._fault(text.token, where, "'this' is inside of no space", "write the name of a space")
                return world
            name = section.this
        if name not in self._corners:
            self._fault(text.token, where, f"unknown space {name!r}", did_you_mean(name, self._corners))
            return world
        corners = self._corners[name]
        if corners is not None and text.wall is not None and text.wall >= corners:
            right = f"its walls are 0 to {corners - 1}"
            self._fault(text.token, where, f"there is no wall {name}.walls[{text.wall}]", right)
        return PlanFrame(name, text.wall, _place(text.token))

    def _wrt(self, section: _Section) -> PlanFrame:
        if "wrt" not in section.location:
            return PlanFrame(None, None, _place(section.token))
        return self._frame(section.location["wrt"].value, section)

    # Sections

    def _space(self, section: _Section, outline: Outline, defaults: Mapping[str, Part]) -> PlanSpace:
        name, where, location = str(section.token), section.where, section.location
        own = self._parts(section.parts["walls"].value, f"{where}: walls") if "walls" in section.parts else {}
        values: dict[str, float] = {}
        for key in ("thickness", "height"):
            part = own.get(key) or defaults.get(key)
            if part is None:
                what = f"the {key} of its walls is missing"
                self._fault(section.token, where, what, f"add 'walls: {key}: ...' here or in Defaults")
            values[key] = self._size(part.value, where, f"the walls' {key}") if part is not None else math.nan
        wrt, offset, of_wall = self._wrt(section), self._offset(section), None
        if "of" in location:
            text: FrameText = location["of"].value
            if text.name in (THIS, name):
                of_wall = self._frame(text, section).wall
            else:
                right = f"this or this.walls[...], the frame of {name} that is placed"
                self._fault(text.token, f"{where}: location", Got(f"'of: {text.token}'"), right)
        spaced, straight = location.get("spaced"), location.get("not aligned")
        if spaced is not None and wrt.space is None and "wrt" in location:
            self._fault(spaced.token, where, "'spaced' is relative to a wall", "the world has none")
        elif spaced is not None and offset.y_m != 0.0:
            right = "keep one of them, as 'spaced' leaves room for both walls"
            self._fault(spaced.token, where, f"there are 'spaced' and y: {offset.y_m:g} m", right)
        if straight is not None and offset.yaw_rad != 0.0:
            self._fault(straight.token, where, "there are 'not aligned' and a rotation", "keep the rotation alone")
        if outline and signed_area(outline) > 0.0:
            right = "list the corners in clockwise order for walls outside of the floor"
            what = "its corners run counter-clockwise, so its walls grow inwards"
            self._fault(section.token, where, what, right, "warning")
        thickness_m, height_m, place = values["thickness"], values["height"], _place(section.token)
        has = spaced is not None, straight is None
        return PlanSpace(name, outline, thickness_m, height_m, wrt, of_wall, offset, *has, place)

    def _features(self, parts: Sequence[Part], space: str | None) -> list[Feature]:
        self._distinct("feature", parts)
        return [self._feature(self._section(part, space)) for part in parts]

    def _feature(self, section: _Section) -> Feature:
        where, location, height_m = section.where, section.location, math.nan
        if "height" in section.parts:
            height_m = self._size(section.parts["height"].value, where, "the height")
        else:
            self._fault(section.token, where, "'height' is missing", "add 'height: ... m'")
        wrt, outline, offset = self._wrt(section), self._outline(section), self._offset(section)
        if wrt.space is None and "wrt" in location and str(location["wrt"].value.token) == WORLD:
            right = "a space or one of its walls"
            self._fault(location["wrt"].value.token, where, Got("'wrt: world'"), right)
        kind: FeatureKind = "Column" if section.kind == "Column" else "Divider"
        return Feature(kind, str(section.token), section.this, outline, height_m, wrt, offset)

    def _opening(self, section: _Section) -> Opening:
        outline, (x_m, z_m, turn_rad) = self._outline(section), self._offset(section)
        cos, sin = cos_sin(turn_rad)
        # Turned about y in the wall's x–z plane, z turns towards x.
        upright = tuple((round(x_m + cos * x + sin * z, 9), round(z_m - sin * x + cos * z, 9)) for x, z in outline)
        kind: OpeningKind = "Entryway" if section.kind == "Entryway" else "Window"
        return Opening(kind, str(section.token), self._walls(section), upright, _place(section.token))

    def _walls(self, section: _Section) -> tuple[PlanFrame, ...]:
        if "in" not in section.location:
            return ()
        where, texts = section.where, section.location["in"].value
        if len(texts) > 2:
            self._fault(texts[2].token, where, Got(f"{len(texts)} walls"), "one wall, or two with 'and'")
        for text in texts:
            if text.wall is None and text.name in (WORLD, *self._corners):
                walls = f"one of its walls, such as {text.name}.walls[0]"
                right = "the wall of a space" if text.name == WORLD else walls
                self._fault(text.token, where, Got(repr(text.name)), right)
        frames = tuple(self._frame(text, section) for text in texts)
        if len(set(frames)) < len(frames) and not self.faults:
            self._fault(texts[1].token, where, f"duplicate wall {frames[1]}", "name it once, or two walls")
        return frames


def _place(token: Token) -> TextPlace:
    return token.line or 1, token.column or 1
