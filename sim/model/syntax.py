"""Translation of Lark's errors: the place of a syntax error, and the tokens allowed there."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from lark import Lark, UnexpectedInput, UnexpectedToken

from vastflow.sim.model.faults import Complaint, Got
from vastflow.sim.model.names import nearest

MOST_EXPECTED: Final = 6


@dataclass(frozen=True, slots=True)
class Misfit:
    """The first place where a text does not follow its grammar.

    Attributes:
        start, end: Indices of the token that does not fit; both behind the last word where the text ends too early.
        terminal: Terminal of that token; empty where no token begins, `$END` at the end of the text.
        expected: Terminals that could stand there.
    """

    start: int
    end: int
    terminal: str
    expected: frozenset[str]


def misfit(error: UnexpectedInput, text: str) -> Misfit:
    """Return the fault in `text` that an error of Lark's parser describes."""
    if not isinstance(error, UnexpectedToken):
        at = error.pos_in_stream or 0
        return Misfit(at, at, "", frozenset(getattr(error, "allowed", None) or ()))
    token, expected = error.token, frozenset(error.accepts or error.expected)
    if token.type == "$END":
        end = len(text.rstrip())
        return Misfit(end, end, token.type, expected)
    return Misfit(token.start_pos or 0, token.end_pos or 0, token.type, expected)


def line_and_column(text: str, at: int) -> tuple[int, int]:
    """Return line and column of an index, both from 1."""
    return text.count("\n", 0, at) + 1, at - text.rfind("\n", 0, at)


def spelling(parser: Lark, terminal: str, words: Mapping[str, str]) -> str:
    """Return a terminal as a text has it, in quotes, or the words for it."""
    if terminal in words:
        return words[terminal]
    blanks = re.sub(r"\\s\+|\\s\*(?==)", " ", str(parser.get_terminal(terminal).pattern.value))
    # Where blanks may stand, and where the word ends.
    return "'" + re.sub(r"\\s\*|\\b", "", blanks) + "'"


def misplaced(got: Got, word: str, listed: Iterable[str], suggested: Iterable[str] | None = None) -> Complaint:
    """Return the complaint about a word, with the keyword most similar to it, or all possible ones.

    Args:
        listed: Keywords and signs in quotes, other terminals in words.
        suggested: Names that `word` may have been meant to be; `listed` where it is None.
    """
    names = sorted(set(listed))
    if near := nearest(word, {name.strip("'") for name in suggested or names if " " not in name}):
        return f"unexpected {got.given}", f"did you mean {near!r}?"
    if len(names) > MOST_EXPECTED:
        names = [*names[:MOST_EXPECTED], "others"]
    return got, " or ".join(filter(None, [", ".join(names[:-1]), names[-1]])) if names else "something else here"
