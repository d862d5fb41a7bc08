"""A Nav2 parameter file as a scenario's value: wildcards resolved, identified by its meaning, not its path."""

import functools
import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

from vastflow.sim.model.digest import FileContent, Value, digest
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.sim.model.files import TextPlace, is_file
from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.nav2.parameter_files.content import content_of, read_nodes
from vastflow.sim.nav2.parameter_files.document import (
    ANY,
    ANY_NUMBER,
    PARAMETERS,
    ParameterDocument,
    dotted,
    is_wild,
    node_of,
    read_document,
)
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.nodes import NODES
from vastflow.sim.nav2.parameter_files.robots import robots_of
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.registry import FILE, plug_in_file
from vastflow.sim.plug_ins.snapshot import PlugInFile, Snapshot, snapshot_of
from vastflow.sim.system.keys import FILE_KEY

_SOME_NAMESPACE: Final = ""
"""A node without a namespace in the file may be started in one, whose name no file says."""


def read_nav2_document(path: str | Path) -> ParameterDocument:
    """Read a Nav2 parameter file with its wildcards resolved; raises `FileError` as `read_document` does."""
    return resolved(read_document(path))


def resolved(document: ParameterDocument) -> ParameterDocument:
    """Expand wildcards: give their parameters to the matching nodes, with places in the file.

    Of several values for one parameter the file's last counts, as since Humble, be it a wildcard's or the node's own. A
    wildcard speaks of a node by its name, or by a parameter that nodes of this name have; one that speaks of none stays as it is.
    """
    wild = [node for node in document.nodes if is_wild(node)]
    if not wild:
        return document
    spoken_of = {node: [*_targets(document, node)] for node in wild}

    def moved(path: ParameterLocation) -> Sequence[ParameterLocation]:
        """Places in the resolved document of a path or a part of one."""
        node = node_of(path) if PARAMETERS in path else path
        return [(*target, *path[len(node) :]) for target in spoken_of.get(node, ())] or [path]

    places: dict[ParameterLocation, TextPlace] = {}
    for path, place in document.places.items():
        for to in moved(path):
            places[to] = place if to not in places or path in document.values else places[to]
    values = {to: value for path, value in document.values.items() for to in moved(path)}
    return replace(document, values=values, places=places)


def _targets(document: ParameterDocument, wild: ParameterLocation) -> Iterator[ParameterLocation]:
    """Paths of the nodes that match a wildcard: those of each robot, else below the wildcard's namespace."""
    pattern = wild[:-1]
    heads = {path[len(wild)] for path in document.below(wild)}
    above = pattern[: next(k for k, part in enumerate(pattern) if part in (ANY, ANY_NUMBER))]
    robots = robots_of(document)
    for name, modeled in NODES.items():
        if heads.isdisjoint(modeled.names) and pattern[-1] != name[-1]:
            continue
        own = [node for node in document.nodes if not is_wild(node) and node[-len(name) - 1 : -1] == name]
        in_any = _matches(pattern, (_SOME_NAMESPACE, *name))
        for node in own:
            if _matches(pattern, node[:-1]) or (in_any and node[:-1] == name):
                yield node
        for robot in dict.fromkeys([*robots, *([above] if not own and (above or not robots) else [])]):
            node = (*robot, *name, PARAMETERS)
            if node not in own and (_matches(pattern, node[:-1]) or (in_any and not robot)):
                yield node


def _matches(pattern: ParameterLocation, name: ParameterLocation) -> bool:
    """Whether a pattern matches a node's full name: `*` is one part of it, `**` any number."""
    if not pattern:
        return not name
    if pattern[0] == ANY_NUMBER:
        return any(_matches(pattern[1:], name[k:]) for k in range(len(name) + 1))
    return bool(name) and pattern[0] in (ANY, name[0]) and _matches(pattern[1:], name[1:])


def nav2_file(path: str | Path) -> FileContent:
    """A Nav2 parameter file as the value of `nav2_params`.

    Its digest is that of its content (see `content_of`), of the plug-ins that it names, and of the order of several
    robots: comments, the order of other keys, and nodes that the simulator has nothing of are not in it.

    Raises:
        FileError: the file can't be used.
    """
    document = frozen(read_nav2_document(path))
    interpretation(document)
    return file_value(document)


def frozen(document: ParameterDocument, within: Path | None = None) -> ParameterDocument:
    """Return the document with the copies of its plug-ins that are run; omit plug-ins that can't be copied.

    Args:
        within: Folder that all of them must lie in; None for any.
    """
    base = Path(document.file).parent
    plug_ins: dict[str, Snapshot] = {}
    for path, name in document.values.items():
        is_own = path[-1] in ("plugin", "primary_controller") and isinstance(name, str) and FILE in name
        if not is_own or (within and not _lies_in(within, plug_in_file(str(name), base))):
            continue
        if is_file(file := plug_in_file(str(name), base)):
            with suppress(PlugInError):  # it is one of the faults of the document
                plug_ins[str(name)] = snapshot_of(file, base)
    return replace(document, plug_ins=plug_ins)


def _lies_in(folder: Path, file: Path) -> bool:
    """Whether a file lies below a folder, as it is named, before that is followed, and without links."""
    return all(Path(path(file)).is_relative_to(path(folder)) for path in (os.path.abspath, os.path.realpath))


def file_value(document: ParameterDocument) -> FileContent:
    """The same for a document that was read from a file, frozen, and has no fault."""
    digest = _content_digest(document)
    return (
        PlugInFile(document.file, digest, document.plug_ins)
        if document.plug_ins
        else FileContent(document.file, digest)
    )


@functools.lru_cache(maxsize=16)
def loaded(content: FileContent) -> ParameterDocument:
    """The document of a file's value.

    Raises:
        FileError: the file is gone, or says something else than when the value was made.
    """
    document = read_nav2_document(content.path)
    kept = content.plug_ins if isinstance(content, PlugInFile) else None
    document = frozen(document) if kept is None else replace(document, plug_ins=kept)
    if _content_digest(document) != content.digest:
        what = f"{content.path} changed since the campaign was read"
        raise FileError([Fault(Place("", 0, 0, FILE_KEY), what, "run the campaign again")])
    return document


def _content_digest(document: ParameterDocument) -> str:
    values = {dotted(path): value for path, value in content_of(document).values.items()}
    plug_ins = {name: snapshot.digest for name, snapshot in document.plug_ins.items()}
    robots = robots_of(document)  # without a namespace of the campaign's the first counts
    wild = [path for path in content_of(document).values if is_wild(path)]  # the last counts
    more: list[Value] = [plug_ins] if plug_ins else []
    ordered = [order for order in (robots, wild) if len(order) > 1]
    return digest(sorted(map(dotted, read_nodes(document))), values, *more, *ordered)
