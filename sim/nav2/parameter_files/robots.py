"""Robots of a file: namespaces with nodes of their own, of which a campaign drives one."""

from dataclasses import replace
from typing import Final

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.nav2.parameter_files.document import ParameterDocument, is_wild
from vastflow.sim.nav2.parameter_files.nodes import NODES
from vastflow.sim.system.robot import NAMESPACE_KEY

NAMESPACE: Final[ParameterLocation] = tuple(NAMESPACE_KEY.split("."))

_NAMES: Final = [(*full[:-1], name) for full, node in NODES.items() for name in (full[-1], node.older) if name]


def robots_of(document: ParameterDocument) -> tuple[ParameterLocation, ...]:
    """Return the namespaces of the modeled nodes, outer ones first, then in the order of the file."""
    ends = [(node[:-1], name) for node in document.nodes if not is_wild(node) for name in _NAMES]
    found = dict.fromkeys(node[: -len(name)] for node, name in ends if node[-len(name) :] == name)
    return tuple(sorted(found, key=len))


def of_robot(document: ParameterDocument, namespace: Value = None) -> ParameterDocument:
    """Return the document with the nodes of one robot, which are what Nav2 started in its namespace reads.

    Args:
        namespace: The robot's; None for the first.

    Raises:
        FileError: the document has no robot of this namespace.
    """
    robots = robots_of(document)
    chosen = robots[0] if robots else ()
    if namespace is not None:
        chosen = tuple(filter(None, str(namespace).split("/")))
    if robots and chosen not in robots:
        what = f"the Nav2 parameters have no node in {namespace!r}"
        right = f"expected one of {', '.join(map(namespace_text, robots))}"
        raise FileError([Fault(Place("", 0, 0, NAMESPACE_KEY), what, right)])
    if len(robots) < 2:
        return document
    owners = {node: _robot(node, robots) for node in document.nodes}
    return replace(
        document, robot=chosen, others={node: own for node, own in owners.items() if own not in (chosen, None)}
    )


def _robot(node: ParameterLocation, robots: tuple[ParameterLocation, ...]) -> ParameterLocation | None:
    """Return the innermost robot that a node is below of; None for a wildcard."""
    of = (robot for robot in robots if node[: len(robot)] == robot and not is_wild(node))
    return max(of, key=len, default=None)


def namespace_text(namespace: ParameterLocation) -> str:
    return f"/{'/'.join(namespace)}"
