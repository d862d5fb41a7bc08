"""A Nav2 parameter file as a value of a scenario: known by what it means, not by where it lies or how it is written."""

import functools
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from vastflow.sim.digest import FileContent, Value, digest
from vastflow.sim.files import is_file
from vastflow.sim.nav.controllers.registry import FILE, controller_file
from vastflow.sim.nav.parameters.document import (
    DocumentError,
    ParameterDocument,
    ParameterFault,
    dotted,
    node_of,
)
from vastflow.sim.nav.parameters.filters import is_info_server
from vastflow.sim.nav.parameters.interpretation import MODELED_NODES, interpretation
from vastflow.sim.nav.parameters.wildcards import read_nav2_document
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.snapshot import Snapshot, snapshot_of

FILE_KEY: Final = "nav2_params"
"""Key of the system dimension that has the file."""


@dataclass(frozen=True, slots=True)
class ParameterFile(FileContent):
    """A parameter file with controllers of its author's, as they were when it was read.

    Attributes:
        plug_ins: `file.py:Class` as the file names it, to the copy that is run.
    """

    plug_ins: Mapping[str, Snapshot] = field(compare=False, default_factory=dict)


def nav2_file(path: str | Path) -> FileContent:
    """A Nav2 parameter file as the value of `nav2_params`.

    Its digest is that of the parameters of the nodes that are modeled, and of the plug-ins that it names: comments, the order
    of keys, and nodes that the simulator has nothing of are not in it.

    Raises:
        DocumentError: the file can't be used.
    """
    document = frozen(read_nav2_document(path))
    interpretation(document)
    return file_value(document)


def frozen(document: ParameterDocument) -> ParameterDocument:
    """The document with copies of the plug-ins that it names, which are what is run; those that can't be copied are left out."""
    node = document.node("controller_server") or ()
    base = Path(document.file).parent
    plug_ins: dict[str, Snapshot] = {}
    for path in document.below(node):
        name = document.values[path]
        if (
            path[-1] == "plugin"
            and isinstance(name, str)
            and FILE in name
            and is_file(file := controller_file(name, base))
        ):
            with suppress(PlugInError):  # it is one of the faults of the document
                plug_ins[name] = snapshot_of(file, base)
    return replace(document, plug_ins=plug_ins)


def file_value(document: ParameterDocument) -> FileContent:
    """The same for a document that was read from a file, frozen, and has no fault."""
    digest = _content_digest(document)
    return (
        ParameterFile(document.file, digest, document.plug_ins)
        if document.plug_ins
        else FileContent(document.file, digest)
    )


def plug_ins_in(values: Value) -> tuple[ParameterFile, ...]:
    """The parameter files with plug-ins among values, once each."""
    if isinstance(values, ParameterFile):
        return (values,)
    if isinstance(values, str | FileContent) or not isinstance(values, Mapping | Sequence):
        return ()
    items = values.values() if isinstance(values, Mapping) else values
    return tuple(dict.fromkeys(each for item in items for each in plug_ins_in(item)))


@functools.lru_cache(maxsize=16)
def loaded(content: FileContent) -> ParameterDocument:
    """The document of a file's value.

    Raises:
        DocumentError: the file is gone, or says something else than when the value was made.
    """
    document = read_nav2_document(content.path)
    kept = content.plug_ins if isinstance(content, ParameterFile) else None
    document = frozen(document) if kept is None else replace(document, plug_ins=kept)
    if _content_digest(document) != content.digest:
        what = f"{content.path} changed since the campaign was read"
        raise DocumentError([ParameterFault(FILE_KEY, what, "run the campaign again")])
    return document


def _content_digest(document: ParameterDocument) -> str:
    nodes = {
        node for node in document.nodes if not MODELED_NODES.isdisjoint(node[-2:-1]) or is_info_server(document, node)
    }
    values = {dotted(path): value for path, value in document.values.items() if node_of(path) in nodes}
    plug_ins = {name: snapshot.digest for name, snapshot in document.plug_ins.items()}
    return digest(sorted(map(dotted, nodes)), values, *filter(None, [plug_ins]))
