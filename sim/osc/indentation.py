"""Blocks by indentation, as tokens for the grammar."""

import re
from collections.abc import Iterator
from typing import Final

from lark import Token
from lark.lark import PostLex

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
                width = _width(token)
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
                    end.line or 1, end.column or 1, f"found {end + token!r}", f"a blank behind {str(end)!r}"
                )
            brackets += (token.type in OPENING) - (token.type in CLOSING)
            if brackets > DEEPEST:
                raise IndentationFault(token.line or 1, token.column or 1, "brackets are nested too deep", "fewer")
            begun, end = True, token
            yield token
        for _ in levels[1:]:
            yield Token.new_borrow_pos("_DEDENT", "", end)


def _width(token: Token) -> int | None:
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
            f"found a line indented by {width} blanks that belongs to no block",
            f"{levels[-1]} blanks, as the lines above it",
        )
