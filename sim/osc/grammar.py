"""From the text of a scenario file to its syntax, and the words for what does not follow the grammar."""

import hashlib
import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

import platformdirs
from lark import Lark, Token, UnexpectedCharacters, UnexpectedToken
from lark import __version__ as lark_version
from lark.exceptions import VisitError

from vastflow.sim.osc.building import Builder
from vastflow.sim.osc.definition import Place
from vastflow.sim.osc.faults import OscError, OscFault, too_long
from vastflow.sim.osc.indentation import TAB, Indentation, IndentationFault
from vastflow.sim.osc.syntax import FileText
from vastflow.sim.reading.names import nearest

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
    faults: list[OscFault] = []
    readable = text
    while True:
        try:
            tree = _parser().parse(readable + "\n")
            break
        except IndentationFault as fault:
            faults.append(OscFault(Place(file, fault.line, fault.column), fault.what, fault.right))
            raise OscError(faults) from None
        except UnexpectedCharacters as error:
            place = Place(file, error.line, error.column)
            faults.append(OscFault(place, *_stray(readable, error.pos_in_stream or 0)))
            rest = _without(readable, place.line)
        except UnexpectedToken as error:
            place = Place(file, *_position_of(error.token, readable))
            faults.append(OscFault(place, *_unexpected(error, readable)))
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
    grammar = (files("vastflow.sim.osc") / "grammar.lark").read_text("utf-8")
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
        return "found a comment that does not end", "'*/' at its end"
    if text[at] in "'\"":
        return "found a string that does not end", f"{text[at]} before the end of the line"
    if text[at] == "|":
        return "found a name that does not end", "'|' before the end of the line"
    return f"found {text[at]!r}", "a name, a number, a string or an operator"


def _unexpected(error: UnexpectedToken, text: str) -> tuple[str, str]:
    token, expected = error.token, set(error.accepts or error.expected)
    if text.startswith("/*", token.start_pos or 0):
        return _stray(text, token.start_pos or 0)
    if token.type == "_NL" and (label := LABEL.search(text, 0, token.start_pos or 0)):
        near = nearest(label[1], BLOCKS)
        return f"found {label[1]!r}", f"did you mean {near!r}?" if near else f"{', '.join(BLOCKS)} or an action"
    if token.type == "_INDENT":
        return "found a line that is indented deeper than the one before", "the same indentation, or ':' on that line"
    found = {"_NL": "the end of the line", "_DEDENT": "the end of the block", "$END": "the end of the file"}.get(
        token.type, repr(str(token)[:40])
    )
    if token.type == "DOT" and text[: token.start_pos or 0][-1:].isdigit():
        return f"found {found}", "a number with digits after the point, such as 3.0"
    if expected == {"_INDENT"}:
        return f"found {found}", "a block, indented deeper than the line before"
    return f"found {found}", _right(str(token), expected)


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
