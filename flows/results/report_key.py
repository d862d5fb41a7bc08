"""The key of a report: all that the tables, the figures and the report of a campaign follow from."""

import hashlib
import importlib.metadata
import inspect
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from vastflow.flows.request.asked import SEARCH, SEQUENTIAL
from vastflow.flows.request.members import Runs
from vastflow.oracles.oracle import Oracle
from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.sim.model.digest import FileContent
from vastflow.tasks.keys import Keys
from vastflow.tasks.source import SourceTree, folders_of

REPORT_SOURCE: Final = ("vastflow.flows.results.results", "vastflow.oracles.page.report")
"""What writes a campaign directory, and what makes a report of it."""

_PACKAGES: Final = ("vastflow.flows.request", "vastflow.flows.results")
"""What of the flows they import."""
_DATA: Final = "vastflow.oracles"
_PAGE: Final = (".css", ".j2", ".js")
"""Package with the report's template, and how the names of its files end."""
REPORT_LIBRARIES: Final = ("jinja2", "markupsafe", "matplotlib")


def written_by() -> tuple[Path, ...]:
    """Folders with the code and the templates that make tables and reports."""
    return tuple(folders_of((*_PACKAGES, _DATA)).values())


def report_key(
    keys: Keys,
    tree: SourceTree,
    campaign: bytes,
    metadata: Mapping[str, Any],
    instantiation: Instantiation,
    contents: Iterable[Sequence[Any]],
    runs: Runs,
    oracles: Sequence[Oracle[Any]],
) -> str:
    """Key under which the store has the report of a campaign without faults.

    Args:
        campaign: The campaign file.
        metadata: What `metadata.json` says; of it what is the same for every call with these results.
        contents: Of each configuration that is no duplicate, in order: the keys of its verdicts, which follow from its scenario,
            its recordings and the oracles' code and parameters, and what is in them.
        runs: Of each configuration; `metadata` has the rule, where they ended by one.
        oracles: Those that judged, in order. The report has their docstrings, which are in no digest of their code.
    """
    hashed = hashlib.sha256()
    same = {name: metadata[name] for name in ("name", "vastflow", "versions", "notes", "robots")}
    same["selection"] = [metadata.get("asked", {}).get("only"), instantiation.sampled_from]
    if SEQUENTIAL in metadata:
        same[SEQUENTIAL] = metadata[SEQUENTIAL]
    if SEARCH in metadata:
        same[SEARCH] = metadata[SEARCH]
    libraries = {name: importlib.metadata.version(name) for name in REPORT_LIBRARIES}
    said = [[oracle.name, inspect.getdoc(type(oracle))] for oracle in oracles]
    for part in (
        [same, libraries, hashlib.sha256(campaign).hexdigest(), runs, said],
        *(
            (c.name, c.family, c.scenario.digest, c.duplicate_of, c.factors, c.provenance)
            for c in instantiation.configurations
        ),
        *([(s.producer, s.keys, s.choice) for s in c.steps] for c in instantiation.configurations),
        *((r.family, r.parent, r.producer, r.reason, r.requested, r.inputs) for r in instantiation.rejections),
        *((e.family, e.name, e.constraint, e.values) for e in instantiation.excluded),
        instantiation.coverage,
        *contents,
    ):
        hashed.update(_text(part).encode() + b"\n")
    source = [tree.with_packages(*_PACKAGES).digest(*REPORT_SOURCE), tree.data_digest(_DATA, _PAGE)]
    return keys.report(source, hashed.hexdigest())


def _plain(value: object) -> Any:
    if isinstance(value, FileContent):
        return {"file": value.digest}
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Sequence):
        return list(value)
    raise TypeError(f"{type(value).__name__} is no value of a configuration")


_text: Final = json.JSONEncoder(separators=(",", ":"), default=_plain).encode
