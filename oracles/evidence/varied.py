"""What varies: of each configuration, the values by which its outcome may be explained."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from vastflow.oracles.directory.configuration_table import ConfigurationTable

MEASURED: Final[Mapping[str, str]] = {"_path_length": "path length (m)"}
"""Numbers that follow from how a configuration was drawn, and what they are called."""

_DIGITS: Final = 2
"""Of `MEASURED`: a centimeter, which is less than a cell of a map."""


def varied_rows(
    configurations: ConfigurationTable, chosen: Iterable[int], environments: Mapping[str, str]
) -> list[dict[str, Any]]:
    """The factors of the configurations at the indices `chosen`, and the numbers of `MEASURED` that they have.

    Args:
        environments: Names of maps by their digests, where they have names.
    """
    return [
        {
            **{key: named(value, environments) for key, value in configurations.factors[k].items()},
            **_measured(configurations.provenances[k]),
        }
        for k in chosen
    ]


def _measured(provenance: Mapping[str, Any]) -> dict[str, float]:
    found = {name: provenance.get(key) for key, name in MEASURED.items()}
    return {name: round(value, _DIGITS) for name, value in found.items() if isinstance(value, int | float) and value}


def named(value: Any, environments: Mapping[str, str]) -> Any:
    """A file by the name that people know of it, or by the beginning of its digest."""
    if isinstance(value, dict) and set(value) == {"file"}:
        return environments.get(value["file"], str(value["file"])[:8])
    return value
