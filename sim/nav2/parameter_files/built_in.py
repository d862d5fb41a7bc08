"""Built-in behavior: parameters that no file changes here, with the values that ask for what is done anyway."""

import functools
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Final

from vastflow.sim.model.digest import Value
from vastflow.sim.nav2.parameter_files.nodes import class_name


@dataclass(frozen=True, slots=True)
class BuiltIn:
    """Behavior of the simulator that no file changes.

    Attributes:
        values: Values that mean just that; the first is what a file would say. Without any, every value does.
        low, high: Range of numbers that mean the same, in place of `values`; beside `low` there may be `values`, too.
        includes: Names that a list must have, in place of `values`.
        prefixed: Whether text before one of the `values` makes no difference, as the robot's name before a frame.
        why: Behavior in place of any of these values, none of which has an effect; may be empty.
    """

    values: tuple[Value, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    includes: tuple[str, ...] = ()
    prefixed: bool = False
    why: str = ""

    def agrees(self, value: Value) -> bool:
        """Whether `value` requests the behavior that the simulator has anyway."""
        if self.prefixed:
            return isinstance(value, str) and value.endswith(tuple(map(str, self.values)))
        if any(_equal(value, own) for own in self.values):
            return True
        if self.values and self.low == -math.inf:
            return False
        if self.includes:
            return isinstance(value, Sequence) and set(self.includes) <= set(map(str, value))
        if self == ANY:
            return True
        return isinstance(value, int | float) and not isinstance(value, bool) and self.low <= value <= self.high

    @property
    def value(self) -> Value:
        """The value that a file would have, or the range in words."""
        if self.values and self.low == -math.inf:
            return list(own) if isinstance(own := self.values[0], tuple) else own
        if self.includes:
            return list(self.includes)
        return f"{self.low:g} or more" if math.isfinite(self.low) else f"{self.high:g} or less"


ANY: Final = BuiltIn()


def _equal(value: Value, own: Value) -> bool:
    if isinstance(value, str) and isinstance(own, str):
        # Of a file's name the folder does not matter.
        return class_name(value) == class_name(own) or (bool(own) and value.endswith(f"/{own}"))
    if isinstance(value, bool) or isinstance(own, bool):
        return value is own
    if isinstance(value, Sequence) and isinstance(own, Sequence):
        return list(value) == list(own)
    return value == own


_RULE: Final = re.compile(r"([\w.*]+)(?:(<=|>=|=|@|~)(.*))?")
_WHY: Final = {
    "bt_loop_duration": "trees are ticked every 50 ms",
    "source_timeout": "no scan of a lidar of 2 Hz or more is that old",
}


@functools.cache
def built_in() -> Mapping[str, Mapping[str, BuiltIn]]:
    """Return the rules of each kind of node, plug-in, or group by parameter, see `built_in.txt`."""
    found: dict[str, dict[str, BuiltIn]] = {}
    text = (files("vastflow.sim.nav2.parameter_files") / "built_in.txt").read_text("utf-8")
    lines = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    for entry in lines.replace("\n  ", " ").splitlines():
        kinds, _, rest = entry.partition(": ")
        for kind in kinds.split(", "):
            found.setdefault(kind, {}).update(map(_rule, rest.split()))
    return found


def _rule(text: str) -> tuple[str, BuiltIn]:
    match = _RULE.fullmatch(text)
    assert match is not None, text
    name, sign, given = match.groups()
    values = [json.loads(each) for each in given.split("|")] if sign else []
    rule = ANY
    if sign in ("<=", ">="):
        rule = BuiltIn(high=values[0]) if sign == "<=" else BuiltIn(tuple(values[1:]), low=values[0])
    elif sign == "@":
        rule = BuiltIn(includes=tuple(values[0]))
    elif sign:
        rule = BuiltIn(tuple(values), prefixed=sign == "~")
    return name, replace(rule, why=_WHY[name]) if name in _WHY else rule
