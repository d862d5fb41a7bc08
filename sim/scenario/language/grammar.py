"""From the text of a scenario file to its syntax, and the words for what does not follow the grammar."""

import hashlib
import re
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

import platformdirs
from lark import Lark, Token, UnexpectedCharacters, UnexpectedToken
from lark import __version__ as lark_version
from lark.exceptions import VisitError
from lark.lark import PostLex

from vastflow.sim.model.faults import Fault, Place
from vastflow.sim.model.names import nearest
from vastflow.sim.scenario.language.building import Builder
from vastflow.sim.scenario.language.faults import OscError, too_long
from vastflow.sim.scenario.language.syntax import FileText

TAB: Final = 8
DEEPEST: Final = 100

OPENING: Final = frozenset({"LPAR", "LSQB"})
CLOSING: Final = frozenset({"RPAR", "RSQB"})

WORDS: Final = re.compile(r"\w\w")
"""Letters of two words that touch."""

COMMENT: Final = re.compile(r"/\*[\s\S]*?\*/|#[^\n]*")


class IndentationFault(Exception):
    """A line whose indentation belongs to no block; `what` and `right` are the words of a fault."""

    def __init__(self, line: int, column: int, what: str, right: str) -> None:
        self.line, self.column, self.what, self.right = line, column, what, right
        super().__init__(what)


class Indentation(PostLex):
    """Turns the beginnings of lines into `_NL`, `_INDENT` and `_DEDENT`.

    Inside brackets lines go on. The text has to end with the end of a line. Each token goes on to the parser before the
    next one is asked for: what a word is depends on where the parser stands. Holds nothing between two texts.
    """

    always_accept = ("_NL",)

    def process(self, stream: Iterator[Token]) -> Iterator[Token]:
        """The tokens of a text without blank lines, with the ends of lines and blocks.

        Raises:
            IndentationFault: a line is indented less than its block and more than the one around it, or brackets and
                blocks are nested deeper than anybody writes.
        """
        levels, brackets, begun = [0], 0, False
        end = Token("_NL", "", 0, 1, 1, 1, 1, 0)
        for token in stream:
            if token.type == "_NL":
                width = _indent_width(token)
                if brackets <= 0 and width is not None:
                    if begun:
                        yield Token.new_borrow_pos("_NL", "", token)
                    yield from _steps(token, width, levels)
                continue
            if (
                begun
                and end.end_pos == token.start_pos
                and end.type != "NUMBER"
                and WORDS.fullmatch(end[-1] + token[0])
            ):
                raise IndentationFault(
                    end.line or 1, end.column or 1, f"got {end + token!r}", f"a blank behind {str(end)!r}"
                )
            brackets += (token.type in OPENING) - (token.type in CLOSING)
            if brackets > DEEPEST:
                raise IndentationFault(token.line or 1, token.column or 1, "brackets are nested too deep", "fewer")
            begun, end = True, token
            yield token
        for _ in levels[1:]:
            yield Token.new_borrow_pos("_DEDENT", "", end)


def _indent_width(token: Token) -> int | None:
    """Columns before the first word of the line that `token` leads to; None where it leads to none."""
    text = COMMENT.sub(lambda comment: " " * len(comment[0]) if comment[0][0] == "/" else "", token.value)
    if "\n" not in text:
        return None
    return len(text[text.rfind("\n") + 1 :].expandtabs(TAB))


def _steps(token: Token, width: int, levels: list[int]) -> Iterator[Token]:
    if width > levels[-1]:
        if len(levels) > DEEPEST:
            raise IndentationFault(token.end_line or 1, width + 1, "blocks are nested too deep", "fewer")
        levels.append(width)
        yield Token.new_borrow_pos("_INDENT", "", token)
    while width < levels[-1]:
        levels.pop()
        yield Token.new_borrow_pos("_DEDENT", "", token)
    if width != levels[-1]:
        raise IndentationFault(
            token.end_line or 1,
            width + 1,
            f"got a line indented by {width} blanks that belongs to no block",
            f"{levels[-1]} blanks, as the lines above it",
        )


SPELLED: Final[Mapping[str, str]] = {
    "NAME": "a name",
    "NUMBER": "a number",
    "STRING": "a string in quotes",
    "COMPARED": "a comparison",
    "_NL": "the end of the line",
    "_INDENT": "a block, indented deeper than this line",
    "_DEDENT": "the end of the block",
    "$END": "the end of the file",
    "LPAR": "'('",
    "RPAR": "')'",
    "LSQB": "'['",
    "RSQB": "']'",
    "COLON": "':'",
    "COMMA": "','",
    "DOT": "'.'",
    "EQUAL": "'='",
    "BANG": "'!'",
    "AT": "'@'",
    "PLUS": "'+'",
    "MINUS": "'-'",
    "TIMES": "'*'",
    "DIVIDED": "'/'",
    "MODULO": "'%'",
    "SI": "'SI'",
}
"""Terminals whose name does not say how they are written."""

UNSAID: Final = frozenset({"PLUS", "MINUS", "TIMES", "DIVIDED", "MODULO", "COMPARED", "IN", "AND", "OR", "QUESTION"})
"""Operators, which could stand after any value: they are said where nothing else could."""

MOST_EXPECTED: Final = 8

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


def parsed(text: str, file: str) -> FileText:
    """What is written in `text`.

    Raises:
        OscError: it is not in the language. Behind a line that is at fault reading goes on, so that there may be more.
    """
    faults: list[Fault] = []
    readable = text
    while True:
        try:
            tree = _parser().parse(readable + "\n")
            break
        except IndentationFault as fault:
            faults.append(Fault(Place(file, fault.line, fault.column), fault.what, fault.right))
            raise OscError(faults) from None
        except UnexpectedCharacters as error:
            place = Place(file, error.line, error.column)
            faults.append(Fault(place, *_stray(readable, error.pos_in_stream or 0)))
            rest = _without(readable, place.line)
        except UnexpectedToken as error:
            place = Place(file, *_position_of(error.token, readable))
            faults.append(Fault(place, *_unexpected(error, readable)))
            rest = None if _is_about_blocks(error) else _without(readable, place.line)
        if rest is None or len(faults) == MOST_FAULTS or len(faults) * len(text) > MOST_PARSED:
            raise OscError(faults)
        readable = rest
    if faults:
        raise OscError(faults)
    try:
        return Builder(file).transform(tree)
    except (RecursionError, VisitError) as error:
        if isinstance(error, VisitError) and not isinstance(error.orig_exc, RecursionError):
            raise
        raise OscError([too_long(file)]) from None


@cache
def _parser() -> Lark:
    grammar = (files("vastflow.sim.scenario.language") / "grammar.lark").read_text("utf-8")
    return Lark(
        grammar, start="file_", parser="lalr", postlex=Indentation(), maybe_placeholders=True, cache=_tables(grammar)
    )


def _tables(grammar: str) -> str | bool:
    """File for the tables that Lark makes of a grammar in 0.1 s, which every worker would spend; False where none can be kept."""
    folder = Path(platformdirs.user_cache_dir("vastflow")) / "grammars"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return str(folder / f"{hashlib.sha256(f'{lark_version} {grammar}'.encode()).hexdigest()[:16]}.lark")


def _is_about_blocks(error: UnexpectedToken) -> bool:
    """Whether what is wrong may be the indentation, or a line further up."""
    return error.token.type in ("_INDENT", "_DEDENT", "$END") or set(error.accepts or error.expected) == {"_INDENT"}


def _without(text: str, number: int) -> str | None:
    """`text` with something harmless in place of a line and the block below it; None where lines hang together."""
    lines = text.split("\n")
    before, line, after = lines[: number - 1], lines[number - 1], lines[number:]
    if STAND_IN in line or any(_open_brackets(part) for part in ("\n".join(before), line)):
        return None
    blanks = line[: len(line) - len(line.lstrip())]
    width = _width(line)
    count = next((i for i, below in enumerate(after) if below.strip() and _width(below) <= width), len(after))
    return "\n".join([*before, blanks + STAND_IN, *[""] * count, *after[count:]])


def _width(line: str) -> int:
    columns = line.expandtabs(TAB)
    return len(columns) - len(columns.lstrip())


def _open_brackets(text: str) -> int:
    code = QUIET.sub("", text)
    return sum(map(code.count, "([")) - sum(map(code.count, ")]"))


def _position_of(token: Token, text: str) -> tuple[int, int]:
    """Line and column of a token; the end of the file is behind its last word."""
    if token.type == "$END":
        before = text.rstrip()
        return before.count("\n") + 1, len(before) - (before.rfind("\n") + 1) + 1
    if token.type in ("_INDENT", "_DEDENT"):  # made out of the blanks before the line that they are about
        return token.end_line or 1, token.end_column or 1
    if token.type == "_NL" and (label := LABEL.search(text, 0, token.start_pos or 0)):
        return token.line or 1, (token.column or 1) - len(label[0])
    return token.line or 1, token.column or 1


def _stray(text: str, at: int) -> tuple[str, str]:
    """What is wrong where no word begins, and what would be right."""
    if text.startswith("/*", at):
        return "got a comment that does not end", "'*/' at its end"
    if text[at] in "'\"":
        return "got a string that does not end", f"{text[at]} before the end of the line"
    if text[at] == "|":
        return "got a name that does not end", "'|' before the end of the line"
    return f"got {text[at]!r}", "a name, a number, a string or an operator"


def _unexpected(error: UnexpectedToken, text: str) -> tuple[str, str]:
    token, expected = error.token, set(error.accepts or error.expected)
    if text.startswith("/*", token.start_pos or 0):
        return _stray(text, token.start_pos or 0)
    if token.type == "_NL" and (label := LABEL.search(text, 0, token.start_pos or 0)):
        near = nearest(label[1], BLOCKS)
        return f"got {label[1]!r}", f"did you mean {near!r}?" if near else f"{', '.join(BLOCKS)} or an action"
    if token.type == "_INDENT":
        return "got a line that is indented deeper than the one before", "the same indentation, or ':' on that line"
    found = {"_NL": "the end of the line", "_DEDENT": "the end of the block", "$END": "the end of the file"}.get(
        token.type, repr(str(token)[:40])
    )
    if token.type == "DOT" and text[: token.start_pos or 0][-1:].isdigit():
        return f"got {found}", "a number with digits after the point, such as 3.0"
    if expected == {"_INDENT"}:
        return f"got {found}", "a block, indented deeper than the line before"
    return f"got {found}", _right(str(token), expected)


def _right(found: str, expected: set[str]) -> str:
    words = {terminal.lower() for terminal in expected if terminal not in SPELLED}
    if near := nearest(found, words):
        return f"did you mean {near!r}?"
    said = expected - UNSAID or expected
    said = said - {"STAND_IN"}
    names = sorted(SPELLED.get(terminal, f"'{terminal.lower()}'") for terminal in said)
    if len(names) > MOST_EXPECTED:
        names = [*names[:MOST_EXPECTED], "others"]
    return " or ".join(filter(None, [", ".join(names[:-1]), names[-1]])) if names else "something else here"
