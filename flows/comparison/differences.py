"""What differs between two campaigns: parameters of systems and oracles by name, where the files have them, and the code."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from vastflow.oracles.directory.executed import KeptFiles
from vastflow.oracles.directory.tables import Tables
from vastflow.oracles.evidence.pairing import Pairing
from vastflow.producers.campaign_file.document import Document, read_document
from vastflow.sim.model.files import TextPlace
from vastflow.sim.nav2.parameter_files.document import PARAMETERS
from vastflow.sim.nav2.parameter_files.document import read_document as read_parameters
from vastflow.sim.nav2.parameter_files.parameter_file import FILE_KEY

_PAIRED: Final = ("environment", "task")
"""Dimensions of a scenario that are equal in every pair."""


@dataclass(frozen=True, slots=True)
class Given:
    """A value and its place in a file of the campaign directory, such as `campaign.vast:14`; both are empty where it is not given."""

    value: str = ""
    place: str = ""

    def __str__(self) -> str:
        return f"{self.value or 'not given'}{f' ({self.place})' if self.place else ''}"


@dataclass(frozen=True, slots=True)
class Difference:
    """A parameter whose value is not the same in baseline and candidate.

    Attributes:
        configurations: How many pairs of configurations it concerns; None for what concerns the whole campaign.
    """

    parameter: str
    before: Given
    after: Given
    configurations: int | None


def differences(before: Tables, after: Tables, pairing: Pairing) -> list[Difference]:
    """What differs, the parameters of paired configurations first."""
    then, now = _Side(before), _Side(after)
    counts: Counter[tuple[str, Given, Given]] = Counter()
    for match in pairing.matches:
        if match.how == "other system":
            counts.update(_unequal(then.given(match.before), now.given(match.after)))
    of_all = _unequal(then.of_all(pairing), now.of_all(pairing))
    return [*(Difference(*each, n) for each, n in counts.items()), *(Difference(*each, None) for each in of_all)]


def _unequal(before: Mapping[str, Given], after: Mapping[str, Given]) -> Iterator[tuple[str, Given, Given]]:
    for name in dict.fromkeys((*before, *after)):
        then, now = before.get(name, Given()), after.get(name, Given())
        if then.value != now.value:
            yield name, then, now


class _Side:
    """One of the campaigns, with the files that it keeps."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables
        self._files = KeptFiles(tables.directory)
        self._places = {name: k for k, name in enumerate(tables.configurations.names)}
        self._file: Document | None = None
        with suppress(ValueError, OSError):
            self._file = read_document(tables.directory / "campaign.vast")
        self._known: dict[str, dict[str, Given]] = {}

    def given(self, name: str) -> dict[str, Given]:
        """What a configuration's system is given, by the names of parameters."""
        content = self._tables.configurations.contents[self._places[name]]
        parts = {key: value for key, value in content.items() if key not in _PAIRED}
        system = parts.pop("system", None) or {}
        text = json.dumps([system, parts], sort_keys=True)
        if text not in self._known:
            found = dict(self._parameters(system.get(FILE_KEY)))
            found |= {key: self._placed(key, value) for key, value in _flat({**system, **parts}) if key not in found}
            if any(PARAMETERS in key for key in found):
                del found[f"{FILE_KEY}.file"]  # its parameters say more than its digest
            self._known[text] = found
        return self._known[text]

    def of_all(self, pairing: Pairing) -> dict[str, Given]:
        """What concerns all runs: the oracles that judged both, the versions, and the code of each stage."""
        said = self._tables.metadata
        oracles = {each["name"]: each.get("parameters") or {} for each in said.get("oracles", [])}
        versions = {**{key: said[key] for key in ("vastflow",) if key in said}, **said.get("versions", {})}
        code = {f"code of {stage}": digest[:12] for stage, digest in said.get("source", {}).items()}
        listed = {f"oracle {name}": oracles[name] for name in pairing.oracles if name in oracles}
        return {key: Given(_text(value)) for key, value in _flat({**listed, **versions, **code})}

    def _parameters(self, file: Any) -> Iterator[tuple[str, Given]]:
        with suppress(ValueError, OSError, KeyError, TypeError):
            path = self._files.path(file["file"])
            document = read_parameters(path)
            for location, value in document.values.items():
                line, _ = document.place(location)
                yield ".".join(location), Given(_text(value), f"{path.relative_to(self._tables.directory)}:{line}")

    def _placed(self, key: str, value: Any) -> Given:
        """A value with the line at which the campaign file has it, or has its name."""
        lines = [] if self._file is None else list(_named(self._file, key, value))
        return Given(_text(value), f"campaign.vast:{min(lines)[1][0]}" if lines else "")


def _named(document: Document, key: str, value: Any) -> Iterator[tuple[bool, TextPlace]]:
    """Whether it is another value, and where, of each place at which a file has a parameter or a list of its values."""
    *_, name = key.split(".")
    for location, place in document.values.items():
        if location and (location[-1] == name or document.value(location) == name):
            yield document.value(location) != value, place


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}" if name else str(key))
    elif name:
        yield name, value


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
