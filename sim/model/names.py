"""Names: which known one an unknown one was probably meant to be, and how that is said to a user."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Final

MOST_LISTED: Final = 40


SLIP: Final = 0.8
"""Likeness from which a name that would be read over counts as a slip."""


def nearest(found: str, known: Iterable[str], likeness: float = 0.6) -> str | None:
    """The known name that `found` was meant to be; None if none is near."""
    names = sorted(known)
    if near := get_close_matches(found, names, n=1, cutoff=likeness):
        return near[0]
    # Upper and lower case are far apart to difflib, and a frequent slip.
    return next((name for name in names if name.casefold() == found.casefold()), None)


def did_you_mean(
    found: str, known: Iterable[str], otherwise: str = "nothing of the kind is known", *, listed: str = "known:"
) -> str:
    """What to write in place of an unknown name: the nearest known one, else all of them.

    Args:
        otherwise: What is said where no name is known.
        listed: What is said before the known names.
    """
    names = sorted(known)
    if near := nearest(found, names):
        return f"did you mean {near!r}?"
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return f"{listed} {', '.join(names[:MOST_LISTED])}{more}" if names else otherwise
