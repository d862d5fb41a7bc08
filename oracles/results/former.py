"""Names in campaign directories of version 1, which still open."""

from collections.abc import Mapping
from typing import Any, Final

VERSION: Final = 2
"""Version of a campaign directory's tables and JSON, its `schema` in `metadata.json`; 1 where that says none."""
FORMER: Final = {
    "judgement": "judgment",
    "unrealisable": "unrealizable",
    "unrealisable_by": "unrealizable_by",
    "realised": "realized",
}
"""Columns and keys of version 1 to what they are called now."""


def renamed_keys(row: Mapping[str, Any]) -> dict[str, Any]:
    """An object of JSON with the present names of its keys, see `FORMER`."""
    return {FORMER.get(key, key): value for key, value in row.items()}
