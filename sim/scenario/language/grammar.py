"""From the text of a scenario file to its syntax or its syntax errors."""

import hashlib
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib.resources import files
from pathlib import Path
from threading import Lock
from typing import Final

import platformdirs
from lark import Lark, Token, UnexpectedInput
from lark import __version__ as lark_version
from lark.lark import PostLex

from vastflow.sim.model.faults import Complaint, Fault, FileError, Got, Place, Problem
from vastflow.sim.model.files import Unreadable
from vastflow.sim.model.names import nearest
from vastflow.sim.model.syntax import Misfit, line_and_column, misfit, misplaced, spelling
from vastflow.sim.scenario.language import syntax
from vastflow.sim.scenario.language.building import Builder

TAB: Final = 8
DEEPEST: Final = 100

OPENING: Final = frozenset({"LPAR", "LSQB"})
CLOSING: Final = frozenset({"RPAR", "RSQB"})

WORDS: Final = re.compile(r"\w\w")
"""Letters of two words that touch."""

COMMENT: Final = re.compile(r"/\*[\s\S]*?\*/|#[^\n]*")


class Indentation(PostLex):
    """Turns the beginnings of lines into `_NL`, `_INDENT` and `_DEDENT`.

    Inside brackets lines go on. The text has to end with the end of a line. Each token goes on to the parser before the
    next one is asked for: what a word is depends on where the parser stands. Holds nothing between two texts.
    """

    always_accept = ("_NL",)

    def process(self, stream: Iterator[Token]) -> Iterator[Token]:
        """Yield the tokens of a text without blank lines, with ends of lines and blocks.

        Raises:
            Unreadable: a line is indented less than its block and more than the one around it, or brackets and
                blocks are nested deeper than anybody writes.
        """
        levels, brackets, begun = [0], 0, False
        end = Token("_NL", "", 0, 1, 1, 1, 1, 0)
        for token in stream:
            if token.type == "_NL":
                text = COMMENT.sub(lambda found: " " * len(found[0]) if found[0][0] == "/" else "", token.value)
                _, line, blanks = text.rpartition("\n")
                if line and brackets <= 0:
                    if begun:
                        yield Token.new_borrow_pos("_NL", "", token)
                    yield from _steps(token, len(blanks.expandtabs(TAB)), levels)
                continue
            touches = begun and end.end_pos == token.start_pos and end.type != "NUMBER"
            if touches and WORDS.fullmatch(end[-1] + token[0]):
                place = end.line or 1, end.column or 1
                raise Unreadable(Got(repr(end + token)), f"a blank behind {str(end)!r}", place)
            brackets += (token.type in OPENING) - (token.type in CLOSING)
            if brackets > DEEPEST:
                raise Unreadable("brackets are nested too deep", "use fewer", (token.line or 1, token.column or 1))
            begun, end = True, token
            yield token
        for _ in levels[1:]:
            yield Token.new_borrow_pos("_DEDENT", "", end)


def _steps(token: Token, width: int, levels: list[int]) -> Iterator[Token]:
    place = token.end_line or 1, width + 1
    if width > levels[-1]:
        if len(levels) > DEEPEST:
            raise Unreadable("blocks are nested too deep", "use fewer levels", place)
        levels.append(width)
        yield Token.new_borrow_pos("_INDENT", "", token)
    while width < levels[-1]:
        levels.pop()
        yield Token.new_borrow_pos("_DEDENT", "", token)
    if width != levels[-1]:
        what = Got(f"a line indented by {width} blanks that belongs to no block")
        raise Unreadable(what, f"{levels[-1]} blanks, as the lines above it", place)


SPELLED: Final[Mapping[str, str]] = {
    "NAME": "a name",
    "NUMBER": "a number",
    "STRING": "a string in quotes",
    "COMPARED": "a comparison",
    "_NL": "the end of the line",
    "_INDENT": "a block, indented deeper than this line",
    "_DEDENT": "the end of the block",
    "$END": "the end of the file",
}
"""Terminals that are more than a word or a sign."""

UNSAID: Final = frozenset({"PLUS", "MINUS", "TIMES", "DIVIDED", "MODULO", "COMPARED", "IN", "AND", "OR", "QUESTION"})
"""Operators, which could stand after any value: they are said where nothing else could."""

ENDS: Final = ("_NL", "_DEDENT", "$END")

MOST_FAULTS: Final = 20

MOST_PARSED: Final = 300_000
"""Characters that are parsed on the way to further faults: each takes the text from its beginning."""

STAND_IN: Final = "\ue000"
"""Takes the place of a line that is at fault; the grammar has it wherever a line may begin."""

LABEL: Final = re.compile(r"(?<!\w)(\w+)[ \t]*:[ \t]*\Z")
"""A name before a colon at the end of a line, where a block can't begin."""

BLOCKS: Final = ("serial", "parallel", "one_of")

QUIET: Final = re.compile(r"""\"{3}[\s\S]*?\"{3}|'{3}[\s\S]*?'{3}|"[^"\n]*"|'[^'\n]*'|/\*[\s\S]*?\*/|#[^\n]*""")
"""Strings and comments, whose brackets are none."""


_PARSING: Final = Lock()
"""The parser's builder takes the name of one file at a time."""


def parsed(text: str, file: str) -> syntax.File:
    """Return the syntax of `text`.

    Raises:
        FileError: it is not in the language. Behind a line that is at fault reading goes on, so that there may be more.
    """
    faults: list[Fault] = []
    readable: str | None = text + "\n"
    while readable is not None and len(faults) < MOST_FAULTS and len(faults) * len(text) <= MOST_PARSED:
        try:
            with _PARSING:
                parser, builder = _parser()
                builder.file = file
                read: syntax.File = parser.parse(readable)  # type: ignore[assignment]  # made by the builder
            if not faults:
                return read
            break
        except Unreadable as error:
            faults.append(Fault(Place(file, *error.place), error.problem, error.expected))
            break
        except UnexpectedInput as error:
            wrong = misfit(error, readable)
            at, what, right = _told(wrong, readable)
            place = Place(file, *line_and_column(readable, at))
            faults.append(Fault(place, what, right))
            # The indentation may be wrong, or a line further up: nothing more can be told.
            is_about_blocks = wrong.terminal in ("_INDENT", "_DEDENT", "$END") or wrong.expected == {"_INDENT"}
            readable = None if is_about_blocks else _without(readable, place.line)
    raise FileError(faults)


@cache
def _parser() -> tuple[Lark, Builder]:
    grammar = (files("vastflow.sim.scenario.language") / "grammar.lark").read_text("utf-8")
    tables: str | bool = False
    with suppress(OSError):
        folder = Path(platformdirs.user_cache_dir("vastflow")) / "grammars"
        folder.mkdir(parents=True, exist_ok=True)
        tables = str(folder / f"{hashlib.sha256(f'{lark_version} {grammar}'.encode()).hexdigest()[:16]}.lark")
    builder = Builder()
    options = {"start": "file_", "parser": "lalr", "maybe_placeholders": True, "cache": tables}
    return Lark(grammar, postlex=Indentation(), transformer=builder, **options), builder


def _without(text: str, number: int) -> str | None:
    """Return `text` without a line and the block below it, or None inside of brackets."""
    lines = text.split("\n")
    before, line, after = lines[: number - 1], lines[number - 1], lines[number:]
    codes = [QUIET.sub("", part) for part in ("\n".join(before), line)]
    if STAND_IN in line or any(sum(map(c.count, "([")) != sum(map(c.count, ")]")) for c in codes):
        return None
    blanks = line[: len(line) - len(line.lstrip())]
    width = _width(line)
    count = next((i for i, below in enumerate(after) if below.strip() and _width(below) <= width), len(after))
    return "\n".join([*before, blanks + STAND_IN, *[""] * count, *after[count:]])


def _width(line: str) -> int:
    columns = line.expandtabs(TAB)
    return len(columns) - len(columns.lstrip())


def _told(wrong: Misfit, text: str) -> tuple[int, Problem, str]:
    """Return the index of a mistake, the problem, and the expected text."""
    at, terminal, expected = wrong.start, wrong.terminal, wrong.expected
    if not terminal or text.startswith("/*", at):
        return at, *_stray(text, at)
    if terminal == "_NL" and (label := LABEL.search(text, 0, at)):
        near = nearest(label[1], BLOCKS)
        if near:
            return label.start(), f"unexpected {label[1]!r}", f"did you mean {near!r}?"
        return label.start(), Got(repr(label[1])), f"{', '.join(BLOCKS)} or an action"
    if terminal == "_INDENT":
        what = Got("a line that is indented deeper than the one before")
        return wrong.end, what, "the same indentation, or ':' on that line"
    word = "" if terminal in ENDS else text[at : wrong.end]
    what = Got(SPELLED[terminal] if terminal in ENDS else repr(word[:40]))
    at = wrong.end if terminal == "_DEDENT" else at
    if terminal == "DOT" and text[at - 1 : at].isdigit():
        return at, what, "a number with digits after the point, such as 3.0"
    if expected == {"_INDENT"}:
        return at, what, "a block, indented deeper than the line before"
    parser, _ = _parser()
    spelled = {each: spelling(parser, each, SPELLED) for each in expected if each != "STAND_IN"}
    said = expected - UNSAID or expected
    return at, *misplaced(what, word, [spelled[each] for each in spelled if each in said], spelled.values())


def _stray(text: str, at: int) -> Complaint:
    """Return the problem and the expected text at a character that begins no token."""
    if text.startswith("/*", at):
        return Got("a comment that does not end"), "'*/' at its end"
    if text[at] in "'\"":
        return Got("a string that does not end"), f"{text[at]} before the end of the line"
    if text[at] == "|":
        return Got("a name that does not end"), "'|' before the end of the line"
    return Got(repr(text[at])), "a name, a number, a string or an operator"
