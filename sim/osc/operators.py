"""Operators: which types they go with, and which type they give."""

from collections.abc import Mapping
from typing import Final, TypeAlias

from vastflow.sim.osc.declarations import ANY
from vastflow.sim.osc.definition import Type

Physical: TypeAlias = Mapping[str, Mapping[str, int | float]]

INT: Final = Type("int", "basic")
FLOAT: Final = Type("float", "basic")
BOOL: Final = Type("bool", "basic")
STRING: Final = Type("string", "basic")
NUMERIC: Final = frozenset({"int", "uint", "float"})

OPERANDS: Final[Mapping[str, str]] = {
    **dict.fromkeys(("and", "or", "not"), "conditions"),
    **dict.fromkeys(("==", "!="), "values of one type"),
    **dict.fromkeys(("<", "<=", ">", ">="), "numbers, or values of one physical type"),
    "in": "a value, and a list of its type",
    "+": "numbers, values of one physical type, two strings or two lists",
    "-": "numbers, or values of one physical type",
    "%": "numbers, or values of one physical type",
    "*": "numbers, or a value with a unit and a number",
    "/": "numbers, a value with a unit and a number, or values of one physical type",
}


def result_of(operator: str, types: tuple[Type, ...], physical: Physical) -> Type | None:
    """The type an operator gives; None where it does not go with operands of `types`.

    Args:
        physical: Physical types to the exponents of their base units, for products and quotients.
    """
    if operator in ("and", "or", "not"):
        return BOOL if all(type_ in (BOOL, ANY) for type_ in types) else None
    if len(types) == 1:
        (one,) = types
        return one if is_number(one) or (one.kind == "physical" and not one.is_list) else None
    left, right = types
    if operator == "in":
        return BOOL if right.is_list and _comparable(left, Type(right.name, right.kind)) else None
    if operator in ("==", "!="):
        return BOOL if _comparable(left, right) else None
    if left.is_list or right.is_list:
        return left if operator == "+" and left == right else None
    if ANY in types:
        return BOOL if operator in ("<", "<=", ">", ">=") else ANY
    ordered = (is_number(left) and is_number(right)) or (left == right and left.kind == "physical")
    if operator in ("<", "<=", ">", ">="):
        return BOOL if ordered or left == right == STRING else None
    if operator in ("*", "/"):
        return _product(operator, left, right, physical)
    if operator == "+" and left == right == STRING:
        return STRING
    return _wider(left, right) if ordered else None


def _product(operator: str, left: Type, right: Type, physical: Physical) -> Type | None:
    if is_number(left) and is_number(right):
        return FLOAT if operator == "/" else _wider(left, right)
    if left.kind == "physical" and is_number(right):
        return left
    if operator == "*" and is_number(left) and right.kind == "physical":
        return right
    if left.kind != "physical" or right.kind != "physical":
        return None
    if left == right and operator == "/":
        return FLOAT
    exponents = dict(physical[left.name])
    for unit, exponent in physical[right.name].items():
        exponents[unit] = exponents.get(unit, 0) + (exponent if operator == "*" else -exponent)
    wanted = {unit: exponent for unit, exponent in exponents.items() if exponent}
    same = [name for name, of in physical.items() if dict(of) == wanted]
    return Type(same[0], "physical") if len(same) == 1 else None


def is_number(type_: Type) -> bool:
    """Whether values of a type are plain numbers."""
    return type_.name in NUMERIC and not type_.is_list


def _wider(left: Type, right: Type) -> Type:
    return left if left == right else FLOAT if FLOAT in (left, right) else INT


def _comparable(left: Type, right: Type) -> bool:
    return left == right or ANY in (left, right) or (is_number(left) and is_number(right))
