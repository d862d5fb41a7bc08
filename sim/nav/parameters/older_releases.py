"""Nodes and lists as older releases of Nav2 call them: read under today's name where they mean the same, else refused."""

from collections.abc import Mapping
from typing import Final

from vastflow.sim.nav.parameters.document import ParameterDocument, ParameterLocation
from vastflow.sim.nav.parameters.reader import Reader

_RENAMED: Final[Mapping[str, str]] = {"behavior_server": "recoveries_server"}
"""Nodes to what Galactic and the releases before it call them."""

OLDER_NAMES: Final = frozenset(_RENAMED.values())
"""Of nodes that are read."""

_NODES_BEFORE_FOXY: Final[Mapping[str, str]] = {
    "dwb_controller": "controller_server",
    "navfn_planner": "planner_server",
}
"""Nodes of Dashing to those that have their plug-ins since."""

_LISTS_BEFORE_FOXY: Final[Mapping[str, str]] = {
    "plugin_names": "plugins",
    "controller_plugin_ids": "controller_plugins",
    "planner_plugin_ids": "planner_plugins",
}
"""Lists of names, with the classes in a list beside them, to the lists that name groups with a `plugin` each."""


def node_of_any_release(document: ParameterDocument, name: tuple[str, ...]) -> ParameterLocation | None:
    """Where the parameters of a node are, under today's name or else an older one; None without either."""
    return document.node(*name) or document.node(*name[:-1], _RENAMED.get(name[-1], name[-1]))


def refuse_releases_before_foxy(reader: Reader) -> None:
    """Without today's nodes and lists, the stack would be Nav2's default one in place of what such a file says."""
    document = reader.document
    for old, new in _NODES_BEFORE_FOXY.items():
        if (node := document.node(old)) and document.node(new) is None:
            reader.fault(node[:-1], "found a node of Nav2 Dashing's", f"{new} with a list of plug-ins, as since Foxy")
    for path in document.values:
        new = _LISTS_BEFORE_FOXY.get(path[-1], "")
        if new and (*path[:-1], new) not in document.values:
            right = f"'{new}', and 'plugin: package::Class' below each name, as since Foxy"
            reader.fault(path, "found a list of Nav2 Eloquent's, which has the classes in another list", right)
