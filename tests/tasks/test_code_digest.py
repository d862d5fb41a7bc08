import ast
import io
import itertools
import random
import tokenize
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

import vastflow.oracles
import vastflow.producers
import vastflow.sim
import vastflow.tasks
from vastflow.tasks.keys.code_digest import tree_digest

SOURCES = sorted(
    file
    for package in (vastflow.sim, vastflow.producers, vastflow.oracles, vastflow.tasks)
    for file in Path(package.__file__).parent.rglob("*.py")
    if 300 < file.stat().st_size < 6000
)

DIFFERENT = {
    "return": ("def f(v):\n    return\n    v\n", "def f(v):\n    return v\n"),
    "call": ("x = f\n(y)\n", "x = f(y)\n"),
    "subtraction": ("a = b\n-c\n", "a = b - c\n"),
    "subscript": ("a = b\n[0]\n", "a = b[0]\n"),
    "yield": ("def f(v):\n    yield\n    v\n", "def f(v):\n    yield v\n"),
    "raise": ("raise\nError\n", "raise Error\n"),
    "indented": ("if a:\n    b()\n    c()\n", "if a:\n    b()\nc()\n"),
    "a bare f-string": ("f'{print(1)}'\n", "f'{print(2)}'\n"),
    "bytes": ("x = b'a'\n", "x = 'a'\n"),
    "true": ("x = True\n", "x = 1\n"),
    "float": ("x = 1.0\n", "x = 1\n"),
    "none": ("def f():\n    return None\n", "def f():\n    return\n"),
    "a mapping that is merged": ("x = {**a}\n", "x = {None: a}\n"),
    "two strings": ("x = ['ab', 'c']\n", "x = ['a', 'bc']\n"),
    "operators": ("x = (a + b) * c\n", "x = a + b * c\n"),
}

SAME = {
    "comment": ("x = 1\n", "# one\nx = 1  # two\n"),
    "blank lines": ("x = 1\ny = 2\n", "\n\nx = 1\n\n\ny = 2\n"),
    "a line in brackets": ("x = f(a, b)\n", "x = f(\n    a,\n    b,\n)\n"),
    "a continued line": ("x = a + b\n", "x = a + \\\n    b\n"),
    "brackets of no meaning": ("x = a + b\n", "x = (a + b)\n"),
    "quotes": ("x = 'a'\n", 'x = u"a"\n'),
    "two statements a line": ("x = 1\ny = 2\n", "x = 1; y = 2\n"),
    "docstring": ('def f():\n    """A."""\n    return 1\n', 'def f():\n    """B.\n\n    C.\n    """\n    return 1\n'),
    "no docstring": ("def f():\n    return 1\n", 'def f():\n    """B."""\n    return 1\n'),
    "an attribute's docstring": ("X = 1\n", 'X = 1\n"""One."""\n'),
    "digits": ("x = 1000\n", "x = 1_000\n"),
}


def code_digest(text):
    return tree_digest(ast.parse(text))


@each_row(("one", "other"), DIFFERENT.values())
def test_different_programs_have_different_digests(one, other):
    assert code_digest(one) != code_digest(other)


@each_row(("one", "other"), SAME.values())
def test_program_that_looks_different_has_the_same_digest(one, other):
    assert code_digest(one) == code_digest(other)


def test_deep_and_large_programs_have_a_digest():
    assert code_digest("x = " + " + ".join(["1"] * 600)) != code_digest("x = " + " + ".join(["1"] * 601))
    assert code_digest(f"x = 0x{'f' * 9000}") != code_digest(f"x = 0x{'f' * 8999}")


def test_code_digest_is_pinned():
    text = (
        "import math\n\n\ndef area(r, *, n: int = 2, **rest):\n    return f'{math.pi * r**n!r:>{n}}' if r else None\n"
    )
    pinned = "a5a22cbbb6ae6c514b246387a3cb053407b5d080a4ba8ddfe2178bb5068d72e6"
    assert code_digest(text) == pinned


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.sampled_from(SOURCES), st.integers(0, 2**32))
def test_equal_digests_mean_equal_trees(file, seed):
    text = file.read_text(encoding="utf-8")
    mutants = [text, *itertools.islice(_parsed(_mutants(text, random.Random(seed))), 8)]
    digests = [(code_digest(mutant), _tree(mutant)) for mutant in mutants]
    for (digest, tree), (other_digest, other_tree) in itertools.combinations(digests, 2):
        assert (digest == other_digest) == (tree == other_tree)


def _mutants(text, draw):
    """A text with one edit each; many at the ends of lines, where statements begin and end."""
    tokens = list(tokenize.generate_tokens(io.StringIO(text).readline))
    lines = text.splitlines(keepends=True)
    starts = list(itertools.accumulate(map(len, lines), initial=0))
    places = [starts[token.start[0] - 1] + token.start[1] for token in tokens if token.start[0] <= len(lines)]
    for _ in range(60):
        k = draw.choice(places)
        kind = draw.randrange(6)
        if kind == 0:  # a line that ends earlier
            indent = len(text[:k].rpartition("\n")[2]) - len(text[:k].rpartition("\n")[2].lstrip())
            yield text[:k] + "\n" + " " * indent + text[k:]
        elif kind == 1 and "\n" in text[k:]:  # two lines joined
            end = text.index("\n", k)
            yield text[:end] + " " + text[end:].lstrip()
        elif kind == 2:
            yield text[:k] + draw.choice(["0", "-", "not ", "(", "x ", "f", "'", "*"]) + text[k:]
        elif kind == 3:
            yield text[:k] + text[draw.choice([p for p in places if p >= k][:3]) :]
        elif kind == 4:
            yield text[:k] + "# " + text[k:]
        else:
            line = draw.randrange(len(lines))
            yield "".join([*lines[:line], draw.choice(["    ", ""]) + lines[line].lstrip(" "), *lines[line + 1 :]])


def _parsed(texts):
    for text in texts:
        try:
            ast.parse(text)
        except (SyntaxError, ValueError):
            continue
        yield text


def _tree(text):
    """Python's own `ast.dump` without statements that are only a string."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        for name, value in ast.iter_fields(node):
            if isinstance(value, list) and value and isinstance(value[0], ast.stmt):
                setattr(node, name, [each for each in value if not _is_text(each)] or [ast.Name("only text")])
        if isinstance(node, ast.Constant):
            node.kind = None
    return ast.dump(tree)


def _is_text(node):
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
