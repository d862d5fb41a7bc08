"""The Nav2 parameter file of a campaign: its content, faults, and what of it is not modeled."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, FaultKind, FileError, Place, Problem
from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.nav2.parameter_files import document as parameters
from vastflow.sim.nav2.parameter_files.controller_server import critics_of
from vastflow.sim.nav2.parameter_files.document import dotted
from vastflow.sim.nav2.parameter_files.findings import Finding, defaults_row, findings, omitted, slips
from vastflow.sim.nav2.parameter_files.interpretation import Interpretation, interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import file_value, frozen, read_nav2_document
from vastflow.sim.nav2.parameter_files.reader import shown
from vastflow.sim.nav2.parameter_files.refusals import refusals
from vastflow.sim.nav2.parameter_files.releases import RELEASE, changes_since_jazzy, guessed_release
from vastflow.sim.system.keys import FILE_KEY, RELEASE_KEY, RELEASES
from vastflow.sim.system.system import SystemFile


def read_file(path: Path, release: Value = None) -> SystemFile:
    """Return a campaign's Nav2 parameter file, its faults, and its notes.

    Args:
        release: Nav2's release as the campaign says it.
    """
    own: dict[str, Value] = {RELEASE_KEY: release} if release in RELEASES else {}
    try:
        whole = frozen(read_nav2_document(path))
    except FileError as error:
        return SystemFile(faults=error.faults)
    asked = replace(whole, values={**whole.values, **{(key,): said for key, said in own.items()}})
    try:
        found = interpretation(asked)
    except FileError as error:
        wrong = {fault.place.where for fault in error.faults}
        kept = {path: value for path, value in asked.values.items() if dotted(path) not in wrong}
        slipped: list[Fault] = []
        with suppress(FileError):
            slipped += _slips(interpretation(replace(asked, values=kept)))
        return SystemFile(faults=(*error.faults, *slipped))
    faults = (*_slips(found), *refusals(found))
    return SystemFile({FILE_KEY: file_value(whole), **own}, faults, tuple(notes_of(found)), defaults_row(found))


def _slips(found: Interpretation) -> Iterator[Fault]:
    for each, near in slips(found):
        place = Place(found.document.file, *each.place, short(each.path))
        yield Fault(place, f"unknown key {each.path[-1]!r}", f"did you mean {near!r}?")


def notes_of(found: Interpretation) -> Iterator[Fault]:
    """Yield a note for each parameter, or group of parameters, that is not modeled or is built in otherwise."""
    document = found.document

    def note(path: ParameterLocation, what: Problem, consequence: str, kind: FaultKind = "warning") -> Fault:
        return Fault(Place(document.file, *document.place(path), short(path)), what, consequence, kind)

    for nodes, consequence in (
        (found.replaced, "they are as in Nav2 Jazzy's default file"),
        (found.absent, "they are as in Nav2's code"),
        (found.left_away, "the stack does without them"),
    ):
        if nodes:
            yield Fault(Place(document.file), f"the file has no {', '.join(nodes)}", consequence, "warning")
    critics = critics_of(found.parameters.controller).values()
    if critics and not any(critic.enabled for critic in critics):
        place = Place(document.file, *document.place(document.node("controller_server") or ()), "controller_server")
        yield Fault(place, "no critic of the controller is enabled", "it will not follow a path", "warning")
    for path in document.repeated:
        counts = "this value counts"
        if path not in document.values:
            counts = "both count, while Nav2's launch files take the last alone"
        yield note(path, f"duplicate key {path[-1]!r}", counts)
    for path, why in found.reader.unused.items():
        if path[-1] == "robot_radius" and path in document.values:
            yield note(path, f"{shown(document.values[path])} has no effect", why)
    for path, (what, consequence) in found.reader.warnings.items():
        yield note(path, what, consequence)
    for path, declared, other, is_used in omitted(found):
        if not is_used and path not in found.reader.warnings:
            yield note(
                path,
                f"the file leaves {path[-1]} out, which is {shown(declared.default)} in Nav2's code",
                f"the simulator uses {shown(other)}",
                "not modeled",
            )
    release, name = guessed_release(document)
    if name and RELEASE not in document.values:
        where = next(path for path, value in document.values.items() if name in (*path, value))
        what = f"the file is for Nav2 {release.title()}, the first with {name!r}"
        yield note(where, what, f"Jazzy is simulated, and '{RELEASE_KEY}' of the campaign says another release")
    for change in changes_since_jazzy(document, {*found.reader.kinds.values()}):
        where = next(path for path, kind in found.reader.kinds.items() if kind.endswith(change.kind))
        yield note(where, f"since {change.since.title()} {change.words}", f"{change.here} here", "not modeled")
    for path, held in found.reader.held.items():
        if path in document.values:
            what = f"{shown(document.values[path])} Hz is not supported: the rate must divide the 20 Hz control loop"
            yield note(path, what, f"it runs at {held:g} Hz")
    said = found.reader.held.keys() | found.reader.warnings.keys()
    groups: dict[ParameterLocation, list[Finding]] = {}
    for finding in findings(found):
        if finding.status in ("not modeled", "differs") and finding.path not in said:
            groups.setdefault(finding.about, []).append(finding)
    for about, (first, *others) in groups.items():
        if first.status == "differs":
            what = f"{shown(first.value)} is not modeled"
            right = first.why or f"the simulator uses {shown(first.used)}"
        else:
            what = f"{len(others) + 1} parameters are" if others else f"{about[-1]!r} is"
            what, right = f"{what} not modeled", first.why
        yield note(about, what, right, "not modeled")


def short(path: ParameterLocation) -> str:
    """A path without `ros__parameters`, as campaign files may have it for a key."""
    return ".".join(name for name in path if name != parameters.PARAMETERS)
