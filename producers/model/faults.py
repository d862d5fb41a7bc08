"""Locations in a campaign file, and words of its faults."""

from typing import Final, TypeAlias

Location: TypeAlias = tuple[str | int, ...]
"""Path of a value from the top of the file: keys of mappings and indices of lists."""

MISSING_FILE: Final = "missing_file"
"""Type of the pydantic error of a parameter that names a file which is not there."""
NOT_EXECUTED = "not executed by this version"


def path_text(location: Location) -> str:
    """`configuration[0].name` for `("configuration", 0, "name")`; empty for the top."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def shown(value: object, limit: int = 60) -> str:
    """`value` as a YAML author would recognize it, in at most `limit` characters."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    text = repr(value)
    return text if len(text) <= limit else f"{text[: limit - 1]}…"
