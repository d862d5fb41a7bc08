"""Facts about a robot in words, each with its source."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

_PARTS: Final[Mapping[str, str]] = {
    "body": "footprint",
    "drive": "drive",
    "mass": "mass",
    **dict.fromkeys(("speed up to", "acceleration up to", "yaw rate up to", "yaw acceleration up to"), "limits"),
    **dict.fromkeys(("lidar mounted at x", "lidar mounted at y", "lidar turned by", "with", "from"), "lidar"),
    **dict.fromkeys(("ranges above", "ranges below", "scans at"), "lidar"),
}
"""Quantities of `RobotFact` to the words of `robot_summary`."""

Source: TypeAlias = Literal["given", "from the Nav2 parameters", "a TurtleBot 4's", "assumed", "no real robot's"]


@dataclass(frozen=True, slots=True)
class RobotFact:
    """A quantity of the robot in words, and where its value is from."""

    quantity: str
    value: str
    source: Source

    def __str__(self) -> str:
        return f"{self.quantity} {self.value}"


def robot_words(facts: Iterable[RobotFact]) -> Iterator[str]:
    """Yield a sentence for the facts of each source, assumptions last."""
    facts = tuple(facts)
    starts: tuple[tuple[Source, str], ...] = (
        ("given", "the robot"),
        ("from the Nav2 parameters", "the robot, from the Nav2 parameters"),
        ("a TurtleBot 4's", "assumed, as a TurtleBot 4 has it"),
        ("assumed", "assumed, as angles of its own are given"),
        ("no real robot's", "assumed, as no real robot has it"),
    )
    for source, start in starts:
        if said := [str(fact) for fact in facts if fact.source == source]:
            yield f"{start}: {', '.join(said)}"


def robot_summary(facts: Iterable[RobotFact], nav2: str) -> str:
    """Return whose robot it is in one line; `nav2` says which Nav2 parameters are read, and of which file."""
    parts: dict[str, list[str]] = {"given": [], "from the Nav2 parameters": [], "a TurtleBot 4's": []}
    for fact in facts:
        if fact.quantity in _PARTS and fact.source in parts and _PARTS[fact.quantity] not in parts[fact.source]:
            parts[fact.source].append(_PARTS[fact.quantity])
    given, derived, assumed = parts.values()
    assumed = [f"the rest of the {part}" if part in [*given, *derived] else part for part in assumed]
    is_one = len(assumed) == 1 and assumed != ["limits"]
    ends = ("{} as described", "{}", f"{{}} of a TurtleBot 4 {'is' if is_one else 'are'} assumed")
    lists = (given, [*derived, nav2], assumed)
    return "; ".join(end.format(_listed(each)) for end, each in zip(ends, lists, strict=True) if each)


def _listed(words: Sequence[str]) -> str:
    *most, last = words
    return f"{', '.join(most)}{',' * (len(most) > 1)} and {last}" if most else last
