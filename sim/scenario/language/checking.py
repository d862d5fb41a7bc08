"""From a scenario's syntax to its definition."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from vastflow.sim.model.faults import Fault, Place
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.scenario.definition import (
    Actor,
    Behavior,
    Composition,
    Field,
    Modified,
    ScenarioDefinition,
    Type,
    Until,
)
from vastflow.sim.scenario.evaluation import names_in
from vastflow.sim.scenario.language import syntax
from vastflow.sim.scenario.language.behaviors import ENDING, BehaviorChecker, changed
from vastflow.sim.scenario.language.declarations import Declarations
from vastflow.sim.scenario.language.expressions import Visible

MOST_LEVELS: Final = 150
"""Compositions and modifiers in one another; digests of definitions, and trees, are made by functions that call themselves."""


def checked(text: syntax.Compound, declared: Declarations, faults: list[Fault]) -> ScenarioDefinition | None:
    """Return the definition of a scenario, or None if it has a fault, which goes to `faults`."""
    before = len(faults)
    definition = _Scenario(declared, faults).definition(text)
    return definition if len(faults) == before else None


class _Scenario(BehaviorChecker):
    """Checks one scenario, with all that it inherits."""

    def __init__(self, declared: Declarations, faults: list[Fault]) -> None:
        super().__init__(declared, faults)
        self._fields: dict[str, Field] = dict(declared.globals)
        self._own: set[str] = set()
        self._types: dict[str, Type] = {}
        self._instances: dict[str, syntax.Field] = {}
        self._faulty: set[str] = set()

    def definition(self, text: syntax.Compound) -> ScenarioDefinition | None:
        chain = self._chain(text)
        members = [member for part in chain for member in part.members]
        self._types = {name: type_ for member in members for name, type_ in self.types(member).items()}
        for part in chain:
            self._own.clear()
            for member in part.members:
                self.names = self._visible()
                self._declare(member)
        self._refuse_circles()
        self.names = self._visible()
        done = self._done(chain)
        root = None if done is None else self.attempt(self.behavior, done.behavior)
        applied = [member for member in members if isinstance(member, syntax.Act)]
        for member in applied:
            if not self.is_modifier(member):
                self._misplaced(member)
        root = self.wrapped(root, [member for member in applied if self.is_modifier(member)])
        if root is not None and (deep := _too_deep(root)) is not None:
            self.fault(deep, f"got more than {MOST_LEVELS} compositions and modifiers in one another", "fewer")
            return None
        actors = [self._actor(name, field) for name, field in self._instances.items()]
        if root is None or None in actors:
            return None
        parameters, variables = [], []
        for field in self._fields.values():
            if self._is_variable(field.name, field):
                initial = field.default or self.declared.default_of(field.type, field.place)
                variables.append(replace(field, default=initial))
            elif field.type.kind != "actor":
                parameters.append(field)
        return ScenarioDefinition(
            name=str(text.name),
            parameters=tuple(parameters),
            variables=tuple(variables),
            actors=tuple(actor for actor in actors if actor is not None),
            events=tuple(self.events),
            root=root,
            place=text.name.place,
            structs={name: struct.members for name, struct in self.declared.structs.items()},
            units=self.declared.units,
            enums=self.declared.enums,
            bases=tuple(str(part.name) for part in chain[:-1]),
        )

    def _misplaced(self, text: syntax.Act) -> None:
        path = str(text.call.path)
        known = did_you_mean(path, self.declared.modifiers, "'import osc.helpers', which declares the modifiers")
        right = "'do' before it" if "." in path or path in self.declared.actions else known
        self.fault(text.call.place, f"got {path}(…) in the body of a scenario", right)

    def _chain(self, text: syntax.Compound) -> list[syntax.Compound]:
        """Return the scenario and its bases, the farthest first."""
        chain = [text]
        while chain[0].base is not None:
            name = str(chain[0].base)
            base = self.declared.scenarios.get(name)
            if base is None:
                right = did_you_mean(name, self.declared.scenarios)
                self.fault(chain[0].base.place, f"unknown scenario {name!r}", right)
                break
            if any(base is one for one in chain):
                self.fault(chain[0].base.place, f"scenario {name!r} inherits from itself", "another one")
                break
            chain.insert(0, base)
        return chain

    def _declare(self, member: syntax.Member) -> None:
        match member:
            case syntax.Field():
                self._field(member)
            case syntax.Event(name):
                if name.text in self._fields or name.text in self.events or name.text in ENDING:
                    self.fault(name.place, f"'{name}' is declared already", "another name")
                elif self.allowed(name):
                    self.events.append(name.text)
            case syntax.Keep():
                self._fields = self.keep(member, self._fields)
            case syntax.Method():
                pass  # may be declared; a call of it is refused
            case syntax.Refused():
                self.attempt(self.refuse, member)

    def _field(self, text: syntax.Field) -> None:
        members = self.fields(text)
        self._faulty |= {name.text for name in text.names} - {member.name for member in members}
        for member in members:
            if member.name in self._own or member.name in self.events:
                self.fault(member.place, f"{member.name!r} is declared already", "another name")
                continue
            self._own.add(member.name)
            above = self._fields.get(member.name)
            if above is not None and not self._is_variable(member.name, above):
                member = self.overriding(member, above)
            if member.type.kind == "actor":
                if member.type.is_list or member.is_variable:
                    what = "a list of actors" if member.type.is_list else "a variable of an actor"
                    self.fault(member.place, f"got {what}", "'name: actor' for each instance")
                self._instances[member.name] = text
            self._fields[member.name] = member

    def _visible(self) -> Visible:
        changing = [name for name, member in self._fields.items() if self._is_variable(name, member)]
        types = self._types | {name: member.type for name, member in self._fields.items()}
        for name, type_ in types.items():
            changing += [f"{name}.{each}" for each in self.declared.variables_of(type_)]
        return Visible(types, frozenset(changing), frozenset(self._faulty))

    def _is_variable(self, name: str, member: Field) -> bool:
        return member.is_variable or member is self.declared.globals.get(name)

    def _refuse_circles(self) -> None:
        """Report values that need themselves."""
        defaults = {name: member.default for name, member in self._fields.items()}
        needed = {name: set(names_in(value)) if value else set() for name, value in defaults.items()}
        told: set[str] = set()
        for name, member in self._fields.items():
            reached, ahead = set[str](), needed[name]
            while ahead - reached:
                reached |= ahead
                ahead = {further for each in ahead for further in needed.get(each, ())}
            if name in reached and name not in told:
                told |= reached
                self.fault(member.place, f"the value of {name!r} needs {name!r} itself", "a value")

    def _done(self, chain: Sequence[syntax.Compound]) -> syntax.Do | None:
        """Return the scenario's own `do`, or that of its nearest base."""
        for part in reversed(chain):
            found = [member for member in part.members if isinstance(member, syntax.Do)]
            for other in found[1:]:
                self.fault(other.place, "got a second 'do'", "one 'do' with a serial or parallel")
            if found:
                return found[0]
        name = chain[-1].name
        self.fault(name.place, f"scenario {name} does nothing", "'do' and an action")
        return None

    def _actor(self, name: str, text: syntax.Field) -> Actor | None:
        type_, place = self._fields[name].type, self._fields[name].place
        declared = self.declared.actors[type_.name]
        members: Mapping[str, Field] = declared.members
        if text.default is not None:
            self.fault(place, "got a value for an actor", "'keep' below it")
        for item in text.keeps:
            members = self.keep(item, members)
        values, missing = self.declared.filled(changed(members, declared.members), declared.members, place)
        if without := next((member.name for member in missing if not member.is_variable), ""):
            right = f"'with:' and below it 'keep(it.{without} == …)'"
            self.fault(place, f"{name!r} has no value for {without!r}", right)
            return None
        return Actor(name, (type_.name, *declared.bases), values, self.declared.variables_of(type_), place)


def _too_deep(root: Behavior) -> Place | None:
    """Return the place of a behavior nested deeper than `MOST_LEVELS`, if there is one."""
    waiting = [(root, 1)]
    while waiting:
        behavior, level = waiting.pop()
        if level > MOST_LEVELS:
            return behavior.place
        match behavior:
            case Composition():
                waiting += [(child, level + 1) for child in behavior.children]
            case Modified() | Until():
                waiting.append((behavior.child, level + 1))
    return None
