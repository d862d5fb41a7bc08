"""Nav2's releases: which one a file is for, and what newer ones do otherwise than Jazzy's 1.3.12, which is simulated."""

import functools
from collections.abc import Collection, Iterator, Mapping
from importlib.resources import files
from typing import Any, Final, NamedTuple

from vastflow.sim.model.files import yaml_value
from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.nav2.parameter_files.document import PARAMETERS, ParameterDocument, node_of
from vastflow.sim.nav2.parameter_files.nodes import NODES
from vastflow.sim.nav2.parameter_files.trees import NAVIGATOR
from vastflow.sim.system.keys import RELEASE_KEY, RELEASES, Release

RELEASE: Final[ParameterLocation] = (RELEASE_KEY,)


class Change(NamedTuple):
    """A behavior that a release has and the simulator has not; see `releases.yaml`."""

    since: Release
    kind: str
    words: str
    here: str
    source: str


@functools.cache
def _table() -> Mapping[str, Any]:
    table: Mapping[str, Any] = yaml_value(
        (files("vastflow.sim.nav2.parameter_files") / "releases.yaml").read_text("utf-8")
    )
    return table


@functools.cache
def newer_names() -> frozenset[str]:
    """Return the names, and the words for values, that Jazzy has not."""
    return frozenset(name for names in _table()["names"].values() for name in names)


def guessed_release(document: ParameterDocument) -> tuple[Release, str]:
    """Return the release that a file is for, and a name in it that no older one has."""
    own = {name for full, node in NODES.items() for name in (full[-1], node.older)} | {NAVIGATOR}
    values = {
        path: value
        for path, value in document.values.items()
        if PARAMETERS in path and "".join(node_of(path)[-2:-1]) in own and node_of(path) not in document.others
    }
    names = [*(name for path in values for name in path), *(str(value) for value in values.values())]
    for release, new in _table()["names"].items():
        if found := next((name for name in names if name in new), None):
            return release, found
    return RELEASES[0], ""


def release_of(document: ParameterDocument) -> Release:
    """Return the release that a campaign says, else the one that the file is for."""
    said = document.values.get(RELEASE)
    return next((each for each in RELEASES if each == said), guessed_release(document)[0])


def changes_since_jazzy(document: ParameterDocument, kinds: Collection[str]) -> Iterator[Change]:
    """Yield what the release of a document does otherwise, of nodes and plug-ins of these kinds."""
    releases = RELEASES[: RELEASES.index(release_of(document)) + 1]
    for change in (Change(**row) for row in _table()["changes"]):
        if change.since in releases and any(kind.endswith(change.kind) for kind in kinds):
            yield change
