"""Checking fields and variables, and the `keep` that gives them values."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Final

from vastflow.sim.model.names import did_you_mean
from vastflow.sim.scenario.definition import Expression, Field, Name, Struct, Type, below_of
from vastflow.sim.scenario.language.declarations import ANY, VARIABLE, Declarations
from vastflow.sim.scenario.language.expressions import ExpressionChecker, Visible
from vastflow.sim.scenario.language.syntax import (
    CallText,
    ExpressionText,
    FieldText,
    KeepText,
    MemberText,
    OperationText,
    PathText,
    PhysicalText,
    RefusedText,
    TypeText,
    UntilText,
    Word,
)

RESERVED: Final = frozenset({"kg", "m", "s", "A", "K", "mol", "cd", "rad"})
"""Base units, which the language keeps for itself."""


def unit_of(text: ExpressionText | None) -> str:
    """The unit in which a value is written; empty for one without."""
    return text.unit.text if isinstance(text, PhysicalText) else ""


def nothing_more(name: str) -> None:
    """All that is declared is declared."""


class MemberChecker:
    """Checks fields against declarations.

    Args:
        ensure: Called with the name of a type before it is looked up, so that it may be declared further down.
    """

    def __init__(
        self,
        declared: Declarations,
        expressions: ExpressionChecker,
        *,
        ensure: Callable[[str], None] = nothing_more,
    ) -> None:
        self._declared = declared
        self._expressions = expressions
        self._ensure = ensure

    def type_of(self, text: TypeText) -> Type | None:
        """The type that is named; None and a fault where there is none."""
        name = text.name.text
        self._ensure(name)
        if self._expressions.of_library and name in (ANY.name, VARIABLE.name):
            return Type(name, "basic", text.is_list)
        type_ = self._declared.type_named(name, text.is_list)
        if type_ is None:
            right = self._expressions.right_type(name, self._declared.type_names())
            self._expressions.fault(text.name.place, f"unknown type {name!r}", right)
        return type_

    def allowed(self, name: Word) -> bool:
        """Whether something may be called so."""
        if name.text in RESERVED:
            self._expressions.fault(name.place, f"{name.text!r} is a base unit, a reserved word", "another name")
            return False
        return True

    def fields(self, text: FieldText, names: Visible) -> list[Field]:
        """The members that a field declares, with what `keep` below it gives them; those with a fault are left out."""
        type_ = self.type_of(text.type)
        words = [name for name in text.names if self.allowed(name)]
        if type_ is None:
            return []
        default = None
        if text.default is not None:
            whose = ", ".join(repr(name.text) for name in text.names)
            default = self._expressions.assigned(text.default, type_, names, whose)
            if default is None:
                return []
        if type_.kind != "actor":  # an instance's members are checked with the instance
            for item in text.keeps:
                if not isinstance(item, KeepText):
                    self.refuse_modifier(item)
                elif (target := self._target(item)) is not None:
                    default = self._with_value(default, type_, *target, names)
        unit = unit_of(text.default)
        return [Field(name.text, type_, default, name.place, unit, text.is_variable) for name in words]

    def types(self, text: MemberText) -> Iterator[tuple[str, Type]]:
        """The names that a member declares as fields, with their types."""
        if isinstance(text, FieldText) and (type_ := self.type_of(text.type)) is not None:
            yield from ((name.text, type_) for name in text.names)

    def overriding(self, member: Field, inherited: Field) -> Field:
        """A member that is declared again below what it is inherited from: with the new default, else the old one."""
        if not self._declared.is_a(member.type, inherited.type):
            what = f"{member.name!r} is declared already, as {inherited.type}"
            self._expressions.fault(member.place, what, f"{inherited.type}, or another name")
        return member if member.default else replace(member, default=inherited.default, unit=inherited.unit)

    def keep(self, text: KeepText, members: Mapping[str, Field], names: Visible) -> dict[str, Field]:
        """`members` with the value that a `keep` about their owner gives one of them."""
        kept = dict(members)
        target = self._target(text)
        if target is None:
            return kept
        (first, *rest), value = target
        member = members.get(first.text)
        if member is None:
            self._expressions.fault(first.place, f"no member {first.text!r}", did_you_mean(first.text, members))
        elif rest:
            default = self._with_value(member.default, member.type, tuple(rest), value, names)
            kept[first.text] = replace(member, default=default)
        else:
            given = self._expressions.given(value, member.type, names, repr(first.text))
            if given is not None:
                kept[first.text] = replace(member, default=given, unit=unit_of(value))
        return kept

    def refuse_modifier(self, item: CallText | UntilText | RefusedText) -> None:
        """Take down that something in a `with:` block below a field is no `keep`."""
        if isinstance(item, RefusedText):
            self._expressions.refuse(item)
        else:
            self._expressions.fault(item.place, "got a modifier of a field", "'keep(it.member == value)'")

    def _target(self, text: KeepText) -> tuple[tuple[Word, ...], ExpressionText] | None:
        """The path below `it` and the value of `keep(it.path == value)`."""
        match text.condition:
            case OperationText(operator="==", operands=(PathText(words=(Word(text="it"), *path)), value)) if path:
                return tuple(path), value
            case OperationText(operator="in"):
                right = "'keep(it.member == parameter)', and a ParameterVariationList of the parameter in the campaign"
                self._expressions.fault(text.place, "got a 'keep' with several values", right)
                return None
        self._expressions.fault(text.place, "got a 'keep' that gives no value", "'keep(it.member == value)'")
        return None

    def _with_value(
        self, default: Expression | None, type_: Type, path: tuple[Word, ...], value: ExpressionText, names: Visible
    ) -> Expression | None:
        """`default`, of type `type_`, with a value at `path` below it; as it was where the value is at fault."""
        first, *rest = path
        members = self._declared.members_of(type_)
        if first.text not in members:
            right = did_you_mean(first.text, members, "a value for it as a whole")
            self._expressions.fault(first.place, f"a {type_} has no member {first.text!r}", right)
            return default
        whole = default or self._declared.default_of(type_, first.place)
        if isinstance(whole, Name):
            whole = Struct(type_.name, {name: below_of(whole, [name]) for name in members}, whole.place)
        if not isinstance(whole, Struct):
            self._expressions.fault(first.place, f"got a 'keep' below a {type_} without value", f"{type_.name}(…)")
            return default
        member = members[first.text]
        if rest:
            below = self._with_value(whole.members[first.text], member.type, tuple(rest), value, names)
        else:
            below = self._expressions.given(value, member.type, names, repr(first.text))
        if below is None:
            return default
        return Struct(whole.type, {**whole.members, first.text: below}, whole.place)
