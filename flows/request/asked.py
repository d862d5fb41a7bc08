"""The request in `metadata.json`, from which a campaign can be run again."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

SEQUENTIAL: Final = "sequential"
"""Key of `metadata.json` with the rule by which the runs of each configuration ended, if they did."""
SEARCH: Final = "search"
"""Key of `metadata.json` with what was searched and found, if the campaign was a search."""


@dataclass(frozen=True, slots=True)
class Asked:
    """The request of a finished campaign.

    Attributes:
        file: Name of the campaign file.
        runs: Of each configuration, at most where they end by a rule.
        only: Names of families or configurations; empty for all.
        places: File from outside of the campaign file's folder, relative to that, to its place below `inputs/`.
        sample: How many distinct configurations, drawn from those; None for all.
        as_v1: Whether every obstacle was placed as version 1 of RoboVAST does, whatever the file says.
        sequential: Whether they end by the file's rule.
    """

    file: str
    runs: int
    only: tuple[str, ...] = ()
    places: Mapping[str, str] = field(default_factory=dict)
    sample: int | None = None
    as_v1: bool = False
    sequential: bool = False

    @property
    def fixed_runs(self) -> int | None:
        """Runs to ask for instead of the file's; None where the file's rule ended them."""
        return None if self.sequential else self.runs

    def as_json(self) -> dict[str, Any]:
        """Plain values; the rule is elsewhere in `metadata.json`."""
        plain = {key: value for key, value in asdict(self).items() if key != "sequential"}
        return {**plain, "only": list(self.only)}


def asked_of(metadata: Mapping[str, Any]) -> Asked:
    """Return the request of a campaign directory.

    Raises:
        KeyError: its `metadata.json` does not say.
    """
    said = metadata["asked"]
    return Asked(
        said["file"],
        said["runs"],
        tuple(said["only"]),
        said["places"],
        said["sample"],
        said["as_v1"],
        bool(metadata.get(SEQUENTIAL)),
    )
