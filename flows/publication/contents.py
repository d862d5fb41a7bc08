"""The content of a publication: files of a campaign directory by parts, and inputs that are public, private, or opaque."""

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import Any, Final

from vastflow.flows.results.tables import KeptLogs
from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.unusable import reading
from vastflow.sim.model.digest import file_digest
from vastflow.sim.model.faults import UserError, message_of
from vastflow.sim.model.files import MOST_BYTES, files_below, open_file, read_text, yaml_value
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.world.readers.registry import files_of_world
from vastflow.sim.world.world import world_content

PARTS: Final[Mapping[str, str]] = {
    "tables": "Configurations, runs, verdicts, and evidence",
    "inputs": "Files that the campaign file names, under their own names",
    "environments": "Maps by digest; those of floor plans with mesh and plan",
    "recordings": "What happened in each run, a file for each configuration",
    "traces": "What oracles read: aligned signals in SI units, a file for each configuration",
    "outputs": "What programs of runs wrote, an archive for each configuration",
    "figures": "Pictures of the report as SVG, PNG, and MP4",
    "logs": "Logs of runs and of the campaign",
    "postprocessing": "What postprocessing steps wrote",
}
"""Part, which is a folder except for tables, to its content."""
TOP_FILES: Final[Mapping[str, str]] = {
    "campaign.vast": "What was asked, as YAML",
    "metadata.json": "Versions, numeric class, host, parameters of oracles and producers, counts, faults",
    "configurations.parquet": "A row for each configuration: its scenario, factors, and digests",
    "runs.parquet": "A row for each run: seed, outcome, simulated time, distance, contacts",
    "verdicts.parquet": "A row for each run and oracle: judgment, reason, and metrics",
    "runs_wide.parquet": "Runs, factors, verdicts, and metrics in one table",
    "behaviors.parquet": "Status changes of the scenario's behaviors in each run",
    "rejections.parquet": "Instances that could not be built, with reasons",
    "exclusions.parquet": "Instances that constraints exclude",
    "coverage.json": "How much of the requested space was realized",
    "evidence.json": "Rates with intervals, by oracle, family, and configuration",
    "events.jsonl": "What happened while the campaign ran",
    "report.html": "The report",
    "prov.json": "PROV of every artifact: what follows from what, with digests and keys",
    "ro-crate-metadata.json": "This description for programs (RO-Crate 1.2, Process Run Crate)",
    "README.md": "The data card",
}
"""Single file of the campaign directory or the archive to its content."""
CAMPAIGN: Final = "campaign/"
"""Place of the campaign directory in the payload."""
KINDS: Final = ("private", "opaque", "public")
"""Kinds of inputs, the most careful first."""
_TABLES: Final = frozenset({".parquet", ".json", ".jsonl", ".vast"})
_KNOWN: Final = (b"\x89PNG\r\n", b"P2", b"P5", b"BM", b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"\x93NUMPY", b"PAR1")
"""Beginnings of pictures, arrays, and tables; any other binary file may be a program."""
_STL_HEAD, _STL_TRIANGLE = 84, 50
_INTERPRETERS: Final = re.compile(r"python[0-9.]*|bash|sh|env")
"""Programs of public source that execute an input."""


@dataclass(frozen=True, slots=True)
class Input:
    """A place below `inputs/`, a container image, or a program; `reason` says why it is opaque."""

    name: str
    kind: str
    reason: str = ""


@dataclass(frozen=True)
class Contents:
    """Published files of a campaign directory.

    Attributes:
        parts: Part to place below the directory to size in bytes.
        left_out: Part, file, or folder that is not published to the reason.
        withheld: Places of files that are left out, of which the provenance has the digest.
    """

    directory: Path
    inputs: Sequence[Input]
    parts: Mapping[str, Mapping[str, int]] = field(repr=False)
    left_out: Mapping[str, str]
    withheld: frozenset[str] = field(repr=False)

    @property
    def places(self) -> list[str]:
        """Places of all published files, sorted."""
        return sorted(place for files in self.parts.values() for place in files)


def contents_of(directory: Path, inputs: Sequence[Input], without: Iterable[str] = ()) -> Contents:
    """Select the files of a campaign directory without some parts; raises `UserError` for an unknown part."""
    left_out: dict[str, str] = {}
    for name in without:
        if name not in PARTS or name == "tables":
            hint = did_you_mean(name, [part for part in PARTS if part != "tables"])
            raise UserError(f"--without: {message_of(f'no part {name!r} can be left out', hint)}")
        left_out[name] = "by choice"
    private = [each.name for each in inputs if each.kind == "private"]
    left_out |= {f"inputs/{name}": "private" for name in private}
    with reading(directory):
        hidden, folders = _private_places(directory, private)
        if folders:
            left_out |= {"figures": "show a private map", **dict.fromkeys(folders, "made of a private map")}
        parts: dict[str, dict[str, int]] = {part: {} for part in PARTS}
        withheld = set()
        for file in files_below(directory):
            place = file.relative_to(directory).as_posix()
            top = place.partition("/")[0]
            part = "figures" if place == "report.html" else top
            if top == place and file.suffix in _TABLES and not top.startswith("."):
                part = "tables"
            if part not in PARTS or (part == "tables" and top != place):
                left_out |= {} if top.startswith(".") else {top: "no part of the campaign"}
            elif part in left_out or file in hidden or place.startswith(tuple(f"{each}/" for each in folders)):
                withheld.add(place)
            else:
                parts[part][place] = file.stat().st_size
        return Contents(directory, inputs, parts, left_out, frozenset(withheld))


def _private_places(directory: Path, private: Iterable[str]) -> tuple[set[Path], list[str]]:
    """Return all files with the content of a private one, and the environments that were made of them."""
    digests = {file_digest(directory / "inputs" / name) for name in private}
    hidden = {file for file in files_below(directory) if digests and file_digest(file) in digests}
    folders = set()
    for file in files_below(directory / "inputs") if hidden else ():
        with suppress(ValueError, OSError):  # no map
            if not hidden.isdisjoint({file, *files_of_world(file)}):
                folders.add(f"environments/{world_content(file, directory).digest}")
    return hidden, sorted(each for each in folders if (directory / each).is_dir())


def inputs_of(directory: Path, stated: Mapping[str, Sequence[str]]) -> list[Input]:
    """Return the inputs of a campaign directory.

    Args:
        stated: Kind to patterns of names. They win over `metadata.inputs` of the campaign file, and both over what a file looks like.

    Raises:
        UserError: a pattern that matches nothing, or a damaged directory.
    """
    with reading(directory):
        campaign = yaml_value(read_text(directory / "campaign.vast")) or {}
        own = (campaign.get("metadata") or {}).get("inputs") or {}
        if not isinstance(own, dict) or not all(key in KINDS and isinstance(each, list) for key, each in own.items()):
            raise ValueError(f"metadata.inputs: expected lists of names at {', '.join(KINDS)}, got {own!r:.100}")
        guessed = [*_files(directory), *_foreign(directory, campaign)]
    rules = [(kind, str(each)) for said in (stated, own) for kind in KINDS for each in said.get(kind, ())]
    names = [each.name for each in guessed]
    for _, pattern in rules:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise UserError(message_of(f"no input matches {pattern!r}", did_you_mean(pattern, names)))
    found = []
    for each in guessed:
        kind = next((kind for kind, pattern in rules if fnmatchcase(each.name, pattern)), each.kind)
        found.append(Input(each.name, kind, (each.reason or "as stated") if kind == "opaque" else ""))
    return found


def _files(directory: Path) -> Iterator[Input]:
    for file in files_below(directory / "inputs"):
        name = file.relative_to(directory / "inputs").as_posix()
        yield Input(name, "public") if _is_known(file) else Input(name, "opaque", "a binary file of unknown kind")


def _is_known(path: Path) -> bool:
    """Whether a file is text, or data of a kind that is recognized by its beginning."""
    with open_file(path) as file:
        size, head = os.fstat(file.fileno()).st_size, file.read(_STL_HEAD)
        if head.startswith(_KNOWN) or size == _STL_HEAD + _STL_TRIANGLE * int.from_bytes(head[80:], "little"):
            return True
        with suppress(UnicodeDecodeError):
            return size <= MOST_BYTES and "\0" not in (head + file.read(MOST_BYTES)).decode()
    return False


def _foreign(directory: Path, campaign: Mapping[str, Any]) -> Iterator[Input]:
    """Yield the container image, and programs that runs started from elsewhere than the inputs, as their logs name them."""
    if image := str((campaign.get("execution") or {}).get("image") or ""):
        is_pinned = re.search("@sha256:[0-9a-f]{64}$", image)
        yield Input(image, "public") if is_pinned else Input(image, "opaque", "a container image without a digest")
    rows = table_rows(directory / "configurations.parquet", "name", "scenario")
    logs, own = KeptLogs(directory), {file.name for file in files_below(directory / "inputs")}
    started = (log for row in rows if '"programs":' in row["scenario"] for log in logs.of(row["name"]))
    programs = (str(text["command"][0]) for log in started for text in log["texts"] if text["command"])
    for program in dict.fromkeys(programs):
        name = PurePosixPath(program).name
        if name not in own and not _INTERPRETERS.fullmatch(name):
            yield Input(program, "opaque", "a program that is not among the inputs")


def refuse_opaque(inputs: Iterable[Input], allowed: Sequence[str]) -> None:
    """Raise `UserError` for opaque inputs that are not allowed."""
    blocking = [
        each for each in inputs if each.kind == "opaque" and not any(fnmatchcase(each.name, by) for by in allowed)
    ]
    if blocking:
        named = ", ".join(f"{each.name} ({each.reason})" for each in blocking)
        right = "Say --public or --private of each, or --allow-opaque to publish it as it is."
        raise UserError(f"opaque inputs, which nobody can rebuild: {named}. Nothing was written. {right}")
