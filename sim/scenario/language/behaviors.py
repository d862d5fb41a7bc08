"""Checking what a scenario does: compositions, calls of actions, waits, and the modifiers round them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final, TypeVar

from vastflow.sim.model.faults import Fault
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.scenario.definition import (
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
    Type,
    Until,
    Wait,
)
from vastflow.sim.scenario.language import syntax
from vastflow.sim.scenario.language.declarations import BOOL, Compound, Declarations
from vastflow.sim.scenario.language.declaring import declaring, library_names
from vastflow.sim.scenario.language.expressions import Faulty
from vastflow.sim.scenario.language.members import MemberChecker

ENDING: Final = ("end", "fail", "start")
"""Events that every scenario has; nothing follows from the last."""

MODIFIERS: Final = (
    *("repeat", "retry", "timeout", "inverter", "failure_is_running", "failure_is_success"),
    *("running_is_failure", "running_is_success", "success_is_failure", "success_is_running"),
)
"""Those that are executed; others can be declared and not used."""

Modifiable = TypeVar("Modifiable", syntax.Composition, syntax.Act, syntax.Wait, syntax.Emit)


class BehaviorChecker(MemberChecker):
    """Checks behaviors of one scenario, which declares `events`."""

    def __init__(self, declared: Declarations, faults: list[Fault]) -> None:
        super().__init__(declared, faults)
        self.events: list[str] = []

    def behavior(self, text: syntax.Behavior) -> Behavior:
        """Return the checked behavior."""
        match text:
            case syntax.Refused():
                self.refuse(text)
            case syntax.Composition():
                return self._composition(text)
            case syntax.Act():
                return self._modified(self._act, text)
            case syntax.Wait():
                self._refuse_keep(text.modifiers)
                return self._modified(self._wait, text)
            case syntax.Emit():
                self._refuse_keep(text.modifiers)
                return self._modified(self._emit, text)

    def is_modifier(self, text: syntax.Act) -> bool:
        """Whether a call in a body or composition is of a modifier."""
        path = str(text.call.path)
        return path in self.declared.modifiers and path not in self.declared.actions

    def wrapped(self, child: Behavior | None, modifiers: Iterable[syntax.Act]) -> Behavior | None:
        """Return `child` with the modifiers that stand beside it, the first outermost."""
        calls = []
        for text in modifiers:
            if text.modifiers:
                self.fault(text.call.place, "got a modifier of a modifier", "one after the other")
            calls.append(text.call)
        return self._applied(child, calls)

    def _composition(self, text: syntax.Composition) -> Behavior:
        modifiers = [member for member in text.members if isinstance(member, syntax.Act) and self.is_modifier(member)]
        members = [member for member in text.members if all(member is not one for one in modifiers)]

        def composed(text: syntax.Composition) -> Behavior:
            if not members:
                self.fail(text.place, f"got an empty {text.kind}", "one action or more in it")
            return Composition(text.kind, tuple(self.each(self.behavior, members)), _label(text), text.place)

        self._refuse_keep(text.modifiers)
        return self._modified(composed, text, modifiers)

    def _refuse_keep(self, text: syntax.With) -> None:
        for item in text:
            if isinstance(item, syntax.Keep):
                self.fault(item.place, "got 'keep' where nothing has members", "'keep' below an action")

    def _modified(
        self, check: Callable[[Modifiable], Behavior], text: Modifiable, beside: Sequence[syntax.Act] = ()
    ) -> Behavior:
        """Return what `check` makes of `text` with the modifiers beside it and below `with:`, the first outermost.

        `until` stands outside of them.
        """
        child = self.wrapped(self.attempt(check, text), beside)
        if [self.attempt(self.refuse, item) for item in text.modifiers if isinstance(item, syntax.Refused)]:
            child = None
        child = self._applied(child, [item for item in text.modifiers if isinstance(item, syntax.Call)])
        for until in reversed([item for item in text.modifiers if isinstance(item, syntax.Until)]):
            awaited = self.attempt(self._awaited, until.awaited)
            child = None if child is None or awaited is None else Until(awaited, child, until.place)
        if child is None:
            raise Faulty
        return child

    def _applied(self, child: Behavior | None, calls: Sequence[syntax.Call]) -> Behavior | None:
        for call in reversed(calls):
            name = str(call.path)
            arguments = self.attempt(self._modifier_arguments, call, name)
            child = None if child is None or arguments is None else Modified(name, arguments, child, call.place)
        return child

    def _modifier_arguments(self, call: syntax.Call, name: str) -> Mapping[str, Expression]:
        modifier = self.declared.modifiers.get(name)
        if modifier is None:
            hint = did_you_mean(name, self.declared.modifiers, "'import osc.helpers', which declares the modifiers")
            self.fail(call.place, f"unknown modifier {name!r}", hint)
        if name not in MODIFIERS:
            self.fault(call.place, f"modifier {name!r} can't be executed", "a modifier of osc.helpers")
        return self._arguments(call, modifier, name)

    def _arguments(
        self, call: syntax.Call, declared: Compound, whose: str, keeps: Sequence[syntax.Keep] = ()
    ) -> Mapping[str, Expression]:
        """Return all arguments of a call; what `keep` says takes the place of what stands in the brackets."""
        given = self.arguments(call, declared.members, whose)
        members = {
            name: replace(member, default=given.get(name, member.default)) for name, member in declared.members.items()
        }
        for keep in keeps:
            members = self.keep(keep, members)
        return self.complete(changed(members, declared.members), declared.members, call.place, whose)

    def _act(self, text: syntax.Act) -> Behavior:
        words = text.call.path.words
        action = self._action(words[0]) if len(words) == 1 else self._action_of(words)
        keeps = [item for item in text.modifiers if isinstance(item, syntax.Keep)]
        arguments = self._arguments(text.call, action, str(text.call.path), keeps)
        # The library action that an action inherits from is what is done, or else the action itself.
        chain = (action, *(self.declared.actions[base][0] for base in action.bases))
        name = next((each.name for each in chain if each.origin in library_names()), action.name)
        return Call(name, words[0].text if len(words) == 2 else "", arguments, _label(text), text.call.place)

    def _action(self, name: syntax.Word) -> Compound:
        known = self.declared.actions.get(name.text, ())
        if not known:
            self.fail(name.place, f"unknown action '{name}'", self._right_action(name.text))
        if len(known) > 1:
            origins = " and ".join(action.origin for action in known)
            right = "one import of them, or an action of another name"
            self.fail(name.place, f"'{name}' is declared by {origins}", right)
        return known[0]

    def _right_action(self, name: str) -> str:
        if owners := [action for action in self.declared.actions if action.endswith(f".{name}")]:
            actor = Type(owners[0].partition(".")[0], "actor")
            instances = (key for key, type_ in self.names.types.items() if self.declared.is_a(type_, actor))
            return f"it is an action of {actor}: {next(instances, 'instance')}.{name}(…)"
        if libraries := declaring(name):
            return f"'import {libraries[0]}', which declares it"
        if name in self.declared.scenarios:
            return "an action; a scenario can be inherited from and not be called"
        return did_you_mean(name, [action for action in self.declared.actions if "." not in action], "an import")

    def _action_of(self, words: Sequence[syntax.Word]) -> Compound:
        instance, name = words[0], words[-1]
        type_ = self.names.types.get(instance.text)
        if instance.text in self.names.faulty:
            raise Faulty
        if len(words) > 2 or type_ is None or type_.kind != "actor":
            actors = [key for key, of in self.names.types.items() if of.kind == "actor"]
            hint = did_you_mean(instance.text, actors, "an instance, declared as 'name: actor' in the scenario")
            self.fail(instance.place, f"unknown actor instance '{instance}'", hint)
        chain = (type_.name, *self.declared.actors[type_.name].bases)
        for actor in chain:
            if known := self.declared.actions.get(f"{actor}.{name}"):
                return known[0]
        own = [action.partition(".")[2] for action in self.declared.actions if action.partition(".")[0] in chain]
        libraries = [library for actor in chain for library in declaring(f"{actor}.{name}")]
        hint = f"'import {libraries[0]}', which declares it" if libraries else did_you_mean(name.text, own)
        self.fail(name.place, f"{type_.name} has no action '{name}'", hint)

    def _emit(self, text: syntax.Emit) -> Behavior:
        self._check_event(text.event, (*self.events, *ENDING))
        return Emit(text.event.text, _label(text), text.place)

    def _check_event(self, name: syntax.Word, known: Sequence[str]) -> None:
        if name.text not in known:
            right = did_you_mean(name.text, known, f"'event {name}' in the scenario")
            self.fail(name.place, f"unknown event '{name}'", right)

    def _wait(self, text: syntax.Wait) -> Behavior:
        return Wait(self._awaited(text.awaited), _label(text), text.place)

    def _awaited(self, text: syntax.Awaited) -> Awaited:
        event, condition = text.event, text.condition
        if event is None and isinstance(condition, syntax.Call) and str(condition.path) == "elapsed":
            return self._elapsed(condition)
        if event is not None:
            if len(event.words) > 1:
                self.fail(event.place, f"got event {event}", "an event of the scenario")
            self._check_event(event.words[0], self.events)
        held = None if condition is None else self.assigned(condition, BOOL, "a condition")
        if event is not None:
            return Happened(str(event), held, text.place)
        assert held is not None
        return Holds(held, text.place)

    def _elapsed(self, call: syntax.Call) -> Awaited:
        if len(call.arguments) != 1 or call.arguments[0].name is not None:
            self.fail(call.place, "got elapsed without one duration", "elapsed(3s)")
        text = call.arguments[0].value
        take = self.given if isinstance(text, syntax.Call) else self.assigned
        return Elapsed(take(text, Type("time", "physical"), "a duration"), call.place)


def changed(members: Mapping[str, Field], declared: Mapping[str, Field]) -> dict[str, Expression]:
    """Return the defaults of members that are not the declared ones."""
    defaults = ((name, member.default) for name, member in members.items())
    return {name: value for name, value in defaults if value is not None and value is not declared[name].default}


def _label(text: syntax.Composition | syntax.Act | syntax.Wait | syntax.Emit) -> str:
    return text.label.text if text.label else ""
