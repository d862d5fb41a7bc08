"""The content of a document: all that its digest has, and all that the reader sees."""

from collections.abc import Collection
from dataclasses import replace
from typing import Final

from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.nav2.parameter_files.command_chain import STAMPED
from vastflow.sim.nav2.parameter_files.costmaps import is_info_server, is_mask_topic
from vastflow.sim.nav2.parameter_files.document import PARAMETERS, ParameterDocument, is_wild, node_of
from vastflow.sim.nav2.parameter_files.frames import FRAME
from vastflow.sim.nav2.parameter_files.nodes import NODES
from vastflow.sim.nav2.parameter_files.releases import newer_names
from vastflow.sim.nav2.parameter_files.trees import NAVIGATOR, is_users_tree

_MODELED: Final = frozenset(name for full, node in NODES.items() for name in (full[-1], node.older) if name)


def read_nodes(document: ParameterDocument) -> Collection[ParameterLocation]:
    """Return the nodes of which every parameter is content: those that are modeled, and info servers."""
    return {node for node in document.nodes if not _MODELED.isdisjoint(node[-2:-1]) or is_info_server(document, node)}


def content_of(document: ParameterDocument) -> ParameterDocument:
    """Return the document without the parameters that make no other robot.

    The reader gets no other one: a parameter that is not in the digest can't be read by mistake.
    """
    nodes = read_nodes(document)

    def is_content(path: ParameterLocation) -> bool:
        if PARAMETERS not in path or (node := node_of(path)) in nodes:
            return True
        if node in document.others:
            return False
        if node[-2:-1] == (NAVIGATOR,):
            names, value = newer_names(), document.values[path]
            in_odom = path[-1] == FRAME and str(value).endswith("odom")
            return in_odom or not names.isdisjoint(path) or str(value) in names or is_users_tree(path[-1], value)
        return is_mask_topic(path) or (path[-1] == STAMPED and is_wild(path))

    return replace(document, values={path: value for path, value in document.values.items() if is_content(path)})
