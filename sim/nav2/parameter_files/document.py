"""A Nav2 parameter document: every parameter of every node under its whole path, and where a file has it.

A file nests nodes, `ros__parameters` and groups; here a path leads to each value. ROS makes no difference between
`PathAlign.scale: 32.0` and `scale` below `PathAlign`, nor between the node `/a/b` and `b` below `a`, and neither do paths.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Final

import yaml
from yaml.constructor import ConstructorError, SafeConstructor
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, FileError, Got, Place, Problem
from vastflow.sim.model.files import MOST_LEVELS, TextPlace, Unreadable, place_of, read_text, yaml_node
from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.plug_ins.snapshot import Snapshot

PARAMETERS: Final = "ros__parameters"
ANY: Final = "*"
ANY_NUMBER: Final = "**"
"""Wildcards: one part of a node's full name, and any number of them."""

TAG: Final = "tag:yaml.org,2002:"
SUBSTITUTION: Final = "$("
"""Begins what a launch file replaces in a parameter file, as in `$(env SPEED 0.3)`."""
ENVIRONMENT: Final = re.compile(r"\$\((?:opt)?env +[^\s()]+ +'?([^()']*)'?\)")
EXPONENT: Final = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+")
_NUMBER: Final = re.compile(rf"{EXPONENT.pattern}|[-+]?0\d*[89]\d*|[-+]?(?i:inf|infinity)")
_FLAGS: Final[Mapping[str, bool]] = {"y": True, "Y": True, "n": False, "N": False}
"""Numbers and flags of ROS 2's parser, rcl_yaml_param_parser, that YAML 1.1 in Python takes for text."""
_CONSTRUCTOR: Final = SafeConstructor()
WHOLE_FILE: Final = "a whole Nav2 parameter file, 'node: {ros__parameters: {...}}'"


@dataclass(frozen=True)
class ParameterDocument:
    """Parameters and their places.

    Attributes:
        values: Path to text, number, flag, list or nothing.
        places: Place in a file of each path and of each part of one; items of lists have their number for a name.
        repeated: Paths that the file has more than once: of a parameter the last value counts, of a group all parameters.
        file: The file's name as the user gave it.
        robot: Namespace of the robot that counts.
        others: Nodes of other robots, which do not count, to their namespaces.
        controller: Name of the controller that a campaign chooses of the list, as if the behavior tree asked for it.
        plug_ins: Plug-ins named as `file.py:Class`, to the copies that are loaded; the others are read when they are loaded.
    """

    values: Mapping[ParameterLocation, Value]
    places: Mapping[ParameterLocation, TextPlace] = field(default_factory=dict)
    repeated: tuple[ParameterLocation, ...] = ()
    file: str = ""
    robot: ParameterLocation = ()
    others: Mapping[ParameterLocation, ParameterLocation] = field(default_factory=dict)
    controller: str = ""
    plug_ins: Mapping[str, Snapshot] = field(default_factory=dict)

    def place(self, path: ParameterLocation) -> TextPlace:
        """Place of a path, or of its nearest parent; (0, 0) without one."""
        return next((self.places[path[:n]] for n in range(len(path), -1, -1) if path[:n] in self.places), (0, 0))

    def below(self, prefix: ParameterLocation) -> Iterator[ParameterLocation]:
        return (path for path in self.values if path[: len(prefix)] == prefix)

    @cached_property
    def nodes(self) -> tuple[ParameterLocation, ...]:
        """Paths of the nodes' parameters, each with `ros__parameters` for its end."""
        nodes = dict.fromkeys(node_of(path) for path in (*self.values, *self.places) if PARAMETERS in path)
        return tuple(node for node in nodes if node not in self.others)

    def node(self, *name: str) -> ParameterLocation | None:
        """Path of a node's parameters in any namespace; the shallowest of several, or None."""
        found = [node for node in self.nodes if node[-len(name) - 1 : -1] == name]
        return min(found, key=len, default=None)


def node_of(path: ParameterLocation) -> ParameterLocation:
    """Path of the parameters of the node that a parameter is of."""
    return path[: path.index(PARAMETERS) + 1]


def is_wild(node: ParameterLocation) -> bool:
    return ANY in node or ANY_NUMBER in node


def dotted(path: ParameterLocation) -> str:
    """A path as RewrittenYaml writes it."""
    return ".".join(path)


def nearest_of(path: ParameterLocation, groups: Mapping[ParameterLocation, object]) -> ParameterLocation | None:
    """The longest path among `groups` that `path` is or is below of."""
    return next((path[:n] for n in range(len(path), 0, -1) if path[:n] in groups), None)


def read_document(path: str | Path) -> ParameterDocument:
    """Read a Nav2 parameter file.

    Raises:
        FileError: no such file, not YAML, several documents, not a mapping, no `ros__parameters`, values that are no parameters.
    """
    try:
        text = read_text(path, "a Nav2 parameter file")
    except Unreadable as error:
        raise _error(str(path), error.place, error.problem, error.expected) from None
    return parse(text, str(path))


def parse(text: str, file: str = "") -> ParameterDocument:
    """The document that `text` holds; raises `FileError` as `read_document` does."""
    try:
        root = yaml_node(text)
    except Unreadable as error:
        raise _error(file, error.place, error.problem, error.expected) from None
    if not isinstance(root, MappingNode):
        found = Got("an empty file") if root is None or root.value == "" else Got("no mapping")
        raise _error(file, place_of(root) if root else (1, 1), found)
    with suppress(yaml.YAMLError):  # what follows the first document
        events = (
            event for event in yaml.parse(text, Loader=yaml.CSafeLoader) if isinstance(event, yaml.DocumentStartEvent)
        )
        if second := next(islice(events, 1, None), None):
            raise _error(
                file,
                place_of(second),
                Got("a second YAML document"),
                "one document, as Nav2's launch files take no more",
            )
    walk = _Walk(file)
    walk.nodes(root, ())
    if walk.faults:
        raise FileError(walk.faults)
    if not any(PARAMETERS in path for path in walk.places):
        raise _error(file, (1, 1), f"the file has no {PARAMETERS}", f"expected {WHOLE_FILE}")
    return ParameterDocument(walk.values, walk.places, tuple(walk.repeated), file)


def _error(file: str, place: TextPlace, problem: Problem, expected: str = WHOLE_FILE) -> FileError:
    return FileError([Fault(Place(file, *place), problem, expected)])


def _unquoted(text: str) -> Value:
    """Return a number or flag of ROS 2's parser; numbers that no double holds stay text, as there."""
    if not _NUMBER.fullmatch(text):
        return _FLAGS.get(text, text)
    value = float(text)
    is_lost = value in (0.0, math.inf, -math.inf) and re.match(r"[-+]?[0.]*[1-9]", text)
    return text if is_lost else value


class _Walk:
    """One walk over a composed node graph; `nodes` of the root fills values, places and faults."""

    def __init__(self, file: str) -> None:
        self._file = file
        self.values: dict[ParameterLocation, Value] = {}
        self.places: dict[ParameterLocation, TextPlace] = {}
        self.repeated: list[ParameterLocation] = []
        self.faults: list[Fault] = []

    def nodes(self, mapping: MappingNode, above: ParameterLocation) -> None:
        """Names of nodes and namespaces, down to their parameters."""
        for key, value, merged in self._items(mapping, above):
            path = self._below(above, filter(None, key.value.split("/")), key)
            self.places.setdefault(path, place_of(key))
            if isinstance(value, MappingNode):
                if key.value == PARAMETERS:
                    self._group(value, path, merged)
                else:
                    self.nodes(value, path)
            elif self._scalar(value, path) is None:
                continue
            elif key.value == PARAMETERS:
                self._fault(value, path, Got("no mapping"), "parameters, 'name: value'")
            else:
                self._fault(value, path, f"this is outside of {PARAMETERS}", f"put it below '{PARAMETERS}:'")

    def _below(self, above: ParameterLocation, names: Iterable[str], key: Node) -> ParameterLocation:
        path = (*above, *names)
        if len(path) > MOST_LEVELS:
            raise _error(self._file, place_of(key), f"more than {MOST_LEVELS} levels deep", "use fewer levels")
        return path

    def _group(self, mapping: MappingNode, above: ParameterLocation, merged: bool) -> None:
        for key, value, brought in self._items(mapping, above):
            path = self._below(above, key.value.split("."), key)
            for n in range(len(above) + 1, len(path) + 1):
                self.places.setdefault(path[:n], place_of(key))
            if isinstance(value, MappingNode):
                self._group(value, path, merged or brought)
            elif path not in self.values or not (merged or brought):  # the file's own values precede an alias's
                if path in self.values:
                    self.repeated.append(path)
                self.places[path] = place_of(value if isinstance(value, ScalarNode) and value.value else key)
                self.values[path] = self._value(value, path)

    def _items(self, mapping: MappingNode, above: ParameterLocation) -> Iterator[tuple[ScalarNode, Node, bool]]:
        """Keys and values; those merged by `<<` come last and are marked."""
        sources: list[Node] = []
        opened: set[str] = set()
        for key, value in mapping.value:
            if isinstance(value, MappingNode) and isinstance(key, ScalarNode):
                if key.value in opened:
                    self.repeated.append((*above, *filter(None, key.value.split("." if PARAMETERS in above else "/"))))
                opened.add(key.value)
            if key.tag == f"{TAG}merge":
                sources += value.value if isinstance(value, SequenceNode) else [value]
            elif isinstance(key, ScalarNode) and key.value:
                yield key, value, False
            else:
                self._fault(key, above, Got("a list, a mapping or nothing as a name"), "a name")
        for source in sources:
            if isinstance(source, MappingNode):
                yield from ((name, item, True) for name, item, _ in self._items(source, above))
            else:
                self._fault(source, above, Got("another value to merge"), "an alias of a mapping")

    def _value(self, node: Node, path: ParameterLocation) -> Value:
        if not isinstance(node, SequenceNode):
            return self._scalar(node, path)
        items: list[Value] = []
        for k, item in enumerate(node.value):
            self.places[(*path, str(k))] = place_of(item)
            if isinstance(item, ScalarNode):
                items.append(self._scalar(item, path))
            else:
                self._fault(item, path, Got("a list or a mapping in a list"), "text, numbers or flags")
        return items

    def _scalar(self, node: Node, path: ParameterLocation) -> Value:
        if not isinstance(node, ScalarNode):
            return []
        if SUBSTITUTION in node.value and (text := ENVIRONMENT.sub(r"\1", node.value)) != node.value:
            plain = node if node.style else yaml_node(text)  # quoted text stays text
            node = ScalarNode(plain.tag if plain else node.tag, text, node.start_mark, node.end_mark, node.style)
        kind, text = str(node.tag).removeprefix(TAG), str(node.value)
        if kind in ("str", "timestamp", "value", "merge"):
            return text if node.style else _unquoted(text)
        if kind in ("null", "bool", "int", "float"):
            try:
                value: Value = getattr(_CONSTRUCTOR, f"construct_yaml_{kind}")(node)
                if isinstance(value, int) and value.bit_length() > 63:
                    return _unquoted(f"{value}e0")  # ROS 2 has no larger integers
                if not (isinstance(value, float) and math.isnan(value)):
                    return value
            except (ConstructorError, ValueError, KeyError, IndexError, OverflowError):
                pass
        what = Got(repr(text[:60])) if kind in ("bool", "int", "float") else Got(f"the tag {node.tag}")
        self._fault(node, path, what, "text, a number, or true or false")
        return None

    def _fault(self, node: Node, path: ParameterLocation, problem: Problem, expected: str) -> None:
        self.faults.append(Fault(Place(self._file, *place_of(node), dotted(path)), problem, expected))
