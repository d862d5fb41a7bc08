"""One value of a YAML file, set by its path."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from vastflow.sim.files import Unreadable, read_text, yaml_value

_TRUTHS: Final[Mapping[str, bool]] = {"true": True, "false": False}
_TYPES: Final[Mapping[str, Callable[[str], Any]]] = {
    "str": str,
    "int": int,
    "float": float,
    "bool": lambda text: _TRUTHS[text.lower()],
}


class YamlFault(ValueError):
    """A value that can't be set; says why."""


def set_yaml_value(
    source: Path, target: Path, key_path: str, value: str, value_type: str, create_missing: bool
) -> None:
    """Set one value of the document in `source` and write it to `target`; comments are lost.

    Args:
        key_path: Keys, and indices of lists, with dots between: `controller.plugins.0`.
        value_type: `str`, `int`, `float` or `bool`.
        create_missing: Make mappings that are not there.

    Raises:
        YamlFault: a file that can't be read or written, a path that leads nowhere, or a value not of its type.
    """
    try:
        typed = _TYPES[value_type](value)
    except KeyError:
        right = "true or false" if value_type == "bool" else f"a value_type of {', '.join(_TYPES)}"
        found = repr(value) if value_type == "bool" else f"value_type {value_type!r}"
        raise YamlFault(f"found {found}; {right}") from None
    except ValueError:
        raise YamlFault(f"found value {value!r}; one of type {value_type}") from None
    try:
        document = yaml_value(read_text(source, "a YAML file"))
        document = {} if document is None else document
        *parents, last = key_path.split(".")
        place = document
        for key in parents:
            place = _entered(place, key, key_path, create_missing)
        if not create_missing:
            _entered(place, last, key_path, False)
        _put(place, last, typed, key_path)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(yaml.safe_dump(document, sort_keys=False, allow_unicode=True))
    except Unreadable as error:
        raise YamlFault(f"{str(source)!r}: {error}") from None
    except OSError as error:
        raise YamlFault(f"{error.filename!r}: {error.strerror}") from None


def _entered(place: Any, key: str, key_path: str, create_missing: bool) -> Any:
    if isinstance(place, dict):
        if key not in place and create_missing:
            place[key] = {}
        if key in place:
            return place[key]
    elif isinstance(place, list) and key.isdigit() and int(key) < len(place):
        return place[int(key)]
    raise YamlFault(f"key_path {key_path!r} leads nowhere: there is no {key!r}")


def _put(place: Any, key: str, value: Any, key_path: str) -> None:
    if isinstance(place, dict):
        place[key] = value
    elif isinstance(place, list) and key.isdigit() and int(key) < len(place):
        place[int(key)] = value
    else:
        raise YamlFault(f"key_path {key_path!r} leads nowhere: there is no {key!r}")
