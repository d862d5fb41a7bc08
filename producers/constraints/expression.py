"""Expressions of constraints: a small language over the values of a configuration.

Numbers, text in quotes, `true` and `false`, names, lists; `+ - * / % **`, comparisons that may be chained,
`and or not implies in`, the functions of `vastflow.producers.constraints.operations`, parentheses. Operators bind as in
Python, whose `ast` parses them; `implies` is the weakest and groups to the right. Nothing is run by Python's eval.
"""

import ast
import keyword
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from typing import Any, Final, TypeAlias

from vastflow.producers.constraints.operations import (
    FUNCTIONS,
    SYMBOLS,
    NotEvaluable,
    ValueKind,
    arithmetic,
    called,
    compared,
    kind_of,
)
from vastflow.sim.model.faults import Fault, FileError, Got, Place, Problem
from vastflow.sim.model.names import did_you_mean

__all__ = ["ConstraintExpression", "ExpressionName", "NotEvaluable", "expression_of"]

MOST_CHARACTERS: Final = 2_000
MOST_NESTED: Final = 60

_KEYWORDS: Final = "|".join({*keyword.kwlist} - {"and", "or", "not", "in", "True", "False"})
"""Names in the language."""
_UNLIKE_PYTHON: Final = re.compile(
    rf"""(?<!\w)(?P<quoted>"[^"\n]*"|'[^'\n]*'|`[^`\n]+`) | (?P<name>\b(?:{_KEYWORDS})\b | (?<=\w)[^\W\x00-\x7f])
    | (?<![\w.])(?P<word>implies|true|false)\b | \s
    | (?P<slip>["'`\#\\&|^] | (?<![=<>!])=(?!=) | !(?!=) | // | [^\s!-~]
      | (?<![\w.])\d[\d.]*+(?:[eE][+-]?\d+)?+[A-Za-z_])""",
    re.VERBOSE,
)
_WORDS: Final = {"implies": "if None else", "true": "True", "false": "False"}
"""Python's conditional is its weakest operator and groups to the right."""
_SLIPS: Final = {"=": "'==' to compare", "&": "'and'", "|": "'or'", "!": "'not' or '!='", "/": "'/'", "^": "'**'"}
_NAME: Final = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*|\[\d+\])*")
_PART: Final = re.compile(r"[A-Za-z_]\w*|\d+")

Look: TypeAlias = Callable[["ExpressionName"], Any]
"""Gives the value of a name; raises `NotEvaluable` where there is none."""
Evaluate: TypeAlias = Callable[[Look], Any]


@dataclass(frozen=True, slots=True)
class ExpressionName:
    """A name in an expression.

    Attributes:
        text: Text of the name as it is written, without backticks.
        offset: Offset of its first occurrence.
        readings: Possible meanings, the longest key first: a key of the configuration, and what follows inside of
            its value. `goal_pose.x` is the key `goal_pose.x` or `x` of `goal_pose`.
    """

    text: str
    offset: int
    readings: tuple[tuple[str, tuple[str | int, ...]], ...]


@dataclass(frozen=True, slots=True)
class ConstraintExpression:
    """An expression that is true or false of a configuration, and its names, each once, as they appear."""

    text: str
    names: tuple[ExpressionName, ...]
    _evaluate: Evaluate

    def holds(self, look: Look) -> bool:
        """Whether it is true.

        Raises:
            NotEvaluable: neither, and why.
        """
        found = self._evaluate(look)
        if not isinstance(found, bool):
            raise NotEvaluable(f"the whole is {kind_of(found)}, not true or false")
        return found


def expression_of(text: str) -> ConstraintExpression:
    """Parse an expression.

    Raises:
        FileError: the first thing wrong with it.
    """
    if len(text) > MOST_CHARACTERS:
        raise _fault(MOST_CHARACTERS, f"more than {MOST_CHARACTERS} characters", "write several constraints")
    if not text.strip():
        raise _fault(0, Got("nothing"), "an expression such as 'robot_radius < 0.3'")
    tree = _Tree(text, _UNLIKE_PYTHON.sub(_in_python, text))
    whole = tree.parsed()
    if (kind := tree.kind(whole)) not in ("a value", "true or false"):
        raise tree.fault(whole, Got(kind), "a comparison, which is true or false")
    names: dict[str, ExpressionName] = {}
    for name in tree.leaves.values():
        if isinstance(name, ExpressionName):
            names.setdefault(name.text, name)
    return ConstraintExpression(text, tuple(names.values()), tree.evaluator(whole))


def _in_python(found: re.Match[str]) -> str:
    if found["slip"]:
        raise _unexpected(found.string, found.start(), _SLIPS.get(found[0][0]))
    return _WORDS[found[0]] if found["word"] else ("_" if found["quoted"] or found["name"] else " ") * len(found[0])


def _unexpected(text: str, offset: int, right: str | None = None) -> FileError:
    word = (text[offset : offset + 20].split() or [""])[0]
    if right is None:
        needs_value = word in ("and", "or", "in") or not _NAME.match(word)
        right = "a number, a name, text in quotes or '('" if needs_value else "an operator such as '<', 'and' or '*'"
    return _fault(offset, Got(repr(word) if word else "the end of the expression"), right)


@dataclass(frozen=True, slots=True)
class _Tree:
    """An expression as Python parses it; only the nodes that `_operands` lists are in the language.

    Attributes:
        python: The text in Python's grammar, in ASCII on one line, with placeholders for text in quotes and keys.
        leaves: Names and literals.
    """

    text: str
    python: str
    leaves: dict[ast.expr, Any] = field(default_factory=dict)

    def parsed(self) -> ast.expr:
        """Return the root, or raise the fault for which Python can't parse it."""
        for at, depth in enumerate(accumulate((each in "([") - (each in ")]") for each in self.python.lstrip())):
            if depth > MOST_NESTED:
                raise _too_deep(self._offset(at))
        try:
            return ast.parse(self.python.lstrip(), mode="eval").body
        except SyntaxError as error:
            if error.msg.endswith("was never closed"):
                raise _unexpected(self.text, len(self.text.rstrip()), "')'" if error.msg[1] == "(" else "']'") from None
            at = self._offset(error.offset - 1) if error.offset else len(self.text.rstrip())
            raise _unexpected(self.text, at, "the end" if error.msg.startswith("unmatched") else None) from None
        except (RecursionError, MemoryError):
            raise _too_deep(0) from None

    def kind(self, node: ast.expr, depth: int = 1) -> ValueKind:
        """Return the kind of a node's value, or raise the fault of a node that is not in the language."""
        if depth > MOST_NESTED:
            raise _too_deep(self._offset(node.col_offset))
        operands = self._operands(node)
        kinds = [self.kind(each, depth + 1) for each in operands]
        match node:
            case ast.Name() | ast.Attribute() | ast.Subscript():
                return self._leaf(node)
            case ast.Constant(value=bool() | int() | float() as value):
                if abs(value) > 1e300:
                    raise self.fault(node, Got(self._written(node)[:20]), "a number below 1e300")
                self.leaves[node] = value
                return kind_of(value)
            case ast.List():
                return "a list"
            case ast.Call():
                return self._checked_call(node, kinds)
            case ast.BinOp(op=operator):
                if not {*kinds} <= {"a value", "a number"}:
                    what = Got(f"{kinds[0]} {SYMBOLS[type(operator)]} {kinds[1]}")
                    raise self._unlike(operands[0], what, "numbers on both sides")
                return "a number"
            case ast.Compare(ops=relations):
                for relation, two, their_kinds in zip(relations, pairwise(operands), pairwise(kinds), strict=True):
                    self._check_relation(SYMBOLS[type(relation)], two, their_kinds)
                return "true or false"
        is_sign = isinstance(node, ast.UnaryOp) and type(node.op) in SYMBOLS
        takes: ValueKind = "a number" if is_sign else "true or false"
        for each, kind in zip(operands, kinds, strict=True):
            if kind not in ("a value", takes):
                raise self.fault(each, Got(kind), takes)
        return takes

    def _operands(self, node: ast.expr) -> Sequence[ast.expr]:
        match node:
            case ast.Name() | ast.Attribute() | ast.Subscript() | ast.Constant(value=bool() | int() | float()):
                return ()
            case ast.List(elts=found) | ast.Call(func=ast.Name(), args=found, keywords=[]) | ast.BoolOp(values=found):
                return found
            case ast.UnaryOp(op=ast.Not() | ast.UAdd() | ast.USub(), operand=operand):
                return (operand,)
            case ast.BinOp(left=left, op=operator, right=right) if type(operator) in SYMBOLS:
                return left, right
            case ast.IfExp(body=left, test=ast.Constant(value=None), orelse=right):
                return left, right
            case ast.Compare(left=left, ops=operators, comparators=others) if {*map(type, operators)} <= SYMBOLS.keys():
                return left, *others
        raise _unexpected(self.text, self._offset(node.col_offset))

    def evaluator(self, node: ast.expr) -> Evaluate:
        """Return what evaluates a node that `kind` has seen."""
        if node in self.leaves:
            leaf = self.leaves[node]
            return (lambda look: look(leaf)) if isinstance(leaf, ExpressionName) else lambda look: leaf
        parts = [self.evaluator(each) for each in self._operands(node)]
        match node:
            case ast.Call(func=ast.Name(id="defined")):
                return lambda look: _is_defined(parts[0], look)
            case ast.Call(func=ast.Name(id=function)):
                return lambda look: called(function, [part(look) for part in parts])
            case ast.UnaryOp(op=ast.Not()):
                return lambda look: not _truth("not", parts[0](look))
            case ast.UnaryOp(op=operator):
                symbol = SYMBOLS[type(operator)]
                return lambda look: arithmetic(symbol, 0, parts[0](look))
            case ast.BinOp(op=operator):
                symbol, (left, right) = SYMBOLS[type(operator)], parts
                return lambda look: arithmetic(symbol, left(look), right(look))
            case ast.BoolOp(op=operator):
                holds, word = (all, "and") if isinstance(operator, ast.And) else (any, "or")
                return lambda look: holds(_truth(word, part(look)) for part in parts)
            case ast.IfExp():
                left, right = parts
                return lambda look: not _truth("implies", left(look)) or _truth("implies", right(look))
            case ast.Compare(ops=relations):
                links = [(SYMBOLS[type(relation)], part) for relation, part in zip(relations, parts[1:], strict=True)]
                return lambda look: _all_hold(parts[0](look), links, look)
        return lambda look: [part(look) for part in parts]

    def _leaf(self, node: ast.expr) -> ValueKind:
        at, written = self._offset(node.col_offset), self._written(node)
        if (quoted := _UNLIKE_PYTHON.fullmatch(written)) and quoted["quoted"]:
            inner = quoted[0][1:-1]
            is_key = written[0] == "`"
            self.leaves[node] = ExpressionName(inner, at, ((inner, ()),)) if is_key else inner
            return "a value" if is_key else "text"
        written = "".join(written.split())
        if not _NAME.fullmatch(written):
            raise _unexpected(self.text, at)
        parts = [int(part) if part.isdigit() else part for part in _PART.findall(written)]
        named = next((i for i, part in enumerate(parts) if isinstance(part, int)), len(parts))
        readings = tuple((".".join(map(str, parts[:n])), tuple(parts[n:])) for n in range(named, 0, -1))
        self.leaves[node] = ExpressionName(written, at, readings)
        return "a value"

    def _checked_call(self, node: ast.Call, kinds: Sequence[ValueKind]) -> ValueKind:
        name = self._written(node.func)
        if name == "defined":
            if len(kinds) != 1 or not isinstance(self.leaves.get(node.args[0]), ExpressionName):
                raise self.fault(node, Got("'defined' of something else"), "defined of one name")
            return "true or false"
        if name not in FUNCTIONS:
            raise self.fault(node, f"unknown function {name!r}", did_you_mean(name, FUNCTIONS))
        _, least, most, takes = FUNCTIONS[name]
        if not least <= len(kinds) <= most:
            several = f"{least}" if least == most else f"{least} or more" if most > 2 else f"{least} or {most}"
            raise self.fault(node, Got(f"{name} of {len(kinds)} values"), f"{name} of {several}")
        for argument, kind in zip(node.args, kinds, strict=True):
            if kind not in ("a value", *takes):
                raise self.fault(argument, Got(f"{name} of {kind}"), " or ".join(takes))
        return "a number"

    def _check_relation(self, symbol: str, operands: Sequence[ast.expr], kinds: Sequence[ValueKind]) -> None:
        if symbol in ("in", "not in"):
            if kinds[1] not in ("a value", "a list"):
                raise self.fault(operands[1], Got(kinds[1]), f"a list after {symbol!r}")
        elif "a list" in kinds:
            raise self._unlike(operands[0], Got(f"{symbol!r} of a list"), "'in'")
        elif "a value" not in kinds and kinds[0] != kinds[1]:
            raise self._unlike(operands[0], Got(f"{kinds[0]} {symbol} {kinds[1]}"), "values of one kind")
        elif "true or false" in kinds and symbol not in ("==", "!="):
            raise self._unlike(operands[0], Got(f"{symbol!r} of true and false"), "'==', 'and' or 'or'")

    def _unlike(self, left: ast.expr, what: Problem, right: str) -> FileError:
        behind = self._offset(left.end_col_offset or 0)
        return _fault(len(self.text) - len(self.text[behind:].lstrip(" \n\t)")), what, right)

    def fault(self, node: ast.expr, what: Problem, right: str) -> FileError:
        return _fault(self._offset(node.col_offset), what, right)

    def _written(self, node: ast.expr) -> str:
        return self.text[self._offset(node.col_offset) : self._offset(node.end_col_offset or 0)]

    def _offset(self, column: int) -> int:
        """Return the place in the text of a character of the parsed expression."""
        at = column + len(self.python) - len(self.python.lstrip())
        return at - (len(_WORDS["implies"]) - len("implies")) * self.python.count(_WORDS["implies"], 0, at)


def _fault(offset: int, problem: Problem, expected: str) -> FileError:
    """Return the error of a fault that many characters from the beginning of an expression."""
    return FileError([Fault(Place("", 1, offset + 1), problem, expected)])


def _too_deep(offset: int) -> FileError:
    return _fault(offset, f"more than {MOST_NESTED} levels deep", "write several constraints")


def _truth(word: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise NotEvaluable(f"{word!r} of {kind_of(value)} {repr(value)[:40]}")
    return value


def _is_defined(name: Evaluate, look: Look) -> bool:
    try:
        name(look)
    except NotEvaluable:
        return False
    return True


def _all_hold(left: Any, links: Sequence[tuple[str, Evaluate]], look: Look) -> bool:
    for relation, part in links:
        right = part(look)
        if not compared(relation, left, right):
            return False
        left = right
    return True
