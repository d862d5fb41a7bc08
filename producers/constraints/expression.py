"""Expressions of constraints: a small language over the values of a configuration, without Python's eval.

Numbers, text in quotes, `true` and `false`, names, lists; `+ - * / % **`, comparisons that may be chained,
`and or not implies in`, the functions of `vastflow.producers.constraints.operations`, parentheses. Operators bind as in
Python; `implies` is the weakest and groups to the right.
"""

import functools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from lark import Lark, Token, Transformer, UnexpectedCharacters, UnexpectedEOF, UnexpectedToken, v_args
from lark.exceptions import VisitError

from vastflow.producers.constraints.operations import (
    FUNCTIONS,
    NotEvaluable,
    ValueKind,
    arithmetic,
    called,
    compared,
    contained,
    kind_of,
    negative,
    result_kind,
    spelled,
)
from vastflow.sim.model.names import did_you_mean

__all__ = ["ConstraintExpression", "ExpressionFault", "ExpressionName", "NotEvaluable", "expression_of"]

MOST_CHARACTERS: Final = 2_000
MOST_NESTED: Final = 60

GRAMMAR: Final = r"""
start: truth
?truth: either | either IMPLIES truth -> implies
?either: both | either OR both -> disjunction
?both: negation | both AND negation -> conjunction
?negation: comparison | NOT negation -> negation
?comparison: sum | sum (relation sum)+ -> comparison
relation: RELATION | IN | NOT IN
?sum: product | sum ADD product -> binary
?product: signed | product TIMES signed -> binary
?signed: power | ADD signed -> signed
?power: atom | atom POWER signed -> binary
?atom: NUMBER -> number
     | TEXT -> text
     | TRUTH -> truth
     | NAME -> name
     | KEY -> key
     | CALL "(" [truth ("," truth)*] ")" -> call
     | "(" truth ")" -> group
     | "[" [truth ("," truth)*] "]" -> listed

IMPLIES: /implies\b/
OR: /or\b/
AND: /and\b/
NOT: /not\b/
IN: /in\b/
TRUTH: /(true|false|True|False)\b/
RELATION: /<=|>=|==|!=|<|>/
ADD: /[+-]/
TIMES: /\*(?!\*)|\/(?!\/)|%/
POWER: "**"
NUMBER: /(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?(?![\w.])/
TEXT: /"[^"\n]*"|'[^'\n]*'/
CALL.2: /(?!(implies|or|and|not|in)\b)[A-Za-z_]\w*(?=\s*\()/
NAME: /(?!(implies|or|and|not|in|true|false|True|False)\b)[A-Za-z_]\w*(\.[A-Za-z_]\w*|\[\d+\])*/
KEY: /`[^`\n]+`/
%ignore /\s+/
"""
_PART: Final = re.compile(r"[A-Za-z_]\w*|\d+")
SLIPS: Final = {"=": "'==' to compare", "&": "'and'", "|": "'or'", "!": "'not' or '!='", "/": "'/'", "^": "'**'"}

Look: TypeAlias = Callable[["ExpressionName"], Any]
"""Gives the value of a name; raises `NotEvaluable` where there is none."""


class ExpressionFault(Exception):
    """What is wrong with an expression's text.

    Attributes:
        offset: Where, in characters from the beginning of the text.
    """

    def __init__(self, offset: int, what: str, right: str) -> None:
        super().__init__(f"{what}; {right}")
        self.offset = offset
        self.what = what
        self.right = right


@dataclass(frozen=True, slots=True)
class ExpressionName:
    """A name in an expression.

    Attributes:
        text: As it is written, without backticks.
        offset: Where it stands first.
        readings: What it can mean, the longest key first: a key of the configuration, and what follows inside of
            its value. `goal_pose.x` is the key `goal_pose.x` or `x` of `goal_pose`.
    """

    text: str
    offset: int
    readings: tuple[tuple[str, tuple[str | int, ...]], ...]


@dataclass(frozen=True, slots=True)
class ConstraintExpression:
    """An expression that is true or false of a configuration.

    Attributes:
        names: In order of appearance, each once.
    """

    text: str
    names: tuple[ExpressionName, ...]
    _evaluate: Callable[[Look], Any]

    def holds(self, look: Look) -> bool:
        """Whether it is true.

        Raises:
            NotEvaluable: neither, and why.
        """
        found = self._evaluate(look)
        if not isinstance(found, bool):
            raise NotEvaluable(f"the whole is {spelled(found)}, not true or false")
        return found


def expression_of(text: str) -> ConstraintExpression:
    """Parse an expression.

    Raises:
        ExpressionFault: the first thing wrong with it.
    """
    if len(text) > MOST_CHARACTERS:
        raise ExpressionFault(
            MOST_CHARACTERS, f"{len(text)} characters", f"at most {MOST_CHARACTERS}; several constraints"
        )
    if not text.strip():
        raise ExpressionFault(0, "found nothing", "an expression such as 'robot_radius < 0.3'")
    try:
        node: _Node = _parser().parse(text)  # type: ignore[assignment]
    except VisitError as error:
        raise error.orig_exc from None
    except UnexpectedCharacters as error:
        raise _unreadable(text, error.pos_in_stream or 0, error.allowed or ()) from None
    except UnexpectedToken as error:
        at = len(text.rstrip()) if error.token.type == "$END" else error.token.start_pos or 0
        raise _unreadable(text, at, error.expected) from None
    except UnexpectedEOF as error:
        raise _unreadable(text, len(text.rstrip()), error.expected) from None
    if node.kind not in (None, "truth"):
        raise ExpressionFault(node.offset, f"the whole is {spelled(node.kind)}", "a comparison: true or false")
    names: dict[str, ExpressionName] = {}
    for name in node.names:
        names.setdefault(name.text, name)
    return ConstraintExpression(text, tuple(names.values()), node.evaluate)


@functools.cache
def _parser() -> Lark:
    return Lark(GRAMMAR, parser="lalr", transformer=_Builder())


def _unreadable(text: str, at: int, expected: Sequence[str] | set[str]) -> ExpressionFault:
    found = text[at : at + 20].split()
    what = f"found {found[0]!r}" if found else "the expression ends too early"
    if found and found[0][0] in SLIPS:
        return ExpressionFault(at, what, SLIPS[found[0][0]])
    if "NUMBER" in expected:
        return ExpressionFault(at, what, "a number, a name, text in quotes or '('")
    closing = next((mark for kind, mark in (("RPAR", "')'"), ("RSQB", "']'")) if kind in expected), "the end")
    if expected and not set(expected) & {"AND", "ADD", "OR"}:
        return ExpressionFault(at, what, f"{closing}")
    return ExpressionFault(at, what, f"an operator such as '<', 'and' or '*', or {closing}")


@dataclass(frozen=True, slots=True)
class _Node:
    """A part of an expression.

    Attributes:
        kind: Of its value as far as it is known without values.
        names: All that are in it, in order.
    """

    offset: int
    depth: int
    kind: ValueKind | None
    evaluate: Callable[[Look], Any]
    names: tuple[ExpressionName, ...]
    is_name: bool


@v_args(inline=True)
class _Builder(Transformer[Token, _Node]):
    """Makes nodes while the text is parsed, so that nothing recurses deeper than the checked depth."""

    def start(self, node: _Node) -> _Node:
        return node

    def group(self, node: _Node) -> _Node:
        return _made(node.offset, [node], node.kind, node.evaluate)

    def number(self, token: Token) -> _Node:
        value = float(token) if re.search(r"[.eE]", token) else int(token)
        if abs(value) > 1e300:
            raise ExpressionFault(token.start_pos or 0, f"found {token[:20]}", "a number below 1e300")
        return _made(token.start_pos, [], "number", lambda look: value)

    def text(self, token: Token) -> _Node:
        value = str(token)[1:-1]
        return _made(token.start_pos, [], "text", lambda look: value)

    def truth(self, token: Token) -> _Node:
        value = token.lower() == "true"
        return _made(token.start_pos, [], "truth", lambda look: value)

    def name(self, token: Token) -> _Node:
        parts = [int(part) if part.isdigit() else part for part in _PART.findall(token)]
        named = next((i for i, part in enumerate(parts) if isinstance(part, int)), len(parts))
        readings = tuple((".".join(map(str, parts[:n])), tuple(parts[n:])) for n in range(named, 0, -1))
        return self._named(token, str(token), readings)

    def key(self, token: Token) -> _Node:
        return self._named(token, token[1:-1], ((token[1:-1], ()),))

    def _named(self, token: Token, text: str, readings: tuple[tuple[str, tuple[str | int, ...]], ...]) -> _Node:
        name = ExpressionName(text, token.start_pos or 0, readings)
        return _made(token.start_pos, [], None, lambda look: look(name), name)

    def listed(self, *items: _Node | None) -> _Node:
        nodes = [item for item in items if item is not None]
        evaluate = [node.evaluate for node in nodes]
        return _made(nodes[0].offset if nodes else 0, nodes, "list", lambda look: [e(look) for e in evaluate])

    def call(self, function: Token, *arguments: _Node | None) -> _Node:
        nodes = [node for node in arguments if node is not None]
        where = function.start_pos or 0
        if function == "defined":
            return self._defined(where, nodes)
        if function not in FUNCTIONS:
            raise ExpressionFault(where, f"no function {str(function)!r}", did_you_mean(function, FUNCTIONS))
        least, most = FUNCTIONS[function].arguments
        if not least <= len(nodes) <= most:
            several = f"{least}" if least == most else f"{least} or more" if most > 2 else f"{least} or {most}"
            raise ExpressionFault(where, f"{function} of {len(nodes)} values", f"{function} of {several}")
        for node in nodes:
            if node.kind not in (None, *FUNCTIONS[function].takes):
                right = " or ".join(spelled(kind) for kind in FUNCTIONS[function].takes)
                raise ExpressionFault(node.offset, f"{function} of {spelled(node.kind)}", right)
        evaluate = [node.evaluate for node in nodes]
        return _made(where, nodes, "number", lambda look: called(function, [e(look) for e in evaluate]))

    def _defined(self, where: int, nodes: list[_Node]) -> _Node:
        if len(nodes) != 1 or not nodes[0].is_name:
            raise ExpressionFault(where, "found 'defined' of something else", "defined of one name")
        (name,) = nodes[0].names

        def evaluate(look: Look) -> bool:
            try:
                look(name)
            except NotEvaluable:
                return False
            return True

        return _made(where, nodes, "truth", evaluate)

    def signed(self, sign: Token, node: _Node) -> _Node:
        _needs("number", node)
        inner, minus = node.evaluate, sign == "-"
        return _made(sign.start_pos, [node], "number", lambda look: negative(inner(look), minus))

    def binary(self, left: _Node, operator: Token, right: _Node) -> _Node:
        kind = result_kind(operator, left.kind, right.kind)
        if kind is None:
            what = f"{spelled(left.kind)} {operator} {spelled(right.kind)}"
            raise ExpressionFault(operator.start_pos or 0, f"found {what}", "numbers on both sides")
        one, other, symbol = left.evaluate, right.evaluate, str(operator)
        return _made(left.offset, [left, right], kind, lambda look: arithmetic(symbol, one(look), other(look)))

    def relation(self, *tokens: Token) -> Token:
        return Token("RELATION", " ".join(tokens), tokens[0].start_pos)

    def comparison(self, first: _Node, *rest: Any) -> _Node:
        relations: list[Token] = list(rest[::2])
        nodes: list[_Node] = [first, *rest[1::2]]
        for left, relation, right in zip(nodes[:-1], relations, nodes[1:], strict=True):
            _check_comparison(left, relation, right)
        head = first.evaluate
        links = [(str(r), n.evaluate) for r, n in zip(relations, nodes[1:], strict=True)]

        def evaluate(look: Look) -> bool:
            left = head(look)
            for relation, each in links:
                right = each(look)
                holds = contained(relation, left, right) if "in" in relation else compared(relation, left, right)
                if not holds:
                    return False
                left = right
            return True

        return _made(first.offset, nodes, "truth", evaluate)

    def negation(self, token: Token, node: _Node) -> _Node:
        _needs("truth", node)
        inner = node.evaluate
        return _made(token.start_pos, [node], "truth", lambda look: not _truth(inner(look), "not"))

    def conjunction(self, left: _Node, token: Token, right: _Node) -> _Node:
        one, other = _truths(left, right)
        return _made(
            left.offset, [left, right], "truth", lambda look: _truth(one(look), "and") and _truth(other(look), "and")
        )

    def disjunction(self, left: _Node, token: Token, right: _Node) -> _Node:
        one, other = _truths(left, right)
        return _made(
            left.offset, [left, right], "truth", lambda look: _truth(one(look), "or") or _truth(other(look), "or")
        )

    def implies(self, left: _Node, token: Token, right: _Node) -> _Node:
        one, other = _truths(left, right)
        return _made(
            left.offset,
            [left, right],
            "truth",
            lambda look: not _truth(one(look), "implies") or _truth(other(look), "implies"),
        )


def _made(
    offset: int | None,
    children: Sequence[_Node],
    kind: ValueKind | None,
    evaluate: Callable[[Look], Any],
    name: ExpressionName | None = None,
) -> _Node:
    depth = 1 + max((child.depth for child in children), default=0)
    if depth > MOST_NESTED:
        raise ExpressionFault(offset or 0, f"more than {MOST_NESTED} levels deep", "fewer; several constraints")
    names = (name,) if name else tuple(dict.fromkeys(each for child in children for each in child.names))
    return _Node(offset or 0, depth, kind, evaluate, names, name is not None)


def _needs(kind: ValueKind, node: _Node) -> None:
    if node.kind not in (None, kind):
        raise ExpressionFault(node.offset, f"found {spelled(node.kind)}", spelled(kind))


def _truths(left: _Node, right: _Node) -> tuple[Callable[[Look], Any], Callable[[Look], Any]]:
    _needs("truth", left)
    _needs("truth", right)
    return left.evaluate, right.evaluate


def _truth(value: Any, operator: str) -> bool:
    if not isinstance(value, bool):
        raise NotEvaluable(f"{operator!r} of {spelled(kind_of(value))} {_shown(value)}")
    return value


def _shown(value: Any) -> str:
    if isinstance(value, float) and not math.isfinite(value):
        return ""
    return repr(value)[:40]


def _check_comparison(left: _Node, relation: Token, right: _Node) -> None:
    where = relation.start_pos or 0
    if "in" in relation:
        if right.kind not in (None, "list"):
            raise ExpressionFault(right.offset, f"found {spelled(right.kind)}", f"a list after {str(relation)!r}")
    elif "list" in (left.kind, right.kind):
        raise ExpressionFault(where, f"{str(relation)!r} of a list", "'in'")
    elif None not in (left.kind, right.kind) and left.kind != right.kind:
        what = f"{spelled(left.kind)} {relation} {spelled(right.kind)}"
        raise ExpressionFault(where, f"found {what}", "values of one kind")
    elif "truth" in (left.kind, right.kind) and relation not in ("==", "!="):
        raise ExpressionFault(where, f"{str(relation)!r} of true and false", "'==', 'and' or 'or'")
