"""Shipped descriptions of containers, Jobs and work pools: data with placeholders, filled with values."""

import json
import re
from collections.abc import Mapping
from importlib.resources import files
from typing import Any, Final

import yaml

_SHIPPED: Final = "vastflow.deployments"
_PLACEHOLDER: Final = re.compile(r"\{\{ (\w+) \}\}")


def template(name: str) -> Any:
    """The content of a file of `deployments/`, YAML or JSON, as new plain data."""
    text = files(_SHIPPED).joinpath(name).read_text(encoding="utf-8")
    return json.loads(text) if name.endswith(".json") else yaml.safe_load(text)


def filled(content: Any, values: Mapping[str, Any]) -> Any:
    """`content` with the value of `name` for each placeholder `{{ name }}`.

    A string that is one placeholder becomes the value, whatever its type; in a longer string the value is text. Values go into
    parsed data, never into the text of YAML, and are not searched for placeholders themselves.

    A value of None takes its key or item away, and with it what is empty then.

    Raises:
        KeyError: there is no such value.
    """
    if isinstance(content, str):
        if whole := _PLACEHOLDER.fullmatch(content):
            return values[whole[1]]
        return _PLACEHOLDER.sub(lambda found: str(values[found[1]]), content)
    if isinstance(content, dict):
        entries = {key: filled(inner, values) for key, inner in content.items()}
        left: Any = {key: value for key, value in entries.items() if value is not None}
    elif isinstance(content, list):
        left = [value for value in (filled(inner, values) for inner in content) if value is not None]
    else:
        return content
    return None if content and not left else left
