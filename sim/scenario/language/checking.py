"""From a scenario's syntax to its definition."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final, TypeGuard

from vastflow.sim.model.faults import Fault, Got, Place
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.scenario.definition import (
    Actor,
    Awaited,
    Behavior,
    Call,
    Composition,
    Elapsed,
    Emit,
    Expression,
    Field,
    Happened,
    Holds,
    Modified,
    ScenarioDefinition,
    Type,
    Until,
    Wait,
)
from vastflow.sim.scenario.evaluation import names_in
from vastflow.sim.scenario.language import syntax
from vastflow.sim.scenario.language.declarations import BOOL, Compound, Declarations
from vastflow.sim.scenario.language.declaring import declaring, library_names
from vastflow.sim.scenario.language.expressions import Faulty, Visible
from vastflow.sim.scenario.language.members import MemberChecker

MOST_LEVELS: Final = 150
"""Compositions and modifiers in one another; digests of definitions, and trees, are made by functions that call themselves."""

ENDING: Final = ("end", "fail", "start")
"""Events that every scenario has; nothing follows from the last."""

MODIFIERS: Final = (
    *("repeat", "retry", "timeout", "inverter", "failure_is_running", "failure_is_success"),
    *("running_is_failure", "running_is_success", "success_is_failure", "success_is_running"),
)
"""Executed modifiers; others can be declared but not used."""


def checked(text: syntax.Compound, declared: Declarations, faults: list[Fault]) -> ScenarioDefinition | None:
    """Return the definition of a scenario, or None if it has a fault, which goes to `faults`."""
    before = len(faults)
    definition = _Scenario(declared, faults).definition(text)
    return definition if len(faults) == before else None


class _Scenario(MemberChecker):
    """Checks one scenario, its bases, and its behavior: compositions, actions, waits, and modifiers."""

    def __init__(self, declared: Declarations, faults: list[Fault]) -> None:
        super().__init__(declared, faults)
        self._events: list[str] = []
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
        root = None if done is None else self.attempt(self._behavior, done.behavior)
        for member in members:
            if isinstance(member, syntax.Act) and not self._is_modifier(member):
                self._misplaced(member)
        root = self._wrapped(root, members)
        if root is not None and (deep := _too_deep(root)) is not None:
            self.fault(deep, Got(f"more than {MOST_LEVELS} compositions and modifiers in one another"), "fewer")
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
            events=tuple(self._events),
            root=root,
            place=text.name.place,
            structs={name: struct.members for name, struct in self.declared.structs.items()},
            units=self.declared.units,
            enums=self.declared.enums,
            bases=tuple(str(part.name) for part in chain[:-1]),
        )

    def _misplaced(self, text: syntax.Act) -> None:
        path = str(text.call.path)
        known = did_you_mean(path, self.declared.modifiers, "write 'import osc.helpers', which has modifiers")
        right = "write 'do' before it" if "." in path or path in self.declared.actions else known
        self.fault(text.call.place, f"unexpected {path}(…) in the body of a scenario", right)

    def _chain(self, text: syntax.Compound) -> list[syntax.Compound]:
        chain = [text]
        while chain[0].base is not None:
            name = str(chain[0].base)
            base = self.declared.scenarios.get(name)
            if base is None:
                right = did_you_mean(name, self.declared.scenarios)
                self.fault(chain[0].base.place, f"unknown scenario {name!r}", right)
                break
            if any(base is one for one in chain):
                self.fault(chain[0].base.place, f"scenario {name!r} inherits from itself", "inherit from another one")
                break
            chain.insert(0, base)
        return chain

    def _declare(self, member: syntax.Member) -> None:
        match member:
            case syntax.Field():
                self._field(member)
            case syntax.Event(name):
                if name.text in self._fields or name.text in self._events or name.text in ENDING:
                    self.fault(name.place, f"'{name}' is declared already", "choose another name")
                elif self.allowed(name):
                    self._events.append(name.text)
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
            if member.name in self._own or member.name in self._events:
                self.fault(member.place, f"{member.name!r} is declared already", "choose another name")
                continue
            self._own.add(member.name)
            above = self._fields.get(member.name)
            if above is not None and not self._is_variable(member.name, above):
                member = self.overriding(member, above)
            if member.type.kind == "actor":
                if member.type.is_list or member.is_variable:
                    what = "a list of actors" if member.type.is_list else "a variable of an actor"
                    self.fault(member.place, Got(what), "'name: actor' for each instance")
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
                self.fault(member.place, f"the value of {name!r} needs {name!r} itself", "give it another value")

    def _done(self, chain: Sequence[syntax.Compound]) -> syntax.Do | None:
        """Return the scenario's own `do`, or that of its nearest base."""
        for part in reversed(chain):
            found = [member for member in part.members if isinstance(member, syntax.Do)]
            for other in found[1:]:
                self.fault(other.place, Got("a second 'do'"), "one 'do' with a serial or parallel")
            if found:
                return found[0]
        name = chain[-1].name
        self.fault(name.place, f"scenario {name} does nothing", "add 'do' and an action")
        return None

    def _actor(self, name: str, text: syntax.Field) -> Actor | None:
        type_, place = self._fields[name].type, self._fields[name].place
        declared = self.declared.actors[type_.name]
        members: Mapping[str, Field] = declared.members
        if text.default is not None:
            self.fault(place, Got("a value for an actor"), "'keep' below it")
        for item in text.keeps:
            members = self.keep(item, members)
        values, missing = self.declared.filled(_changed(members, declared.members), declared.members, place)
        if without := next((member.name for member in missing if not member.is_variable), ""):
            right = f"add 'with:', and below it 'keep(it.{without} == …)'"
            self.fault(place, f"{name!r} has no value for {without!r}", right)
            return None
        return Actor(name, (type_.name, *declared.bases), values, self.declared.variables_of(type_), place)

    def _behavior(self, text: syntax.Behavior) -> Behavior:
        """Return the checked behavior with its modifiers, inline and below `with:`, the first outermost.

        `until` stands outside of them.
        """
        if isinstance(text, syntax.Refused):
            self.refuse(text)
        for item in text.modifiers:
            if isinstance(item, syntax.Keep) and not isinstance(text, syntax.Act):
                self.fault(item.place, Got("'keep' where nothing has members"), "'keep' below an action")
        child = self.attempt(self._bare, text)
        child = self._wrapped(child, text.members if isinstance(text, syntax.Composition) else ())
        if [self.attempt(self.refuse, item) for item in text.modifiers if isinstance(item, syntax.Refused)]:
            child = None
        child = self._applied(child, [item for item in text.modifiers if isinstance(item, syntax.Call)])
        for until in reversed([item for item in text.modifiers if isinstance(item, syntax.Until)]):
            awaited = self.attempt(self._awaited, until.awaited)
            child = None if child is None or awaited is None else Until(awaited, child, until.place)
        if child is None:
            raise Faulty
        return child

    def _bare(self, text: syntax.Composition | syntax.Act | syntax.Wait | syntax.Emit) -> Behavior:
        label = text.label.text if text.label else ""
        match text:
            case syntax.Composition():
                members = [member for member in text.members if not self._is_modifier(member)]
                if not members:
                    self.fail(text.place, Got(f"an empty {text.kind}"), "one action or more in it")
                return Composition(text.kind, tuple(self.each(self._behavior, members)), label, text.place)
            case syntax.Act():
                return self._act(text, label)
            case syntax.Wait():
                return Wait(self._awaited(text.awaited), label, text.place)
            case syntax.Emit():
                self._check_event(text.event, (*self._events, *ENDING))
                return Emit(text.event.text, label, text.place)

    def _is_modifier(self, text: syntax.Member | syntax.Behavior) -> TypeGuard[syntax.Act]:
        path = str(text.call.path) if isinstance(text, syntax.Act) else ""
        return path in self.declared.modifiers and path not in self.declared.actions

    def _wrapped(self, child: Behavior | None, members: Iterable[syntax.Member | syntax.Behavior]) -> Behavior | None:
        """Return `child` with the modifiers among the parts of its body, the first outermost."""
        calls = []
        for text in (member for member in members if self._is_modifier(member)):
            if text.modifiers:
                self.fault(text.call.place, Got("a modifier of a modifier"), "one after the other")
            calls.append(text.call)
        return self._applied(child, calls)

    def _applied(self, child: Behavior | None, calls: Sequence[syntax.Call]) -> Behavior | None:
        for call in reversed(calls):
            name = str(call.path)
            arguments = self.attempt(self._modifier_arguments, call, name)
            child = None if child is None or arguments is None else Modified(name, arguments, child, call.place)
        return child

    def _modifier_arguments(self, call: syntax.Call, name: str) -> Mapping[str, Expression]:
        modifier = self.declared.modifiers.get(name)
        if modifier is None:
            hint = did_you_mean(name, self.declared.modifiers, "write 'import osc.helpers', which has modifiers")
            self.fail(call.place, f"unknown modifier {name!r}", hint)
        if name not in MODIFIERS:
            self.fault(call.place, f"modifier {name!r} can't be executed", "use a modifier of osc.helpers")
        return self._arguments(call, modifier, name)

    def _arguments(
        self, call: syntax.Call, declared: Compound, whose: str, keeps: Sequence[syntax.Keep] = ()
    ) -> Mapping[str, Expression]:
        """Return all arguments of a call; `keep` constraints replace arguments in brackets."""
        given = self.arguments(call, declared.members, whose)
        members = {
            name: replace(member, default=given.get(name, member.default)) for name, member in declared.members.items()
        }
        for keep in keeps:
            members = self.keep(keep, members)
        return self.complete(_changed(members, declared.members), declared.members, call.place, whose)

    def _act(self, text: syntax.Act, label: str) -> Behavior:
        words = text.call.path.words
        action = self._action(words[0]) if len(words) == 1 else self._action_of(words)
        keeps = [item for item in text.modifiers if isinstance(item, syntax.Keep)]
        arguments = self._arguments(text.call, action, str(text.call.path), keeps)
        # The library action that an action inherits from is what is done, or else the action itself.
        chain = (action, *(self.declared.actions[base][0] for base in action.bases))
        name = next((each.name for each in chain if each.origin in library_names()), action.name)
        return Call(name, words[0].text if len(words) == 2 else "", arguments, label, text.call.place)

    def _action(self, name: syntax.Word) -> Compound:
        known = self.declared.actions.get(name.text, ())
        if not known:
            self.fail(name.place, f"unknown action '{name}'", self._right_action(name.text))
        if len(known) > 1:
            origins = " and ".join(action.origin for action in known)
            right = "keep one of the imports, or rename the action"
            self.fail(name.place, f"'{name}' is declared by {origins}", right)
        return known[0]

    def _right_action(self, name: str) -> str:
        if owners := [action for action in self.declared.actions if action.endswith(f".{name}")]:
            actor = Type(owners[0].partition(".")[0], "actor")
            instances = (key for key, type_ in self.names.types.items() if self.declared.is_a(type_, actor))
            return f"it is an action of {actor}: {next(instances, 'instance')}.{name}(…)"
        if libraries := declaring(name):
            return f"write 'import {libraries[0]}', which declares it"
        if name in self.declared.scenarios:
            return "write an action, as a scenario can be inherited from and not be called"
        return did_you_mean(name, [action for action in self.declared.actions if "." not in action], "add an import")

    def _action_of(self, words: Sequence[syntax.Word]) -> Compound:
        instance, name = words[0], words[-1]
        type_ = self.names.types.get(instance.text)
        if instance.text in self.names.faulty:
            raise Faulty
        if len(words) > 2 or type_ is None or type_.kind != "actor":
            actors = [key for key, of in self.names.types.items() if of.kind == "actor"]
            hint = did_you_mean(instance.text, actors, "declare an instance as 'name: actor' in the scenario")
            self.fail(instance.place, f"unknown actor instance '{instance}'", hint)
        chain = (type_.name, *self.declared.actors[type_.name].bases)
        for actor in chain:
            if known := self.declared.actions.get(f"{actor}.{name}"):
                return known[0]
        own = [action.partition(".")[2] for action in self.declared.actions if action.partition(".")[0] in chain]
        libraries = [library for actor in chain for library in declaring(f"{actor}.{name}")]
        hint = f"write 'import {libraries[0]}', which declares it" if libraries else did_you_mean(name.text, own)
        self.fail(name.place, f"'{name}' is not an action of {type_.name}", hint)

    def _check_event(self, name: syntax.Word, known: Sequence[str]) -> None:
        if name.text not in known:
            right = did_you_mean(name.text, known, f"declare 'event {name}' in the scenario")
            self.fail(name.place, f"unknown event '{name}'", right)

    def _awaited(self, text: syntax.Awaited) -> Awaited:
        event, condition = text.event, text.condition
        if event is None and isinstance(condition, syntax.Call) and str(condition.path) == "elapsed":
            return self._elapsed(condition)
        if event is not None:
            if len(event.words) > 1:
                self.fail(event.place, Got(f"event {event}"), "an event of the scenario")
            self._check_event(event.words[0], self._events)
        held = None if condition is None else self.assigned(condition, BOOL, "a condition")
        if event is not None:
            return Happened(str(event), held, text.place)
        assert held is not None
        return Holds(held, text.place)

    def _elapsed(self, call: syntax.Call) -> Awaited:
        if len(call.arguments) != 1 or call.arguments[0].name is not None:
            self.fail(call.place, Got("elapsed without one duration"), "elapsed(3s)")
        text = call.arguments[0].value
        take = self.given if isinstance(text, syntax.Call) else self.assigned
        return Elapsed(take(text, Type("time", "physical"), "a duration"), call.place)


def _too_deep(root: Behavior) -> Place | None:
    """Return the place of the first behavior nested deeper than `MOST_LEVELS`, if any."""
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


def _changed(members: Mapping[str, Field], declared: Mapping[str, Field]) -> dict[str, Expression]:
    """Return the defaults of members that are not the declared ones."""
    defaults = ((name, member.default) for name, member in members.items())
    return {name: value for name, value in defaults if value is not None and value is not declared[name].default}
