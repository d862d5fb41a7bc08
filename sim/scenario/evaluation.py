"""Values of expressions, and the names that they need."""

import math
import operator
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.scenario.definition import Constant, Expression, External, ListOf, Name, Operation, Struct

OPERATORS: Final[Mapping[str, Callable[[Any, Any], Any]]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "%": operator.mod,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def evaluate(expression: Expression, names: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> Any:
    """Return the value of an expression at this moment.

    A struct is a dict by member, a list a list, a member of an enumeration an `EnumValue`, something with a unit a float
    in SI units; behind a text, `+` joins the text of what follows. `and` and `or` look at their right side only where it matters; `/` gives a float.

    Args:
        names: Values of parameters, variables and actors; members of structs and actors by mappings.
        functions: External functions by struct and name, such as `random.get_int`.

    Raises:
        ScenarioError: an operation or a function is not to be done with its operands, or a name has no value.
    """
    match expression:
        case Constant(value=value):
            return value
        case Name(path=path, place=place):
            found: Any = names
            for depth, part in enumerate(path):
                if not isinstance(found, Mapping) or part not in found:
                    raise ScenarioError(f"{place}: {'.'.join(path[: depth + 1])} has no value")
                found = found[part]
            return found
        case Struct(members=members):
            return {name: evaluate(member, names, functions) for name, member in members.items()}
        case ListOf(items=items):
            return [evaluate(item, names, functions) for item in items]
        case Operation():
            return _operation(expression, names, functions)
        case External(function=name, arguments=given, place=place):
            arguments = [evaluate(argument, names, functions) for argument in given]
            if name not in functions:
                raise ScenarioError(f"{place}: {name}() is not available here")
            try:
                return functions[name](*arguments)
            except (TypeError, ValueError, ArithmeticError, LookupError, OSError) as error:
                raise ScenarioError(f"{place}: {name}() can't be done: {error}") from None


def _operation(operation: Operation, names: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> Any:
    sign = operation.operator
    left = evaluate(operation.operands[0], names, functions)
    if sign in ("and", "or"):
        decided = bool(left) is (sign == "or")
        return bool(left) if decided else bool(evaluate(operation.operands[1], names, functions))
    if sign == "not":
        return not left
    try:
        if len(operation.operands) == 1:
            return -left
        right = evaluate(operation.operands[1], names, functions)
        if sign == "+" and isinstance(left, str):
            return left + text_of(right)
        value = left in right if sign == "in" else OPERATORS[sign](left, right)
    except (TypeError, OverflowError, ZeroDivisionError) as error:
        raise ScenarioError(f"{operation.place}: {sign!r} can't be done: {error}") from None
    if isinstance(value, float) and not math.isfinite(value):
        raise ScenarioError(f"{operation.place}: {sign!r} gives a number that is too large")
    return value


def parts_of(expression: Expression) -> Iterator[Expression]:
    """Yield an expression and all that it is made of."""
    yield expression
    match expression:
        case ListOf(items=parts) | Operation(operands=parts) | External(arguments=parts):
            for part in parts:
                yield from parts_of(part)
        case Struct(members=members):
            for part in members.values():
                yield from parts_of(part)


def names_in(expression: Expression) -> tuple[str, ...]:
    """Return the names of all parameters, variables, globals, and actors in an expression, in its order."""
    return tuple(dict.fromkeys(part.path[0] for part in parts_of(expression) if isinstance(part, Name)))


def text_of(value: Any) -> str:
    """Return a value as a program's argument."""
    return str(value).lower() if isinstance(value, bool) else str(value)
