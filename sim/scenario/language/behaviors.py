"""Checking what a scenario does: compositions, calls of actions, waits, and the modifiers round them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from vastflow.sim.model.names import did_you_mean
from vastflow.sim.scenario.definition import (
    Awaited,
    Behavior,
    Call,
    Composition,
    Elapsed,
    Emit,
    Expression,
    Happened,
    Holds,
    Modified,
    Type,
    Until,
    Wait,
)
from vastflow.sim.scenario.language.declarations import BOOL, Compound, Declarations
from vastflow.sim.scenario.language.declaring import declaring, library_names
from vastflow.sim.scenario.language.expressions import ExpressionChecker, Visible
from vastflow.sim.scenario.language.members import MemberChecker
from vastflow.sim.scenario.language.syntax import (
    ActText,
    AwaitedText,
    BehaviorText,
    CallText,
    CompositionText,
    EmitText,
    KeepText,
    RefusedText,
    UntilText,
    WaitText,
    WithText,
    Word,
)

ENDING: Final = ("end", "fail", "start")
"""Events that every scenario has; nothing follows from the last."""

MODIFIERS: Final = frozenset(
    {
        "failure_is_running",
        "failure_is_success",
        "inverter",
        "repeat",
        "retry",
        "running_is_failure",
        "running_is_success",
        "success_is_failure",
        "success_is_running",
        "timeout",
    }
)
"""Those that are executed; others can be declared and not used."""


@dataclass(frozen=True, slots=True)
class BehaviorChecker:
    """Checks behaviors of one scenario; what is wrong goes to the faults of `expressions`.

    Attributes:
        names: Parameters, variables and actors of the scenario.
        events: Declared in it.
    """

    declared: Declarations
    expressions: ExpressionChecker
    members: MemberChecker
    names: Visible
    events: Sequence[str]

    def behavior(self, text: BehaviorText) -> Behavior | None:
        """Return the checked behavior, or None if it has a fault."""
        match text:
            case RefusedText():
                self.expressions.refuse(text)
                return None
            case CompositionText():
                return self._composition(text)
            case ActText():
                return self._modified(self._call(text), text.modifiers)
            case WaitText():
                self._refuse_keep(text.modifiers)
                awaited = self._awaited(text.awaited)
                wait = None if awaited is None else Wait(awaited, _label(text.label), text.place)
                return self._modified(wait, text.modifiers)
            case EmitText():
                self._refuse_keep(text.modifiers)
                return self._modified(self._emit(text), text.modifiers)

    def is_modifier(self, text: ActText) -> bool:
        """Whether a call in a body or composition is of a modifier."""
        path = str(text.call.path)
        return path in self.declared.modifiers and path not in self.declared.actions

    def wrapped(self, child: Behavior | None, modifiers: Iterable[ActText]) -> Behavior | None:
        """`child` with the modifiers that stand beside it, the first outermost."""
        calls = []
        for text in modifiers:
            if text.modifiers:
                self.expressions.fault(text.call.place, "got a modifier of a modifier", "one after the other")
            calls.append(text.call)
        return self._applied(child, calls)

    def _composition(self, text: CompositionText) -> Behavior | None:
        modifiers = [member for member in text.members if isinstance(member, ActText) and self.is_modifier(member)]
        members = [member for member in text.members if all(member is not one for one in modifiers)]
        if not members:
            self.expressions.fault(text.place, f"got an empty {text.kind}", "one action or more in it")
        children = [self.behavior(member) for member in members]
        composition: Behavior | None = None
        if members and None not in children:
            done = tuple(child for child in children if child is not None)
            composition = Composition(text.kind, done, _label(text.label), text.place)
        self._refuse_keep(text.modifiers)
        return self._modified(self.wrapped(composition, modifiers), text.modifiers)

    def _refuse_keep(self, text: WithText) -> None:
        for item in text:
            if isinstance(item, KeepText):
                self.expressions.fault(item.place, "got 'keep' where nothing has members", "'keep' below an action")

    def _modified(self, child: Behavior | None, text: WithText) -> Behavior | None:
        """`child` with what its `with:` block says: modifiers, the first outermost, and `until` outside of them."""
        calls: list[CallText] = []
        untils: list[UntilText] = []
        for item in text:
            match item:
                case CallText():
                    calls.append(item)
                case UntilText():
                    untils.append(item)
                case KeepText():
                    pass  # gives an argument of the action above
                case RefusedText():
                    self.expressions.refuse(item)
                    child = None
        child = self._applied(child, calls)
        for until in reversed(untils):
            awaited = self._awaited(until.awaited)
            child = None if child is None or awaited is None else Until(awaited, child, until.place)
        return child

    def _applied(self, child: Behavior | None, calls: Sequence[CallText]) -> Behavior | None:
        for call in reversed(calls):
            name = str(call.path)
            modifier = self.declared.modifiers.get(name)
            if modifier is None:
                known = self.declared.modifiers
                hint = did_you_mean(name, known, "'import osc.helpers', which declares the modifiers")
                self.expressions.fault(call.place, f"unknown modifier {name!r}", hint)
            elif name not in MODIFIERS:
                self.expressions.fault(call.place, f"modifier {name!r} can't be executed", "a modifier of osc.helpers")
            arguments = None if modifier is None else self._arguments(call, modifier, name)
            child = None if child is None or arguments is None else Modified(name, arguments, child, call.place)
        return child

    def _arguments(
        self, call: CallText, declared: Compound, whose: str, keeps: Sequence[KeepText] = ()
    ) -> Mapping[str, Expression] | None:
        """All arguments of a call; what `keep` says takes the place of what stands in the brackets."""
        given = self.expressions.arguments(call.arguments, declared.members, self.names, whose)
        if given is None:
            return None
        members = {
            name: replace(member, default=given.get(name, member.default)) for name, member in declared.members.items()
        }
        for keep in keeps:
            members = self.members.keep(keep, members, self.names)
        changed = {
            name: member.default
            for name, member in members.items()
            if member.default is not None and member.default is not declared.members[name].default
        }
        return self.expressions.complete(changed, declared.members, call.place, whose)

    def _call(self, text: ActText) -> Behavior | None:
        words = text.call.path.words
        action = self._action(words[0]) if len(words) == 1 else self._action_of(words)
        if action is None:
            return None
        keeps = [item for item in text.modifiers if isinstance(item, KeepText)]
        arguments = self._arguments(text.call, action, str(text.call.path), keeps)
        if arguments is None:
            return None
        actor = words[0].text if len(words) == 2 else ""
        return Call(self._done_by(action), actor, arguments, _label(text.label), text.call.place)

    def _done_by(self, action: Compound) -> str:
        """Return the library action that an action inherits from, or its own name if there is none."""
        chain = (action, *(self.declared.actions[base][0] for base in action.bases))
        return next((each.name for each in chain if each.origin in library_names()), action.name)

    def _action(self, name: Word) -> Compound | None:
        known = self.declared.actions.get(name.text, ())
        if len(known) == 1:
            return known[0]
        if known:
            origins = " and ".join(action.origin for action in known)
            right = "one import of them, or an action of another name"
            self.expressions.fault(name.place, f"{name.text!r} is declared by {origins}", right)
            return None
        self.expressions.fault(name.place, f"unknown action {name.text!r}", self._right_action(name.text))
        return None

    def _right_action(self, name: str) -> str:
        if owners := [action for action in self.declared.actions if action.endswith(f".{name}")]:
            actor = owners[0].partition(".")[0]
            instances = [key for key, type_ in self.names.types.items() if self._is_instance(type_, actor)]
            return f"it is an action of {actor}: {instances[0] if instances else 'instance'}.{name}(…)"
        if libraries := declaring(name):
            return f"'import {libraries[0]}', which declares it"
        if name in self.declared.scenarios:
            return "an action; a scenario can be inherited from and not be called"
        return did_you_mean(name, [action for action in self.declared.actions if "." not in action], "an import")

    def _is_instance(self, type_: Type, actor: str) -> bool:
        return self.declared.is_a(type_, Type(actor, "actor"))

    def _action_of(self, words: Sequence[Word]) -> Compound | None:
        instance, name = words[0], words[-1]
        type_ = self.names.types.get(instance.text)
        if instance.text in self.names.faulty:
            return None
        if len(words) > 2 or type_ is None or type_.kind != "actor":
            actors = [key for key, of in self.names.types.items() if of.kind == "actor"]
            hint = did_you_mean(instance.text, actors, "an instance, declared as 'name: actor' in the scenario")
            self.expressions.fault(instance.place, f"unknown actor instance {instance.text!r}", hint)
            return None
        chain = (type_.name, *self.declared.actors[type_.name].bases)
        for actor in chain:
            if known := self.declared.actions.get(f"{actor}.{name.text}"):
                return known[0]
        own = [action.partition(".")[2] for action in self.declared.actions if action.partition(".")[0] in chain]
        libraries = [library for actor in chain for library in declaring(f"{actor}.{name.text}")]
        hint = f"'import {libraries[0]}', which declares it" if libraries else did_you_mean(name.text, own)
        self.expressions.fault(name.place, f"{type_.name} has no action {name.text!r}", hint)
        return None

    def _emit(self, text: EmitText) -> Behavior | None:
        if not self._is_event(text.event, (*self.events, *ENDING)):
            return None
        return Emit(text.event.text, _label(text.label), text.place)

    def _is_event(self, name: Word, known: Sequence[str]) -> bool:
        if name.text in known:
            return True
        right = did_you_mean(name.text, known, f"'event {name.text}' in the scenario")
        self.expressions.fault(name.place, f"unknown event {name.text!r}", right)
        return False

    def _awaited(self, text: AwaitedText) -> Awaited | None:
        condition = text.condition
        if text.event is not None:
            return self._happened(text)
        if isinstance(condition, CallText) and str(condition.path) == "elapsed":
            return self._elapsed(condition)
        assert condition is not None
        value = self.expressions.assigned(condition, BOOL, self.names, "a condition")
        return None if value is None else Holds(value, text.place)

    def _happened(self, text: AwaitedText) -> Awaited | None:
        assert text.event is not None
        if len(text.event.words) > 1:
            self.expressions.fault(text.event.place, f"got event {text.event}", "an event of the scenario")
            return None
        if not self._is_event(text.event.words[0], self.events):
            return None
        if text.condition is None:
            return Happened(str(text.event), None, text.place)
        condition = self.expressions.assigned(text.condition, BOOL, self.names, "a condition")
        return None if condition is None else Happened(str(text.event), condition, text.place)

    def _elapsed(self, call: CallText) -> Awaited | None:
        if len(call.arguments) != 1 or call.arguments[0].name is not None:
            self.expressions.fault(call.place, "got elapsed without one duration", "elapsed(3s)")
            return None
        wanted = Type("time", "physical")
        text = call.arguments[0].value
        take = self.expressions.given if isinstance(text, CallText) else self.expressions.assigned
        duration = take(text, wanted, self.names, "a duration")
        return None if duration is None else Elapsed(duration, call.place)


def _label(label: Word | None) -> str:
    return label.text if label else ""
