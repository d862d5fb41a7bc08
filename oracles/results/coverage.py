"""Rows of `coverage.json` for report and terminal."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from vastflow.oracles.results.former import renamed_keys
from vastflow.sim.model.files import read_json

Coverage = Mapping[str, Any]
"""The value of `vastflow.producers.instantiation.coverage.coverage_of`."""

FILE: Final = "coverage.json"
COUNTS: Final = ("requested", "excluded", "unrealizable", "duplicate", "realized", "valid")


@dataclass(frozen=True, slots=True)
class Loss:
    """Requests of a family lost by a constraint, or by a producer with its reason."""

    family: str
    by: str
    reason: str
    times: int


@dataclass(frozen=True, slots=True)
class Covered:
    """Coverage of the combinations of some producers' choices.

    Attributes:
        factors: Varying keys of these producers.
        combinations, admissible, covered: All, those that can be built and are not excluded, and those in a configuration.
        share: Covered of admissible; None without any.
        distinct: Distinct contents of a dimension; None for a pair.
    """

    family: str
    what: str
    factors: tuple[str, ...]
    combinations: int
    admissible: int
    covered: int
    share: float | None
    distinct: int | None


def read_coverage(directory: Path) -> Coverage:
    """The coverage of the campaign directory `directory`.

    Raises:
        OSError: there is none.
        ValueError: it is damaged.
    """
    try:
        found = renamed_keys(read_json(directory / FILE))
        found["families"] = {family: renamed_keys(part) for family, part in found["families"].items()}
        for lines in (excluded, unrealizable, dimensions, pairs):
            tuple(lines(found))
        for _, part in parts(found):
            counts(part)
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{FILE}: not what vastflow writes there: {error!r}") from None
    return found


def parts(coverage: Coverage) -> list[tuple[str, Coverage]]:
    """Each family and, if there are several, the whole campaign as `all`."""
    families = list(coverage["families"].items())
    return families if len(families) == 1 else [*families, ("all", coverage)]


def counts(part: Coverage) -> tuple[int, ...]:
    return tuple(part[key] for key in COUNTS)


def excluded(coverage: Coverage) -> Iterator[Loss]:
    for family, part in coverage["families"].items():
        yield from (Loss(family, constraint, "", times) for constraint, times in part["excluded_by"].items())


def unrealizable(coverage: Coverage) -> Iterator[Loss]:
    """Requests rejected by each producer, by reason; the last row counts unlisted reasons."""
    for family, part in coverage["families"].items():
        for producer, said in part["unrealizable_by"].items():
            yield from (Loss(family, producer, reason, times) for reason, times in said["reasons"].items())
            if said["reasons_not_listed"]:
                rest = said["count"] - sum(said["reasons"].values())
                yield Loss(family, producer, f"{said['reasons_not_listed']:,} other reasons", rest)


def dimensions(coverage: Coverage) -> Iterator[Covered]:
    for family, part in coverage["families"].items():
        for dimension, said in part["dimensions"].items():
            yield _covered(family, dimension, said)


def pairs(coverage: Coverage) -> Iterator[Covered]:
    """The listed pairs of producers, in each family the least covered first."""
    for family, part in coverage["families"].items():
        for said in part["t_way"].get("pairs", ()):
            yield _covered(family, " × ".join(said["factors"]), said)


def pairs_not_listed(coverage: Coverage) -> int:
    """Number of pairs that `pairs` leaves out."""
    return sum(part["t_way"].get("pairs_not_listed", 0) for part in coverage["families"].values())


def design_text(design: Mapping[str, Any]) -> str:
    product = f"{design['product']:,}"
    if design["kind"] == "t_way":
        return f"{design['strength']}-way: {design['rows']:,} of {product}, at least {design['lower_bound']:,}"
    if design["kind"] == "sample":
        return f"{design['method']} sample: {design['rows']:,} of {product}"
    return f"all combinations: {product}"


def _covered(family: str, what: str, said: Mapping[str, Any]) -> Covered:
    combinations, admissible, covered, share = (said[key] for key in ("combinations", "admissible", "covered", "share"))
    distinct = said.get("distinct")
    return Covered(family, what, tuple(said["factors"]), combinations, admissible, covered, share, distinct)
