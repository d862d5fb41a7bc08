"""The libraries that vastflow brings, `import osc.name`; each is read once in a process."""

from collections.abc import Collection
from functools import cache
from importlib.resources import files
from threading import RLock
from typing import Final

from vastflow.sim.osc.declarations import Declarations
from vastflow.sim.osc.declaring import declared
from vastflow.sim.osc.faults import OscError, OscFault
from vastflow.sim.osc.parsing import parse
from vastflow.sim.reading.names import did_you_mean, nearest

PREFIX: Final = "osc."
_READING: Final = RLock()
"""Two declarations of one name clash unless they are the same object, so two threads may not both read a library."""


def library_names() -> tuple[str, ...]:
    """Every library, as it is imported."""
    folder = files("vastflow.sim.osc") / "library"
    names = (file.name for file in folder.iterdir())
    return tuple(sorted(f"{PREFIX}{name.removesuffix('.osc')}" for name in names if name.endswith(".osc")))


def library(name: str) -> Declarations:
    """What a library and those that it imports declare; `name` is one of `library_names`."""
    with _READING:
        return _library(name)


@cache
def _library(name: str) -> Declarations:
    file = files("vastflow.sim.osc") / "library" / f"{name.removeprefix(PREFIX)}.osc"
    text = parse(file.read_text("utf-8"), name)
    imported = Declarations()
    for part in text.imports:
        imported.include(library(part.target))
    faults: list[OscFault] = []
    declarations = declared(text, imported, name, faults, of_library=True)
    if faults:
        raise OscError(faults)
    return declarations


def declaring(action: str) -> tuple[str, ...]:
    """The libraries that declare an action themselves."""
    return tuple(
        name
        for name in library_names()
        if any(declaration.origin == name for declaration in library(name).actions.get(action, ()))
    )


def home_of(type_name: str) -> str | None:
    """The library that declares a type, and not only imports it."""
    having = [name for name in library_names() if type_name in library(name).type_names()]
    return min(having, key=lambda name: len(library(name).type_names()) + len(library(name).actions), default=None)


def right_type(name: str, known: Collection[str]) -> str:
    """The library to import for a type, the nearest name among those that are known or in any library, or all known."""
    if home := home_of(name):
        return f"'import {home}', which declares it"
    if nearest(name, known) is None:
        elsewhere = {type_name for library_name in library_names() for type_name in library(library_name).type_names()}
        if near := nearest(name, elsewhere):
            return f"did you mean {near!r} of {home_of(near)}?"
    return did_you_mean(name, known)
