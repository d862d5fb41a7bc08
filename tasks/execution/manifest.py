"""What a container engine is given, as YAML."""

import re
from typing import Any, Final

import yaml

UNMISTAKABLE: Final = re.compile(r"[A-Za-z/][A-Za-z0-9_./:@-]+")
"""Text that no YAML reader takes for something else; PyYAML itself quotes `yes`, `true`, `null` and the like."""

_OTHER_BREAKS: Final = frozenset("\r\x85\u2028\u2029")
"""YAML 1.1 ends a line at these too, and reads some of them back as another."""


class _Dumper(yaml.SafeDumper):
    """Writes text for readers of YAML 1.1 and 1.2, to which `1e3`, `0o17` or `y` may be numbers and truth values."""

    def ignore_aliases(self, data: Any) -> bool:
        """Whether `data` is written again where it stands again: always."""
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    lines = "\n" in text and _OTHER_BREAKS.isdisjoint(text)
    style = "|" if lines else None if UNMISTAKABLE.fullmatch(text) else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _text)


def yaml_text(manifest: dict[str, Any]) -> str:
    """`manifest` in its own order, in YAML that loads back equal."""
    return str(yaml.dump(manifest, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120))
