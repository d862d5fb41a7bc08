"""Manifests: shipped templates, filled in and written as YAML."""

import re
from collections.abc import Mapping
from importlib.resources import files
from typing import Any, Final

import yaml

_SHIPPED: Final = "vastflow.deployments"
_PLACEHOLDER: Final = re.compile(r"\{\{ ((?:(?! \}\}).)+) \}\}")


def template(name: str) -> Any:
    """Return the content of a YAML or JSON file of `deployments/`, a list if it has several documents."""
    first, *others = yaml.safe_load_all(files(_SHIPPED).joinpath(name).read_text(encoding="utf-8"))
    return [first, *others] if others else first


def filled(content: Any, values: Mapping[str, Any]) -> Any:
    """Fill `content` with the value of each placeholder `{{ expression }}`, an expression of Jinja.

    A string that is one placeholder becomes the value of any type. Values are inserted into parsed data and not searched again.
    What has no value, or one without content, removes its key or item, and containers that are empty then.
    """
    if isinstance(content, str):
        if whole := _PLACEHOLDER.fullmatch(content):
            return _value(whole[1], values)
        return _PLACEHOLDER.sub(lambda found: str(_value(found[1], values)), content)
    if isinstance(content, dict):
        entries = {key: filled(inner, values) for key, inner in content.items()}
        left: Any = {key: value for key, value in entries.items() if value is not None}
    elif isinstance(content, list):
        left = [value for value in (filled(inner, values) for inner in content) if value is not None]
    else:
        return content
    return None if content and not left else left


def _value(expression: str, values: Mapping[str, Any]) -> Any:
    from jinja2 import Environment  # flows import this module, and few of them fill a template

    found = Environment().compile_expression(expression)(**values)
    return None if found in ((), [], {}) else found


UNMISTAKABLE: Final = re.compile(r"[A-Za-z/][A-Za-z0-9_./:@-]+")
"""Text that no YAML reader takes for something else; PyYAML itself quotes `yes`, `true`, `null` and the like."""

_OTHER_BREAKS: Final = frozenset("\r\x85\u2028\u2029")
"""YAML 1.1 ends a line at these too, and reads some of them back as another."""


class _Dumper(yaml.SafeDumper):
    """Dumper for readers of YAML 1.1 and 1.2, which quotes `1e3`, `0o17`, and `y`."""

    def ignore_aliases(self, data: Any) -> bool:
        """True: repeated data are written again."""
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    lines = "\n" in text and _OTHER_BREAKS.isdisjoint(text)
    style = "|" if lines else None if UNMISTAKABLE.fullmatch(text) else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _text)


def yaml_text(*manifests: Mapping[str, Any]) -> str:
    """Return manifests in their own order as documents of one YAML file, which loads back equal."""
    dumped = (yaml.dump(each, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120) for each in manifests)
    return "---\n".join(dumped)


def literal_variables(variables: Mapping[str, str]) -> list[dict[str, str]]:
    """Return variables of a container with doubled dollars, as Kubernetes replaces `$(NAME)` in values."""
    return [{"name": name, "value": value.replace("$", "$$")} for name, value in variables.items()]
