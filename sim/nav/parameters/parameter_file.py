"""A Nav2 parameter file as a value of a scenario: known by what it means, not by where it lies or how it is written."""

import functools
from pathlib import Path
from typing import Final

from vastflow.sim.digest import FileContent, digest
from vastflow.sim.nav.parameters.document import (
    Document,
    DocumentError,
    ParameterFault,
    dotted,
    node_of,
    read_document,
)
from vastflow.sim.nav.parameters.interpretation import MODELLED_NODES, interpretation

FILE_KEY: Final = "nav2_params"
"""Key of the system dimension that has the file."""


def nav2_file(path: str | Path) -> FileContent:
    """A Nav2 parameter file as the value of `nav2_params`.

    Its digest is that of the parameters of the nodes that are modelled: comments, the order of keys, and nodes that the
    simulator has nothing of are not in it.

    Raises:
        DocumentError: the file can't be used.
    """
    document = read_document(path)
    interpretation(document)
    return file_value(document)


def file_value(document: Document) -> FileContent:
    """The same for a document that was read from a file and has no fault."""
    return FileContent(document.file, _content_digest(document))


@functools.lru_cache(maxsize=16)
def loaded(content: FileContent) -> Document:
    """The document of a file's value.

    Raises:
        DocumentError: the file is gone, or says something else than when the value was made.
    """
    document = read_document(content.path)
    if _content_digest(document) != content.digest:
        what = f"{content.path} changed since the campaign was read"
        raise DocumentError([ParameterFault(FILE_KEY, what, "run the campaign again")])
    return document


def _content_digest(document: Document) -> str:
    nodes = {node for node in document.nodes if not MODELLED_NODES.isdisjoint(node[-2:-1])}
    values = {dotted(path): value for path, value in document.values.items() if node_of(path) in nodes}
    return digest(sorted(map(dotted, nodes)), values)
