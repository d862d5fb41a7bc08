"""Words of names and messages: the field's own."""

import ast
import re
from pathlib import Path

import pytest
from table import each_row

ROOT = Path(__file__).parents[1]
FOLDERS = ("deployments", "flows", "oracles", "producers", "sim", "tasks")
MODULES = [file for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*.py"))]

NOT_A_PATH = re.compile(r"t_way|TWay|in_the_way|Waypoint|\d-way|-way: |on the way|under way")
"""Combinations of so many values, what is in between, Nav2's waypoints, and idioms."""
A_PATH = re.compile(r"(?<![a-zA-Z])ways?(?![a-zA-Z])|Ways?(?![a-z])")
BRITISH = re.compile(r"(?i)modell|neighbour|colour|labell|travell|centre(?![a-z])|behaviour|micrometre")
PRIVATE = re.compile(r"(?<![a-z])(chatter|foresight|leaps|parcels?|shelf|shelves|whereabouts|workshop)")


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


@pytest.fixture(scope="module")
def trees():
    return {file.relative_to(ROOT).as_posix(): ast.parse(file.read_text(encoding="utf-8")) for file in MODULES}


@each_row("words_of", [names_of, messages_of])
def test_path_is_called_a_path(trees, words_of):
    found = {(file, words) for file, tree in trees.items() for words in words_of(tree) if A_PATH.search(words)}
    assert sorted((file, words) for file, words in found if not NOT_A_PATH.search(words)) == []


@each_row("words_of", [names_of, messages_of])
def test_spelling_is_american(trees, words_of):
    found = {(file, words) for file, tree in trees.items() for words in words_of(tree) if BRITISH.search(words)}
    assert sorted(found) == []


def test_names_are_not_private_words(trees):
    found = {(file, name) for file, tree in trees.items() for name in names_of(tree) if PRIVATE.search(name)}
    assert sorted(found) == []
