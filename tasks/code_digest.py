"""Code digests: equal ones mean the same program, whatever it looks like and whatever its docstrings say."""

import ast
import hashlib
from collections.abc import Iterator
from typing import Any

_UNSEEN = frozenset({"kind", "type_comment", "type_ignores"})
"""Fields of a syntax tree that change nothing: `u` before a string, and comments about types."""


def code_digest(text: str) -> str:
    """SHA-256 of the syntax tree of Python source, without docstrings and positions.

    Two texts with equal digests have equal trees but for statements that are a string and nothing else, as docstrings are.
    A tree is digested in a form of its own, not as `ast.dump` writes it, so that a text has the same digest on every minor
    version of Python that parses it to the same nodes.

    Raises:
        SyntaxError: it is no Python.
    """
    return tree_digest(ast.parse(text))


def tree_digest(tree: ast.AST) -> str:
    """As `code_digest`, of a text that was parsed."""
    hashed = hashlib.sha256()
    for token in _tokens(tree):
        hashed.update(token)
    return hashed.hexdigest()


def _tokens(tree: ast.AST) -> Iterator[bytes]:
    """The tree as text from which it could be built again; without recursion, for a sum of 1,000 terms is as many levels deep."""
    waiting: list[Any] = [tree]
    while waiting:
        part = waiting.pop()
        if isinstance(part, bytes):
            yield part
        elif isinstance(part, ast.AST):
            waiting += reversed(list(_node(part)))
        elif isinstance(part, list):
            waiting += reversed([b"[", *(each for each in part if not _is_docstring(each)), b"]"])
        else:
            yield _constant(part)


def _node(node: ast.AST) -> Iterator[Any]:
    """A node's parts; an absent field and an empty list are left out, for newer versions of Python have fields that older have not."""
    yield f"({type(node).__name__}".encode()
    for name, value in ast.iter_fields(node):
        is_absent = (value is None and not isinstance(node, ast.Constant)) or value == []
        if name not in _UNSEEN and not is_absent:
            yield f" {name}=".encode()
            yield value
    yield b")"


def _constant(value: object) -> bytes:
    """A value that stands in a tree: what it is and how long, so that no two are written alike."""
    if isinstance(value, str):
        text = value.encode("utf-8", "surrogatepass")
    elif isinstance(value, bytes):
        text = value
    elif isinstance(value, float):
        text = value.hex().encode()
    elif isinstance(value, complex):
        text = f"{value.real.hex()} {value.imag.hex()}".encode()
    elif isinstance(value, int) and not isinstance(value, bool):
        text = hex(value).encode()  # a decimal of more than 4,300 digits is refused
    else:
        text = repr(value).encode()
    return f"{type(value).__name__} {len(text)} ".encode() + text


def _is_docstring(node: object) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
