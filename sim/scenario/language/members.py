"""Checking fields and variables, and the `keep` that gives them values."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from vastflow.sim.model.faults import Got
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.scenario.definition import Expression, Field, Name, Struct, Type, below_of
from vastflow.sim.scenario.language import syntax
from vastflow.sim.scenario.language.declarations import ANY, VARIABLE
from vastflow.sim.scenario.language.expressions import ExpressionChecker

RESERVED: Final = frozenset({"kg", "m", "s", "A", "K", "mol", "cd", "rad"})
"""Base units, which the language keeps for itself."""


def unit_of(text: syntax.Expression | None) -> str:
    """Return the unit of a value as written; empty for one without."""
    return text.unit.text if isinstance(text, syntax.Physical) else ""


class MemberChecker(ExpressionChecker):
    """Checks fields, variables, and `keep`."""

    def ensure(self, name: str) -> None:
        """Declare a type that is declared further down, before it is looked up."""

    def type_of(self, text: syntax.Type) -> Type:
        """Return the type that is named."""
        name = text.name.text
        self.ensure(name)
        if self.of_library and name in (ANY.name, VARIABLE.name):
            return Type(name, "basic", text.is_list)
        if type_ := self.declared.type_named(name, text.is_list):
            return type_
        self.fail(text.name.place, f"unknown type {name!r}", self.declared.right_type(name, self.declared.type_names))

    def allowed(self, name: syntax.Word) -> bool:
        """Whether something may be called so."""
        if name.text in RESERVED:
            self.fault(name.place, f"{name.text!r} is a base unit, a reserved word", "choose another name")
        return name.text not in RESERVED

    def fields(self, text: syntax.Field) -> list[Field]:
        """Return the members that a field declares, with values from `keep`, without faulty ones."""
        type_ = self.attempt(self.type_of, text.type)
        words = [name for name in text.names if self.allowed(name)]
        if type_ is None:
            return []
        default: Expression | None = None
        if text.default is not None:
            whose = ", ".join(f"'{name}'" for name in text.names)
            default = self.attempt(self.assigned, text.default, type_, whose)
            if default is None:
                return []
        if type_.kind != "actor":  # an instance's members are checked with the instance
            for item in text.keeps:
                if (target := self.attempt(self._target, item)) is not None:
                    default = self._with_value(default, type_, *target)
        unit = unit_of(text.default)
        return [Field(name.text, type_, default, name.place, unit, text.is_variable) for name in words]

    def types(self, text: syntax.Member) -> dict[str, Type]:
        """Return the names that a member declares as fields, with their types."""
        type_ = self.attempt(self.type_of, text.type) if isinstance(text, syntax.Field) else None
        return {name.text: type_ for name in text.names} if isinstance(text, syntax.Field) and type_ else {}

    def overriding(self, member: Field, inherited: Field) -> Field:
        """Return a member that is declared again: with its new default, or the inherited one."""
        if not self.declared.is_a(member.type, inherited.type):
            what = f"{member.name!r} is declared already, as {inherited.type}"
            self.fault(member.place, what, f"expected {inherited.type}, or another name")
        return member if member.default else replace(member, default=inherited.default, unit=inherited.unit)

    def keep(self, text: syntax.WithItem, members: Mapping[str, Field]) -> dict[str, Field]:
        """Return `members` with the value that a `keep` about their owner gives one of them."""
        kept = dict(members)
        target = self.attempt(self._target, text)
        if target is None:
            return kept
        (first, *rest), value = target
        member = members.get(first.text)
        if member is None:
            self.fault(first.place, f"no member '{first}'", did_you_mean(first.text, members))
        elif rest:
            kept[first.text] = replace(member, default=self._with_value(member.default, member.type, rest, value))
        elif given := self.attempt(self.given, value, member.type, f"'{first}'"):
            kept[first.text] = replace(member, default=given, unit=unit_of(value))
        return kept

    def _target(self, item: syntax.WithItem) -> tuple[Sequence[syntax.Word], syntax.Expression]:
        """Return the path below `it` and the value of `keep(it.path == value)`."""
        if isinstance(item, syntax.Refused):
            self.refuse(item)
        right = "'keep(it.member == value)'"
        if not isinstance(item, syntax.Keep):
            self.fail(item.place, Got("a modifier of a field"), right)
        match item.condition:
            case syntax.Operation("==", (syntax.Path((syntax.Word("it"), *path)), value)) if path:
                return path, value
            case syntax.Operation(operator="in"):
                right = "'keep(it.member == parameter)', and a ParameterVariationList of the parameter in the campaign"
                self.fail(item.place, Got("a 'keep' with several values"), right)
        self.fail(item.place, Got("a 'keep' that gives no value"), right)

    def _with_value(
        self, default: Expression | None, type_: Type, path: Sequence[syntax.Word], value: syntax.Expression
    ) -> Expression | None:
        """Return `default`, of type `type_`, with a value at `path`, or as it was if the value has a fault."""
        first, *rest = path
        members = self.declared.members_of(type_)
        if first.text not in members:
            right = did_you_mean(first.text, members, "give it a value as a whole")
            self.fault(first.place, f"a {type_} has no member '{first}'", right)
            return default
        whole = default or self.declared.default_of(type_, first.place)
        if isinstance(whole, Name):
            whole = Struct(type_.name, {name: below_of(whole, [name]) for name in members}, whole.place)
        if not isinstance(whole, Struct):
            self.fault(first.place, Got(f"a 'keep' below a {type_} without value"), f"{type_.name}(…)")
            return default
        member = members[first.text].type
        if rest:
            below = self._with_value(whole.members[first.text], member, rest, value)
        else:
            below = self.attempt(self.given, value, member, f"'{first}'")
        return default if below is None else replace(whole, members={**whole.members, first.text: below})
