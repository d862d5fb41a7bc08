"""Coverage: the realized share of the requested test space, and the reasons for the rest."""

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.campaign_file.sections import DesignSpec
from vastflow.producers.designs.covering_array import admissible_tuples, designed_factors, lower_bound
from vastflow.producers.designs.space import FactorBlock, product_of
from vastflow.producers.model.configuration import Configuration, ExcludedInstance, RejectedInstance
from vastflow.producers.model.producer import Producer
from vastflow.sim.model.digest import Texts
from vastflow.sim.model.scenario import DIMENSION_OF_KEY, Dimension

STRENGTH: Final = 2
"""Number of choices in a counted combination."""
MOST_LISTED: Final = 100
"""Reasons of a producer, and pairs of factors, that are listed one by one; totals are of all."""

_Contents: TypeAlias = dict[Dimension, set[frozenset[tuple[str, str]]]]
"""The distinct contents of each dimension."""


@dataclass(frozen=True, slots=True)
class FamilyCount:
    """Counts of a family in addition to its configurations.

    Attributes:
        levels: For each producer, the most choices that it was asked for on one input.
        blocks: The space of a design; None for the full product.
    """

    name: str
    producers: Sequence[Producer[Any]]
    design: DesignSpec
    levels: tuple[int, ...]
    blocks: Sequence[FactorBlock] | None = None


def coverage_of(
    families: Sequence[FamilyCount],
    configurations: Sequence[Configuration],
    rejections: Sequence[RejectedInstance],
    excluded: Sequence[ExcludedInstance],
) -> dict[str, Any]:
    """Counts for the whole campaign and, below `families`, for each family.

    - `requested` |Q| is the sum of `excluded` (by φ), `unrealizable` (by a producer), `duplicate` and `realized` |C|
      (distinct scenarios). A partial configuration that is excluded or rejected counts once, though later producers
      would have made several configurations of it.
    - `valid` |V(D)|: what could have been realized and is no duplicate, and what was unrealizable; `share` is |C| of it.
      In a family with a design `valid` counts the whole space, of which the design takes some.
    - `excluded_by`: constraint to number; `unrealizable_by`: producer to number and reasons.
    - `dimensions`: distinct contents of each dimension among the realized, and in a family its choices.
    - `t_way`: of the combinations of any two producers' choices how many there are, how many are in some configuration
      that can be built and is not excluded (`admissible`), and how many of these are in one of the configurations
      (`covered`, as `share`). A choice is a place among all a producer yields for an input.
    """
    texts, parts = Texts(), dict[str, dict[str, Any]]()
    contents: _Contents = {dimension: set() for dimension in get_args(Dimension)}
    by_family: dict[str, list[Configuration]] = {family.name: [] for family in families}
    for configuration in configurations:
        by_family[configuration.family].append(configuration)
    for family in families:
        own = by_family[family.name]
        found: _Contents = {
            dimension: {
                frozenset([(key, texts(value)) for key, value in getattr(each.scenario, dimension).items()])
                for each in own
            }
            for dimension in contents
        }
        parts[family.name] = _family(
            family,
            own,
            [instance for instance in rejections if instance.family == family.name],
            [instance for instance in excluded if instance.family == family.name],
            found,
        )
        contents = {dimension: contents[dimension] | found[dimension] for dimension in contents}
    unseen = sum(part["valid"] for part in parts.values()) - sum(part["realized"] for part in parts.values())
    realized = sum(configuration.duplicate_of is None for configuration in configurations)
    return {
        **_counts(configurations, rejections, excluded, realized + unseen),
        "dimensions": {dimension: {"distinct": len(distinct)} for dimension, distinct in contents.items()},
        "t_way": {"strength": STRENGTH, **_sums([part["t_way"] for part in parts.values() if part["t_way"]])},
        "families": parts,
    }


def _family(
    family: FamilyCount,
    configurations: Sequence[Configuration],
    rejections: Sequence[RejectedInstance],
    excluded: Sequence[ExcludedInstance],
    contents: _Contents,
) -> dict[str, Any]:
    duplicates = sum(configuration.duplicate_of is not None for configuration in configurations)
    space = len(configurations) if family.blocks is None else product_of(family.blocks)
    choices = [[step.choice - 1 for step in configuration.steps] for configuration in configurations]
    levels = np.array(choices, dtype=np.int64).reshape(len(choices), len(family.producers))
    labels = _labels(family.producers)
    return {
        **_counts(configurations, rejections, excluded, space - duplicates + len(rejections)),
        "design": _design(family, len(configurations)),
        "factors": [{"name": label, "levels": n} for label, n in zip(labels, family.levels, strict=True)],
        "dimensions": _dimensions(family, labels, contents, levels),
        "t_way": _t_way(family, labels, levels),
    }


def _counts(
    configurations: Sequence[Configuration],
    rejections: Sequence[RejectedInstance],
    excluded: Sequence[ExcludedInstance],
    valid: int,
) -> dict[str, Any]:
    duplicates = sum(configuration.duplicate_of is not None for configuration in configurations)
    realized = len(configurations) - duplicates
    reasons: dict[str, Counter[str]] = {}
    for instance in rejections:
        reasons.setdefault(instance.producer, Counter())[instance.reason] += 1
    return {
        "requested": len(configurations) + len(rejections) + len(excluded),
        "excluded": len(excluded),
        "unrealizable": len(rejections),
        "duplicate": duplicates,
        "realized": realized,
        "valid": valid,
        "share": _share(realized, valid),
        "excluded_by": dict(Counter(instance.constraint for instance in excluded)),
        "unrealizable_by": {
            producer: {
                "count": counted.total(),
                "reasons": dict(counted.most_common(MOST_LISTED)),
                "reasons_not_listed": max(0, len(counted) - MOST_LISTED),
            }
            for producer, counted in reasons.items()
        },
    }


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def _design(family: FamilyCount, rows: int) -> dict[str, Any]:
    """The design's size against the full product and against what any design of its kind needs."""
    product = math.prod(family.levels)
    if family.design.t_way is not None and family.blocks is not None:
        strength = family.design.t_way.strength
        varied = designed_factors(family.blocks)
        bound = lower_bound(admissible_tuples(family.blocks, family.levels, varied, min(strength, len(varied))))
        return {"kind": "t_way", "strength": strength, "rows": rows, "product": product, "lower_bound": bound}
    if family.design.sample is not None:
        asked = family.design.sample
        return {"kind": "sample", "method": asked.method, "size": asked.size, "rows": rows, "product": product}
    return {"kind": "cartesian", "rows": rows, "product": product}


def _labels(producers: Sequence[Producer[Any]]) -> list[str]:
    """The keys each producer writes, numbered where two are alike."""
    labels: list[str] = []
    for producer in producers:
        keys = list(producer.writes) or [type(producer).__name__]
        label = ", ".join(keys[:3]) + ("" if len(keys) <= 3 else f" and {len(keys) - 3} more")
        labels.append(label if label not in labels else f"{label} ({len(labels) + 1})")
    return labels


def _dimensions(
    family: FamilyCount, labels: Sequence[str], contents: _Contents, levels: NDArray[np.int64]
) -> dict[str, dict[str, Any]]:
    of_environment = {key for content in contents["environment"] for key, _ in content}
    written = [
        {
            tag or DIMENSION_OF_KEY.get(key, "environment" if key in of_environment else "system")
            for key, tag in producer.writes.items()
        }
        for producer in family.producers
    ]
    found: dict[str, dict[str, Any]] = {}
    for dimension, distinct in contents.items():
        factors = tuple(i for i, dimensions in enumerate(written) if dimension in dimensions)
        counted = _counted(family, levels, factors)
        found[dimension] = {"factors": [labels[i] for i in factors], "distinct": len(distinct), **counted}
    return found


def _t_way(family: FamilyCount, labels: Sequence[str], levels: NDArray[np.int64]) -> dict[str, Any]:
    varied = [i for i, n in enumerate(family.levels) if n > 1]
    pairs = [
        {"factors": [labels[i] for i in pair], **_counted(family, levels, pair)}
        for pair in itertools.combinations(varied, STRENGTH)
    ]
    if not pairs:
        return {}
    pairs.sort(key=lambda pair: (pair["share"] is None, pair["share"], pair["admissible"] / pair["combinations"]))
    listed = {"pairs": pairs[:MOST_LISTED], "pairs_not_listed": max(0, len(pairs) - MOST_LISTED)}
    return {"strength": STRENGTH, **_sums(pairs), **listed}


def _sums(counted: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    counted = list(counted)
    sums = {key: sum(each[key] for each in counted) for key in ("combinations", "admissible", "covered")}
    return {**sums, "share": _share(sums["covered"], sums["admissible"])}


def _counted(family: FamilyCount, levels: NDArray[np.int64], factors: tuple[int, ...]) -> dict[str, Any]:
    """The combinations of these factors' levels: all, admissible, covered by rows of `levels`."""
    combinations = math.prod(family.levels[i] for i in factors)
    covered = _distinct_rows(levels[:, list(factors)])
    admissible = covered
    if family.blocks is not None:
        admissible = 1
        for block in family.blocks:
            places = [place for place, factor in enumerate(block.factors) if factor in factors]
            admissible *= _distinct_rows(block.table[:, places])
    return {
        "combinations": combinations,
        "admissible": admissible,
        "covered": covered,
        "share": _share(covered, admissible),
    }


def _distinct_rows(rows: NDArray[np.int64]) -> int:
    """Return the number of different rows of (N, M) numbers >= 0; without columns all rows are alike."""
    numbers = np.zeros(len(rows), dtype=np.int64)
    for column in rows.T:
        # Numbered anew after each column, so that no product overflows.
        numbers = np.unique(numbers * (int(column.max(initial=0)) + 1) + column, return_inverse=True)[1]
    return len(np.unique(numbers))
