"""The defaults that Nav2's code declares, which count for what a parameter file leaves out; those of Jazzy, tag 1.3.12.

`tests/proofs/nav2_defaults.py` compares them with Nav2's source.
"""

import functools
import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Final, NamedTuple

from vastflow.sim.model.digest import Value


class Declared(NamedTuple):
    """A parameter as Nav2's code declares it.

    Attributes:
        default: None where the code declares a type alone. The number's type is the parameter's: an integer in a file is no double.
        source: File and line in Nav2's repository.
    """

    default: Value
    source: str


_TABLE: Final = "declared.txt"
"""Kinds of nodes, plug-ins, and groups: source file, then `name=default@line` for each parameter."""


@functools.cache
def declared_defaults() -> Mapping[str, Mapping[str, Declared]]:
    """Return the declared parameters of each kind of node, plug-in, or group in one."""
    found: dict[str, dict[str, Declared]] = {}
    text = (files("vastflow.sim.nav2.parameter_files") / _TABLE).read_text("utf-8")
    for entry in text.replace("\n  ", " ").splitlines():
        kinds, _, rest = entry.partition(": ")
        file, *parameters = rest.split()
        for kind in kinds.split(", "):
            group = found.setdefault(kind, {})
            for parameter in parameters:
                name, _, text = parameter.partition("=")
                default, _, line = text.rpartition("@")
                group[name] = Declared(json.loads(default), f"{file}:{line}")
    return found
