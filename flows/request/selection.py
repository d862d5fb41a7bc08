"""The selection: what of a campaign a call asks for."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.digest import digest


@dataclass(frozen=True, slots=True)
class Selection:
    """What of a campaign is run.

    Attributes:
        only: Names of families or configurations; empty for all.
        sample: How many distinct configurations of these, at most; None for all.
        seed: Of the sample.
    """

    only: Sequence[str] = ()
    sample: int | None = None
    seed: int = 0


EVERYTHING: Final = Selection()


def sampled(instantiation: Instantiation, size: int, seed: int) -> Instantiation:
    """A sample of `size` distinct configurations with their duplicates, in their order; all, if there are no more.

    In each family configurations have an order that follows from the digest of their content and the seed; the k-th of n, from
    0, has the place (k + 1/2) / n. The sample is the `size` least places: a larger one contains a smaller one, and families
    have their share as by Webster's method of apportionment. Nothing else in the campaign moves a configuration
    in its family.
    """
    distinct = [each for each in instantiation.configurations if each.duplicate_of is None]
    drawn = [(digest("sample", seed, each.scenario.digest), each) for each in distinct]
    order = sorted(drawn, key=lambda one: one[0])
    sizes = Counter(each.family for each in distinct)
    seen: Counter[str] = Counter()
    places: list[tuple[float, str, Configuration]] = []
    for drawn_as, each in order:
        places.append(((seen[each.family] + 0.5) / sizes[each.family], drawn_as, each))
        seen[each.family] += 1
    chosen = {each.name for _, _, each in sorted(places, key=lambda place: place[:2])[:size]}
    return replace(
        instantiation,
        configurations=tuple(c for c in instantiation.configurations if (c.duplicate_of or c.name) in chosen),
        sampled_from=len(distinct),
    )
