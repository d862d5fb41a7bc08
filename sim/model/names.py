"""Names: suggestions for unknown ones, and labels."""

import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Final

MOST_LISTED: Final = 40
SLIP: Final = 0.8
"""Similarity from which an ignored name counts as a misspelling."""


def nearest(found: str, known: Iterable[str], likeness: float = 0.6) -> str | None:
    """Return the known name most similar to `found`; None if none is similar."""
    names = sorted(known)
    if near := get_close_matches(found, names, n=1, cutoff=likeness):
        return near[0]
    # Upper and lower case are far apart to difflib, and a frequent slip.
    return next((name for name in names if name.casefold() == found.casefold()), None)


def did_you_mean(found: str, known: Iterable[str], otherwise: str = "there is none") -> str:
    """Suggest the nearest known name, else list all of them, else answer `otherwise`."""
    names = sorted(known)
    if near := nearest(found, names):
        return f"did you mean {near!r}?"
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    if len(names) == 1:
        return f"expected {names[0]!r}"
    return f"expected one of {', '.join(names[:MOST_LISTED])}{more}" if names else otherwise


def label_of(text: str) -> str:
    """Return the nearest DNS label (RFC 1123), as containers need; empty without letters and digits."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:63].rstrip("-")
