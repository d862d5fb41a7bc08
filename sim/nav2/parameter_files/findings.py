"""Findings: for each parameter of a file, whether it is modeled, and the behavior otherwise.

What the simulator does in place of a parameter has the values of Nav2 Jazzy's default file, or of Nav2's code where the file leaves
them out. A parameter that is in no table here is not modeled.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, TypeAlias

from vastflow.sim.model.digest import Value
from vastflow.sim.model.files import TextPlace
from vastflow.sim.model.names import SLIP, nearest
from vastflow.sim.model.parameter import ParameterGroup, ParameterLocation
from vastflow.sim.nav2.parameter_files.built_in import ANY, built_in
from vastflow.sim.nav2.parameter_files.declared import Declared, declared_defaults
from vastflow.sim.nav2.parameter_files.document import PARAMETERS, ParameterDocument, dotted, nearest_of, node_of
from vastflow.sim.nav2.parameter_files.interpretation import Interpretation
from vastflow.sim.nav2.parameter_files.reader import Reader

Status: TypeAlias = Literal["modeled", "built in", "no effect", "differs", "not modeled"]


@dataclass(frozen=True, slots=True)
class Finding:
    """Status of one parameter of a file.

    Attributes:
        path: Path of the parameter in the file; `place` is its line and column.
        value: Value in the file.
        status: `modeled`: it is used. `built in`: it says what is done anyway. `no effect`: it makes no difference to
            missions. `differs`: something else is done. `not modeled`: nothing is done.
        used: The value the simulator has, a range in words; None without one.
        why: Why it is not used, or what is done instead; may be empty.
        about: The parameter, or a group with nothing in it that is modeled, which can be spoken of once.
    """

    path: ParameterLocation
    place: TextPlace
    value: Value
    status: Status
    used: Value
    why: str
    about: ParameterLocation


def findings(found: Interpretation) -> tuple[Finding, ...]:
    """A finding for each parameter of a document, in the order of the file."""
    document, reader = found.document, found.reader
    return tuple(
        _finding(reader, document, path)
        for path in sorted(document.values, key=document.place)
        if document.values[path] is not None  # `GridBased:` with nothing below it
    )


def slips(found: Interpretation) -> Iterator[tuple[Finding, str]]:
    """Unknown parameters, each with the missing sibling of the most similar spelling."""
    document, reader = found.document, found.reader
    known = nav2_names()
    for each in findings(found):
        node, name = each.path[:-1], each.path[-1]
        if each.status != "not modeled" or each.why or name in known:
            continue
        beside = {*built_in().get(reader.kinds.get(node, "".join(node[-2:-1])), {})}
        beside |= {path[-1] for path in reader.asked if path[:-1] == node}
        lacking = {
            other for other in beside if (*node, other) not in document.values and abs(len(other) - len(name)) < 2
        }
        if near := nearest(name, lacking, SLIP):
            yield each, near


def left_out(found: Interpretation) -> Mapping[ParameterLocation, Value]:
    """The modeled parameters that a document's nodes do not give, with what Nav2's code takes for them."""
    reader, values = found.reader, found.document.values
    return {path: reader.asked[path] for path in reader.fields if PARAMETERS in path and path not in values}


class Omitted(NamedTuple):
    """A parameter that a document leaves out, with another value in Nav2's code than elsewhere.

    Attributes:
        declared: Declaration in Nav2's code: the default, and its place.
        other: Value of Nav2 Jazzy's file, or the one that is built in.
        is_used: Whether the simulator has Nav2's.
    """

    path: ParameterLocation
    declared: Declared
    other: Value
    is_used: bool


def omitted(found: Interpretation) -> tuple[Omitted, ...]:
    """The parameters that a document leaves out and that Nav2's code does not have as Jazzy's file or the simulator."""
    reader, values = found.reader, found.document.values
    rows = [Omitted(path, *each, True) for path, each in reader.omitted.items() if not nearest_of(path, reader.unused)]
    for node, kind in reader.kinds.items():
        declared = declared_defaults().get(kind, {})
        for name in declared.keys() & built_in().get(kind, {}).keys():
            rule, path, default = built_in()[kind][name], (*node, *name.split(".")), declared[name].default
            if default is not None and path not in (values.keys() | reader.asked.keys()) and not rule.agrees(default):
                rows.append(Omitted(path, declared[name], rule.value, False))
    return tuple(sorted(rows))


_SINCE: Final = "0.2"
_READ_AS_JAZZY: Final = frozenset({"angular_disengage_threshold", "max_obstacle_height", "regenerate_noises", "scale"})
"""Parameters that before `_SINCE` had other defaults than Nav2's code, beside those of nodes that a file lacks."""


def defaults_row(found: Interpretation) -> dict[str, dict[str, Value]]:
    """Return for `metadata.json` the defaults that count for a file, and since which version those that had been others."""
    row: dict[str, dict[str, Value]] = {}
    for path, declared, _, is_used in omitted(found):
        is_new = path[-1] in _READ_AS_JAZZY or node_of(path) not in found.document.nodes
        if is_used:
            row[dotted(path)] = {"value": declared.default, "since": _SINCE if is_new else ""}
    return row


def _finding(reader: Reader, document: ParameterDocument, path: ParameterLocation) -> Finding:
    value, place = document.values[path], document.place(path)

    def found(status: Status, why: str = "", used: Value = None, about: ParameterLocation = path) -> Finding:
        return Finding(path, place, value, status, used, why, about)

    if path in reader.held:
        return found("differs", f"runs at {reader.held[path]:g} Hz, in whole ticks of 50 ms", reader.held[path])
    if path in reader.bounded and path in reader.asked:
        return found("differs", f"{reader.bounded[path]:g} is used, where the modeled range ends", reader.bounded[path])
    if path in reader.asked and path not in reader.unmodeled:
        used = reader.asked[path]
        return found("modeled", used=list(used) if isinstance(used, tuple) else used)
    if group := nearest_of(path, reader.unused):
        return found("no effect", reader.unused[group], about=group)
    if group := nearest_of(path, reader.unmodeled):
        return found("not modeled", reader.unmodeled[group], about=group)
    node = node_of(path)
    node_name = "".join(node[-2:-1])
    if node_name in UNUSED_NODES:
        return found("no effect", UNUSED_NODES[node_name], about=node)
    group = nearest_of(path[:-1], reader.kinds)  # a group that has a value of its own is none
    kind = reader.kinds[group] if group else node_name
    name, table = path[len(group or node) :], built_in().get(kind, {})
    rule = table.get(".".join(name)) or table.get(f"{name[0]}.*") or built_in()["every node"].get(name[-1])
    if rule is not None:
        if not rule.agrees(value):
            return found("differs", used=rule.value)
        return found("no effect", rule.why) if rule == ANY or rule.why else found("built in", used=value)
    plugin = (*(group or node), name[0])
    if len(name) > 1 and _is_unlisted(document, plugin):
        return found("no effect", "no list of plug-ins has it", about=plugin)
    if kind.endswith("_costmap") and node not in reader.kinds:
        return found("not modeled", f"Nav2's node is {kind}/{kind}, one level deeper", about=node)
    if group is None and kind not in built_in():
        return found("not modeled", "nothing of this node is", about=node)
    return found("not modeled")


def _is_unlisted(document: ParameterDocument, plugin: ParameterLocation) -> bool:
    """Whether this is a plug-in, or an area of the collision monitor, that its list does not name."""
    beside = [value for path, value in document.values.items() if path[:-1] == plugin[:-1]]
    lists = [value for value in beside if isinstance(value, Sequence)]
    is_one = any((*plugin, name) in document.values for name in ("plugin", "action_type"))
    return is_one and not any(plugin[-1] in names for names in lists)


def nav2_names() -> frozenset[str]:
    """Last names of all parameters that are modeled or listed here, of any node or plug-in."""
    groups = [ParameterGroup]
    for group in groups:
        groups += group.__subclasses__()
    tabled = (name.removesuffix(".*").rpartition(".")[2] for table in built_in().values() for name in table)
    return frozenset([*tabled, *(name for group in groups for name in group.model_fields)])


UNUSED_NODES: Final[Mapping[str, str]] = {
    "map_server": "the campaign gives the map",
    **dict.fromkeys(
        ("filter_mask_server", "keepout_filter_mask_server", "speed_filter_mask_server"),
        "the campaign gives the mask: keepout_mask, speed_mask",
    ),
    "map_saver": "no mission calls it",
    "smoother_server": "the default behavior trees do not call it",
    "docking_server": "no mission calls it",
    "route_server": "no mission calls it",
    "loopback_simulator": "another simulator",
}
"""Nodes that have no effect on the missions, and why."""
