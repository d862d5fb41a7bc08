"""Findings: for each parameter of a file, whether it is modeled, and what is done where it is not."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from vastflow.sim.model.digest import Value
from vastflow.sim.model.files import TextPlace
from vastflow.sim.model.names import SLIP, nearest
from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.nav2.parameter_files.built_in import ANY, IN_EVERY_NODE, TABLES, UNUSED_NODES, nav2_names
from vastflow.sim.nav2.parameter_files.document import PARAMETERS, ParameterDocument, node_of
from vastflow.sim.nav2.parameter_files.interpretation import Interpretation
from vastflow.sim.nav2.parameter_files.reader import Reader

Status: TypeAlias = Literal["modeled", "built in", "no effect", "differs", "not modeled"]


@dataclass(frozen=True, slots=True)
class Finding:
    """Status of one parameter of a file.

    Attributes:
        path: Where the file has it, `place` as line and column.
        value: What the file says.
        status: `modeled`: it is used. `built in`: it says what is done anyway. `no effect`: it makes no difference to
            missions. `differs`: something else is done. `not modeled`: nothing is done.
        used: The value the simulator has, a range in words; None without one.
        why: Why it is not used; may be empty.
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
    """Parameters that nothing knows, each with the one beside it that the file lacks and that is spelled almost so."""
    document, reader = found.document, found.reader
    known = nav2_names()
    for each in findings(found):
        node, name = each.path[:-1], each.path[-1]
        if each.status != "not modeled" or each.why or name in known:
            continue
        beside = {*TABLES.get(reader.kinds.get(node, "".join(node[-2:-1])), {})}
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


def _finding(reader: Reader, document: ParameterDocument, path: ParameterLocation) -> Finding:
    value, place = document.values[path], document.place(path)

    def found(status: Status, why: str = "", used: Value = None, about: ParameterLocation = path) -> Finding:
        return Finding(path, place, value, status, used, why, about)

    if path in reader.asked and path not in reader.unmodeled:
        used = reader.asked[path]
        return found("modeled", used=list(used) if isinstance(used, tuple) else used)
    if group := _nearest(path, reader.unused):
        return found("no effect", reader.unused[group], about=group)
    if group := _nearest(path, reader.unmodeled):
        return found("not modeled", reader.unmodeled[group], about=group)
    node = node_of(path)
    node_name = "".join(node[-2:-1])
    if node_name in UNUSED_NODES:
        return found("no effect", UNUSED_NODES[node_name], about=node)
    group = _nearest(path[:-1], reader.kinds)  # a group that has a value of its own is none
    kind = reader.kinds[group] if group else node_name
    name, table = path[len(group or node) :], TABLES.get(kind, {})
    rule = table.get(".".join(name)) or table.get(f"{name[0]}.*") or IN_EVERY_NODE.get(name[-1])
    if rule is not None:
        if not rule.agrees(value):
            return found("differs", used=rule.value)
        return found("no effect") if rule == ANY else found("built in", used=value)
    plugin = (*(group or node), name[0])
    if len(name) > 1 and _is_unlisted(document, plugin):
        return found("no effect", "no list of plug-ins has it", about=plugin)
    if group is None and kind not in TABLES:
        return found("not modeled", "nothing of this node is", about=node)
    return found("not modeled")


def _is_unlisted(document: ParameterDocument, plugin: ParameterLocation) -> bool:
    """Whether this is a plug-in, or an area of the collision monitor, that no list beside it names."""
    beside = [value for path, value in document.values.items() if path[:-1] == plugin[:-1]]
    lists = [value for value in beside if isinstance(value, Sequence)]
    is_one = any((*plugin, name) in document.values for name in ("plugin", "action_type"))
    return is_one and not any(plugin[-1] in names for names in lists)


def _nearest(path: ParameterLocation, groups: Mapping[ParameterLocation, str]) -> ParameterLocation | None:
    """The longest path among `groups` that `path` is or is below of."""
    return next((path[:n] for n in range(len(path), 0, -1) if path[:n] in groups), None)
