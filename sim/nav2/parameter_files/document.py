"""A Nav2 parameter document: every parameter of every node under its whole path, and where a file has it.

A file nests nodes, `ros__parameters` and groups; here a path leads to each value. ROS makes no difference between
`PathAlign.scale: 32.0` and `scale` below `PathAlign`, nor between the node `/a/b` and `b` below `a`, and neither do paths.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

from yaml.constructor import ConstructorError, SafeConstructor
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import UserError, complaint
from vastflow.sim.model.files import MOST_LEVELS, TextPlace, Unreadable, place_of, read_text, yaml_node
from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.plug_ins.snapshot import Snapshot

PARAMETERS: Final = "ros__parameters"

TAG: Final = "tag:yaml.org,2002:"
EXPONENT: Final = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+")
WHOLE_FILE: Final = "a whole Nav2 parameter file, 'node: {ros__parameters: {...}}'"


@dataclass(frozen=True, slots=True)
class ParameterFault:
    """A mistake in a document.

    Attributes:
        where: The parameter, dotted; `file` for the whole.
        what: What was found.
        right: What would be right.
        place: Where in the file; (0, 0) for what is in none.
        together: Whether each value is right on its own, and only together they are not.
    """

    where: str
    what: str
    right: str
    place: TextPlace = (0, 0)
    together: bool = False

    def __str__(self) -> str:
        return f"{self.where}: {complaint(self.what, self.right)}"


class DocumentError(UserError, ValueError):
    """A document the stack can't be set to; holds every fault that was found."""

    def __init__(self, faults: Iterable[ParameterFault], file: str = "") -> None:
        self.faults = tuple(faults)
        self.file = file
        super().__init__(self.faults, file)  # as arguments, so that it can be pickled

    def __str__(self) -> str:
        return "\n".join(
            f"{self.file}:{fault.place[0]}:{fault.place[1]}: {fault}" if fault.place[0] else str(fault)
            for fault in self.faults
        )


@dataclass(frozen=True)
class ParameterDocument:
    """Parameters and their places.

    Attributes:
        values: Path to text, number, flag, list or nothing.
        places: Where a file has a path or a part of one; items of lists have their number for a name.
        repeated: Paths that the file has more than once; the last value counts.
        file: The file's name as the user gave it.
        plug_ins: Those that it names as `file.py:Class`, to the copies that are loaded; the others are read when they are.
    """

    values: Mapping[ParameterLocation, Value]
    places: Mapping[ParameterLocation, TextPlace] = field(default_factory=dict)
    repeated: tuple[ParameterLocation, ...] = ()
    file: str = ""
    plug_ins: Mapping[str, Snapshot] = field(default_factory=dict)

    def place(self, path: ParameterLocation) -> TextPlace:
        """Place of a path, or of the nearest thing above it; (0, 0) where there is none."""
        return next((self.places[path[:n]] for n in range(len(path), -1, -1) if path[:n] in self.places), (0, 0))

    def below(self, prefix: ParameterLocation) -> Iterator[ParameterLocation]:
        """Paths of the parameters below `prefix`."""
        return (path for path in self.values if path[: len(prefix)] == prefix)

    @cached_property
    def nodes(self) -> tuple[ParameterLocation, ...]:
        """Paths of the nodes' parameters, each with `ros__parameters` for its end."""
        return tuple(dict.fromkeys(node_of(path) for path in (*self.values, *self.places) if PARAMETERS in path))

    def node(self, *name: str) -> ParameterLocation | None:
        """Path of the parameters of a node, in whatever namespace; the least deep of several, None without one."""
        found = [node for node in self.nodes if node[-len(name) - 1 : -1] == name]
        return min(found, key=len, default=None)


def node_of(path: ParameterLocation) -> ParameterLocation:
    """Path of the parameters of the node that a parameter is of."""
    return path[: path.index(PARAMETERS) + 1]


def dotted(path: ParameterLocation) -> str:
    """A path as RewrittenYaml writes it."""
    return ".".join(path)


def read_document(path: str | Path) -> ParameterDocument:
    """Read a Nav2 parameter file; of several YAML documents in it the first.

    Raises:
        DocumentError: no such file, not YAML, not a mapping, no `ros__parameters`, values that are no parameters.
    """
    file = str(path)
    try:
        return parse(read_text(path, "a Nav2 parameter file"), file)
    except Unreadable as error:
        raise _unreadable(error, file) from None


def parse(text: str, file: str = "") -> ParameterDocument:
    """The document that `text` holds; for `file` see `ParameterDocument`.

    Raises:
        DocumentError: as of `read_document`.
    """
    try:
        root = yaml_node(text)
    except Unreadable as error:
        raise _unreadable(error, file) from None
    if not isinstance(root, MappingNode):
        found = "got an empty file" if root is None or root.value == "" else "got no mapping"
        raise DocumentError([ParameterFault("file", found, WHOLE_FILE, place_of(root) if root else (1, 1))], file)
    walk = _Walk(file)
    walk.nodes(root, ())
    if not walk.faults and not any(PARAMETERS in path for path in walk.places):
        walk.faults.append(ParameterFault("file", f"no {PARAMETERS} anywhere", WHOLE_FILE, (1, 1)))
    if walk.faults:
        raise DocumentError(sorted(walk.faults, key=lambda fault: fault.place), file)
    return ParameterDocument(walk.values, walk.places, tuple(walk.repeated), file)


def _unreadable(error: Unreadable, file: str) -> DocumentError:
    return DocumentError([ParameterFault("file", error.what, error.right, error.place)], file)


class _Walk:
    """One walk over a composed node graph; `nodes` of the root fills values, places and faults."""

    def __init__(self, file: str) -> None:
        self._file = file
        self.values: dict[ParameterLocation, Value] = {}
        self.places: dict[ParameterLocation, TextPlace] = {}
        self.repeated: list[ParameterLocation] = []
        self.faults: list[ParameterFault] = []
        self._constructor = SafeConstructor()

    def nodes(self, mapping: MappingNode, above: ParameterLocation) -> None:
        """Names of nodes and namespaces, down to their parameters."""
        for key, value, merged in self._items(mapping, above):
            path = self._below(above, filter(None, key.value.split("/")), key)
            self.places.setdefault(path, place_of(key))
            if key.value == PARAMETERS:
                self._parameters(value, path, merged)
            elif isinstance(value, MappingNode):
                self.nodes(value, path)
            elif self._scalar(value, path) is not None:
                self._fault(value, path, f"a value outside of {PARAMETERS}", f"parameters below '{PARAMETERS}:'")

    def _below(self, above: ParameterLocation, names: Iterable[str], key: Node) -> ParameterLocation:
        path = (*above, *names)
        if len(path) > MOST_LEVELS:
            fault = ParameterFault("file", f"more than {MOST_LEVELS} levels deep", "fewer levels", place_of(key))
            raise DocumentError([fault], self._file)
        return path

    def _parameters(self, node: Node, path: ParameterLocation, merged: bool) -> None:
        if isinstance(node, MappingNode):
            self._group(node, path, merged)
        elif self._scalar(node, path) is not None:
            self._fault(node, path, "got no mapping", "parameters, 'name: value'")

    def _group(self, mapping: MappingNode, above: ParameterLocation, merged: bool) -> None:
        for key, value, brought in self._items(mapping, above):
            path = self._below(above, key.value.split("."), key)
            for n in range(len(above) + 1, len(path) + 1):
                self.places.setdefault(path[:n], place_of(key))
            if isinstance(value, MappingNode):
                self._group(value, path, merged or brought)
            else:
                self._enter(path, value, key, merged or brought)

    def _enter(self, path: ParameterLocation, value: Node, key: Node, merged: bool) -> None:
        if path in self.values:
            if merged:  # what stands in the file itself counts before what an alias brings
                return
            self.repeated.append(path)
        self.places[path] = place_of(value if isinstance(value, ScalarNode) and value.value else key)
        self.values[path] = self._value(value, path)

    def _items(self, mapping: MappingNode, above: ParameterLocation) -> Iterator[tuple[ScalarNode, Node, bool]]:
        """Keys and values, those that `<<` brings last and marked."""
        for key, value in mapping.value:
            if isinstance(key, ScalarNode) and key.tag != f"{TAG}merge" and key.value:
                yield key, value, False
            elif key.tag != f"{TAG}merge":
                self._fault(key, above, "got a list, a mapping or nothing as a name", "a name")
        for key, value in mapping.value:
            for source in self._merged(key, value, above):
                yield from ((name, item, True) for name, item, _ in self._items(source, above))

    def _merged(self, key: Node, value: Node, above: ParameterLocation) -> Iterator[MappingNode]:
        if key.tag != f"{TAG}merge":
            return
        for source in value.value if isinstance(value, SequenceNode) else [value]:
            if isinstance(source, MappingNode):
                yield source
            else:
                self._fault(value, above, "got no mapping to merge", "an alias of another mapping")

    def _value(self, node: Node, path: ParameterLocation) -> Value:
        if isinstance(node, ScalarNode):
            return self._scalar(node, path)
        items: list[Value] = []
        if isinstance(node, SequenceNode):
            for k, item in enumerate(node.value):
                self.places[(*path, str(k))] = place_of(item)
                if isinstance(item, ScalarNode):
                    items.append(self._scalar(item, path))
                else:
                    self._fault(item, path, "got a list or a mapping in a list", "text, numbers or flags")
        return items

    def _scalar(self, node: Node, path: ParameterLocation) -> Value:
        if not isinstance(node, ScalarNode):
            return []
        kind, text = str(node.tag).removeprefix(TAG), str(node.value)
        if kind in ("str", "timestamp", "value", "merge"):
            return float(text) if not node.style and EXPONENT.fullmatch(text) else text
        if kind == "null":
            return None
        try:
            if kind == "bool":
                return bool(self._constructor.construct_yaml_bool(node))
            if kind == "int":
                return int(self._constructor.construct_yaml_int(node))
            if kind == "float" and not math.isnan(number := float(self._constructor.construct_yaml_float(node))):
                return number
        except (ConstructorError, ValueError, KeyError, IndexError, OverflowError):
            pass
        what = f"got {text[:60]!r}" if kind in ("bool", "int", "float") else f"got the tag {node.tag}"
        self._fault(node, path, what, "text, a number, or true or false")
        return None

    def _fault(self, node: Node, path: ParameterLocation, what: str, right: str) -> None:
        self.faults.append(ParameterFault(dotted(path) or "file", what, right, place_of(node)))
