"""English of names, docstrings, messages, and tests, as far as a program can check it."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest
from table import each_row

ROOT = Path(__file__).parents[1]
FOLDERS = ("deployments", "flows", "oracles", "producers", "sim", "tasks")
MODULES = tuple(file for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*.py")))
TESTS = tuple(sorted(file for file in (ROOT / "tests").rglob("*.py") if "golden" not in file.parts))

NOT_A_PATH = re.compile(r"t_way|TWay|in_the_way|Waypoint|\d-way|-way: |on the way|under way")
"""Combinations of so many values, what is in between, Nav2's waypoints, and idioms."""
A_PATH = re.compile(r"(?<![a-zA-Z])ways?(?![a-zA-Z])|Ways?(?![a-z])")
BRITISH = re.compile(
    r"(?i)modell|neighbour|colour|labell|travell|centre(?![a-z])|behaviour|micrometre|judgement|realis(?:e|ing|able|ation)"
)
FORMER_NAMES = {"judgement", "unrealisable", "unrealisable_by", "realised"}
"""Columns and keys of directories that version 0.2 wrote."""
PRIVATE = re.compile(r"(?<![a-z])(chatter|foresight|leaps|parcels?|shelf|shelves|whereabouts|workshop)")

MOST_WORDS = 20
"""Maximum number of words of a docstring's summary."""
CLAUSE = re.compile(
    r"^(Of|What|That|As|Those|Who|Whoever|Where|Which|How|For what|Nothing|None|Others?|Each that|One that|Such) "
)
"""Openings of a summary that is a subordinate clause or names no thing."""
ODD_TEST = re.compile(
    r"^test_(an?|the|what|that|of|who|those|as|where|which|how|nothing|none|no|others?|each|every|all|one|it|there|if|only|both|"
    r"two|some|many|in|on|at|with|without|from|by|for|to|when|while)_"
)
"""Openings of a test's name that are not the unit it is about."""
MOST_PARTS = 14
"""Words of a test's name, `test` with them."""
MAKES_A_FAULT = re.compile(
    r"(?i)(fault|fail|note|error|invalid|unreadable|refused|rejection|message_of|did_you_mean|_wrong|got)$"
)
"""Names of calls whose texts become messages to the author of a file or the caller of a command."""
FRAGMENT = re.compile(r"; (?!charset=|\{)")
"""A clause behind a semicolon; a message says it in a sentence of its own."""
FOUND_AND_RIGHT = re.compile(r"^(.*: )?found .+; ")
"""A message that names what was found first; ours say what was expected, and what was given."""


def names_of(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.AsyncFunctionDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.id if isinstance(node, ast.Name) else node.attr


def messages_of(tree):
    """Texts that are no docstrings."""
    docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
            yield node.value


def texts_of(tree):
    """Yield texts that are no docstrings, a formatted one whole."""
    inner = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inner:
            yield node.value


def faults_in(tree):
    """Yield the texts of what is raised and of calls that make faults, also of variables that carry them there."""
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        made = [node for node in ast.walk(function) if isinstance(node, ast.Raise) or makes_a_fault(node)]
        carried = {name.id for node in made for name in ast.walk(node) if isinstance(name, ast.Name)}
        for node in ast.walk(function):
            if isinstance(node, ast.Assign) and any(
                isinstance(name, ast.Name) and name.id in carried
                for target in node.targets
                for name in ast.walk(target)
            ):
                made.append(node.value)
        yield from (text for node in made for text in texts_of(node))


def makes_a_fault(node):
    name = getattr(node.func, "attr", getattr(node.func, "id", "")) if isinstance(node, ast.Call) else ""
    return bool(MAKES_A_FAULT.search(name))


@pytest.fixture(scope="module")
def trees():
    return parsed(MODULES)


@each_row("words_of", [names_of, messages_of])
def test_path_is_called_a_path(trees, words_of):
    found = {(file, words) for file, tree in trees.items() for words in words_of(tree) if A_PATH.search(words)}
    assert sorted((file, words) for file, words in found if not NOT_A_PATH.search(words)) == []


@each_row("words_of", [names_of, messages_of])
def test_spelling_is_american(trees, words_of):
    found = {
        (file, words)
        for file, tree in trees.items()
        for words in words_of(tree)
        if words not in FORMER_NAMES and BRITISH.search(words)
    }
    assert sorted(found) == []


def test_names_are_not_private_words(trees):
    found = {(file, name) for file, tree in trees.items() for name in names_of(tree) if PRIVATE.search(name)}
    assert sorted(found) == []


def summaries_of(tree):
    """Yield the first paragraph of every docstring."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text:
                yield text.split("\n\n")[0]


@cache
def parsed(files):
    return {file.relative_to(ROOT).as_posix(): ast.parse(file.read_text(encoding="utf-8")) for file in files}


@each_row("files", [MODULES, TESTS])
def test_docstring_summary_is_one_plain_line(files):
    found = [(file, summary) for file, tree in parsed(files).items() for summary in summaries_of(tree)]
    wrong = [
        f"{file}: {summary}"
        for file, summary in found
        if "\n" in summary or len(summary.split()) > MOST_WORDS or CLAUSE.match(summary)
    ]
    assert wrong == []


def test_message_states_expected_and_given_values(trees):
    found = [
        f"{file}: {text}" for file, tree in trees.items() for text in texts_of(tree) if FOUND_AND_RIGHT.search(text)
    ]
    assert found == []


def test_fault_message_consists_of_sentences(trees):
    found = {f"{file}: {text}" for file, tree in trees.items() for text in faults_in(tree) if FRAGMENT.search(text)}
    assert sorted(found) == []


def test_test_name_starts_with_unit():
    names = [
        (file, name) for file, tree in parsed(TESTS).items() for name in names_of(tree) if name.startswith("test_")
    ]
    wrong = [f"{file}: {name}" for file, name in names if ODD_TEST.match(name) or name.count("_") >= MOST_PARTS]
    assert wrong == []
