"""From the syntax of a file or library to its declarations."""

from collections.abc import Collection, Mapping
from functools import cache
from importlib.resources import files
from threading import RLock
from typing import Final

from vastflow.sim.model.faults import Fault, FileError, Got, Place
from vastflow.sim.model.names import did_you_mean, nearest
from vastflow.sim.scenario.definition import Field
from vastflow.sim.scenario.language import syntax
from vastflow.sim.scenario.language.declarations import Compound, Declarations, Function
from vastflow.sim.scenario.language.expressions import NO_NAMES, Visible
from vastflow.sim.scenario.language.members import MemberChecker


def parse(text: str, file: str) -> syntax.File:
    """Return the syntax of `text`; the grammar is built once in a process.

    Raises:
        FileError: it is not in the language; every place where it is not that can be told from what follows.
    """
    # 0.15 s of CPU that only a process which reads scenarios should pay
    from vastflow.sim.scenario.language.grammar import parsed

    return parsed(text, file)


def declared(
    text: syntax.File, imported: Declarations, origin: str, faults: list[Fault], *, of_library: bool = False
) -> Declarations:
    """Return the declarations of `imported` and `text`; faults go to `faults`.

    Args:
        origin: Name of the library, or the file.
    """
    known = Declarations(right_type=right_type)
    known.include(imported)
    return _Declarer(known, origin, faults, of_library=of_library).declarations(text)


class _Declarer(MemberChecker):
    """Declares the content of a file; types are declared at their first use, which may precede them."""

    def __init__(self, known: Declarations, origin: str, faults: list[Fault], *, of_library: bool) -> None:
        super().__init__(known, faults, of_library=of_library)
        self._origin = origin
        self._pending: dict[str, syntax.Compound] = {}
        self._places: dict[tuple[str, str], Place] = {}
        self._globals = {name: member.type for name, member in known.globals.items()}

    def declarations(self, text: syntax.File) -> Declarations:
        known = self.declared
        for part in text.declarations:
            match part:
                case syntax.PhysicalType():
                    if self._is_new("type", part.name, known.type_names):
                        exponents = ((unit.text, number) for unit, number in part.exponents)
                        known.physical[part.name.text] = {u: n for u, n in exponents if u not in ("factor", "offset")}
                case syntax.EnumType():
                    self._enum_type(part)
                case syntax.Refused():
                    self.attempt(self.refuse, part)
                case syntax.Compound(kind="struct" | "actor"):
                    if self._is_new("type", part.name, known.type_names):
                        self._pending[str(part.name)] = part
        for part in text.declarations:
            if isinstance(part, syntax.Unit):
                self._unit(part)
        fields = [part for part in text.declarations if isinstance(part, syntax.Field)]
        # Types of this file last: the defaults of their members may name globals.
        for field in sorted(fields, key=lambda field: field.type.name.text in self._pending):
            self._globals |= self.types(field)
        for name in list(self._pending):
            self.ensure(name)
        self.names = Visible(self._globals)
        for field in fields:
            if all(self._is_new("global", name, known.globals) for name in field.names):
                known.globals.update({each.name: each for each in self.fields(field)})
        for part in text.declarations:
            match part:
                case syntax.Compound(kind="modifier"):
                    if self._is_new("modifier", part.name, known.modifiers) and self._one_word(part):
                        known.modifiers[str(part.name)] = self._compound(part, known.modifiers)
                case syntax.Compound(kind="action"):
                    self._action(part)
                case syntax.Compound(kind="scenario"):
                    if self._is_new("scenario", part.name, known.scenarios) and self._one_word(part):
                        known.scenarios[str(part.name)] = part
        return known

    def _is_new(self, kind: str, name: syntax.Path | syntax.Word, known: Collection[str]) -> bool:
        place = self._places.setdefault((kind, str(name)), name.place)
        if kind == "type" and str(name).startswith("listof"):
            self.fault(name.place, Got(f"type '{name}', which begins with 'listof'"), "another name")
            return False
        if place is not name.place or str(name) in known:
            where = f" at {place}" if place is not name.place else ""
            self.fault(name.place, f"'{name}' is declared already{where}", "choose another name")
            return False
        return True

    def _unit(self, text: syntax.Unit) -> None:
        if not self._is_new("unit", text.name, self.declared.units):
            return
        if text.type.text not in self.declared.physical:
            right = did_you_mean(text.type.text, self.declared.physical)
            self.fault(text.type.place, f"unknown physical type {text.type.text!r}", right)
            return
        given = {name.text: float(value) for name, value in text.exponents}
        self.declared.units[text.name.text] = (text.type.text, given.get("factor", 1.0), given.get("offset", 0.0))

    def _enum_type(self, text: syntax.EnumType) -> None:
        if not (self.allowed(text.name) and self._is_new("type", text.name, self.declared.type_names)):
            return
        members: dict[str, int] = {}
        number = 0
        for name, given in text.members:
            if isinstance(given, float):
                self.fault(name.place, Got(f"{given} for '{name}'"), "a whole number")
            elif name.text in members:
                self.fault(name.place, f"'{name}' is declared already", "choose another name")
            else:
                members[name.text] = number = number if given is None else given
                number += 1
        self.declared.enums[text.name.text] = members

    def ensure(self, name: str) -> None:
        if (text := self._pending.pop(name, None)) is None:
            return
        kinds = self.declared.structs if text.kind == "struct" else self.declared.actors
        if text.base is not None:
            self.ensure(str(text.base))
        names = self.names
        if self._one_word(text):
            kinds[name] = self._compound(text, kinds)
        self.names = names

    def _one_word(self, text: syntax.Compound) -> bool:
        if len(text.name.words) > 1:
            right = "an action where it is an actor's" if text.kind == "modifier" else "one name"
            self.fault(text.name.place, Got(f"{text.kind} {text.name}, with an actor"), right)
            return False
        return self.allowed(text.name.words[0])

    def _action(self, text: syntax.Compound) -> None:
        name, (actor, *below) = str(text.name), text.name.words
        if not self._is_new("action", text.name, ()):
            return
        if len(below) > 1:
            self.fault(text.name.place, Got(f"action {name}"), "an actor and a name at most")
        elif below and actor.text not in self.declared.actors:
            self.fault(actor.place, f"unknown actor '{actor}'", did_you_mean(actor.text, self.declared.actors))
        else:
            actions = {name: known[0] for name, known in self.declared.actions.items()}
            self.declared.actions[name] = (*self.declared.actions.get(name, ()), self._compound(text, actions))

    def _compound(self, text: syntax.Compound, known: Mapping[str, Compound]) -> Compound:
        assert text.kind != "scenario"
        base = known.get(str(text.base))
        if text.base is not None and base is None:
            self.fault(text.base.place, f"unknown {text.kind} '{text.base}'", did_you_mean(str(text.base), known))
        members: dict[str, Field] = dict(base.members) if base else {}
        functions: dict[str, Function] = dict(base.functions) if base else {}
        own: set[str] = set()
        which = f"an {text.kind}" if text.kind.startswith("a") else f"a {text.kind}"
        for part in text.members:
            self.names = Visible(self._globals | {name: member.type for name, member in members.items()})
            match part:
                case syntax.Field():
                    for member in self.fields(part):
                        if member.name in own:
                            self.fault(member.place, f"{member.name!r} is declared already", "choose another name")
                        inherited = members.get(member.name)
                        members[member.name] = self.overriding(member, inherited) if inherited else member
                        own.add(member.name)
                case syntax.Keep():
                    members = self.keep(part, members)
                case syntax.Method(name, fields, returned):
                    self.names = NO_NAMES
                    parameters = {member.name: member for field in fields for member in self.fields(field)}
                    returns = None if returned is None else self.attempt(self.type_of, returned)
                    functions[name.text] = Function(f"{text.name}.{name}", parameters, returns, self.of_library)
                case syntax.Event():
                    pass  # an actor's own events are declared, and nothing here can emit them
                case syntax.Refused():
                    self.attempt(self.refuse, part)
                case syntax.Do():
                    self.fault(part.place, Got(f"'do' in {which}"), "'do' in a scenario")
                case syntax.Act():
                    right = "a modifier in a scenario or a composition"
                    self.fault(part.call.place, Got(f"a modifier of {which}"), right)
        bases = (base.name, *base.bases) if base else ()
        return Compound(text.kind, str(text.name), bases, members, functions, self._origin, text.name.place)


PREFIX: Final = "osc."
_READING: Final = RLock()
"""Two declarations of one name clash unless they are the same object, so two threads may not both read a library."""


def library_names() -> tuple[str, ...]:
    """Return the names of all libraries, as they are imported."""
    names = (file.name for file in (files("vastflow.sim.scenario.language") / "library").iterdir())
    return tuple(sorted(f"{PREFIX}{name.removesuffix('.osc')}" for name in names if name.endswith(".osc")))


def library(name: str) -> Declarations:
    with _READING:
        return _library(name)


@cache
def _library(name: str) -> Declarations:
    file = files("vastflow.sim.scenario.language") / "library" / f"{name.removeprefix(PREFIX)}.osc"
    text = parse(file.read_text("utf-8"), name)
    imported = Declarations()
    for part in text.imports:
        imported.include(library(part.target))
    faults: list[Fault] = []
    declarations = declared(text, imported, name, faults, of_library=True)
    if faults:
        raise FileError(faults)
    return declarations


def declaring(action: str) -> tuple[str, ...]:
    """Return the libraries that declare an action themselves."""
    return tuple(
        name
        for name in library_names()
        if any(declaration.origin == name for declaration in library(name).actions.get(action, ()))
    )


def home_of(type_name: str) -> str | None:
    """Return the library that declares a type itself."""
    having = [name for name in library_names() if type_name in library(name).type_names]
    return min(having, key=lambda name: len(library(name).type_names) + len(library(name).actions), default=None)


def right_type(name: str, known: Collection[str]) -> str:
    """Suggest the library that declares a type, the nearest type name, or all known types."""
    if home := home_of(name):
        return f"write 'import {home}', which declares it"
    if nearest(name, known) is None:
        elsewhere = {type_name for library_name in library_names() for type_name in library(library_name).type_names}
        if near := nearest(name, elsewhere):
            return f"did you mean {near!r} of {home_of(near)}?"
    return did_you_mean(name, known)
