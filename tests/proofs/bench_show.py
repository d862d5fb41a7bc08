"""Results of a benchmark, as JSON or as a table."""

import json
from collections.abc import Iterator, Mapping
from typing import Any


def shown(found: Mapping[str, Any], *, as_json: bool) -> str:
    """One line of JSON, or a line for each value with its dotted name."""
    if as_json:
        return json.dumps(found)
    rows = list(_rows("", found))
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {text}" for name, text in rows)


def _rows(prefix: str, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _rows(f"{prefix}{name}.", value)
        else:
            yield prefix + name, f"{value:.4g}" if isinstance(value, float) else str(value)
