"""A family whose configurations are a design: a covering array or a sample of its space of choices."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.configuration import Fragment, Rejection
from vastflow.producers.constraints.constraint import Checker
from vastflow.producers.coverage import FamilyCount
from vastflow.producers.designs.array import IncompleteDesign, covering_array, verify
from vastflow.producers.designs.sample import sampled
from vastflow.producers.designs.space import DesignSpace, FactorBlock, TooLarge
from vastflow.producers.faults import CampaignError
from vastflow.producers.growth import Grown, InstantiableFamily
from vastflow.producers.places.start_check import StartCheck
from vastflow.sim.model.digest import Value


class DesignGrowth:
    """Every producer is evaluated on all combinations of what it reads; then the design's rows are chosen.

    The rows are of those combinations only that can be built and are not excluded, so no row is lost. What producers
    rejected and constraints excluded on the way is told, each partial combination once.
    """

    def __init__(self, family: InstantiableFamily) -> None:
        self._family = family
        self._checker = Checker(family.name)
        self._space = DesignSpace(
            family.name,
            family.values,
            family.dimensions,
            family.producers,
            family.constraints,
            self._checker,
            start_check=StartCheck(family.name, family.overrides) if family.start_check == "footprint" else None,
        )

    def inputs(self) -> dict[str, dict[str, Value]]:
        """See `vastflow.producers.growth.Growth`."""
        try:
            found = self._space.inputs()
        except TooLarge as error:
            raise self._too_large(error) from None
        self._checker.raise_faults()
        return found

    def join(self, results: Mapping[str, Sequence[Fragment | Rejection]]) -> None:
        """See `vastflow.producers.growth.Growth`."""
        self._space.join(results)

    def grown(self) -> Grown:
        """See `vastflow.producers.growth.Growth`."""
        try:
            blocks = self._space.blocks()
            self._checker.raise_faults()
            rows = self._rows(blocks)
        except TooLarge as error:
            raise self._too_large(error) from None
        partials = [self._space.partial(row) for row in rows.tolist()]
        for partial in partials:
            if broken := self._checker.excluded(partial, self._family.constraints):
                raise IncompleteDesign(f"{partial.name} breaks {broken.constraint}")
        self._checker.raise_faults()
        levels = tuple(self._space.level_counts)
        count = FamilyCount(self._family.name, self._family.producers, self._family.design, levels, blocks)
        return Grown(partials, self._space.rejections, self._space.excluded, count)

    def _rows(self, blocks: Sequence[FactorBlock]) -> NDArray[np.int64]:
        design, levels = self._family.design, self._space.level_counts
        if design.sample is not None:
            return sampled(blocks, len(levels), design.sample)
        if design.t_way is None:
            raise ValueError("a design that is neither a covering array nor a sample")
        rows = covering_array(blocks, levels, design.t_way.strength)
        verify(rows, blocks, design.t_way.strength)
        return rows

    def _too_large(self, error: TooLarge) -> CampaignError:
        what = f"the design of family {self._family.name!r} is too large: {error}"
        return CampaignError(
            [self._family.place.fault(what, "fewer choices, or constraints that tie fewer producers together")]
        )
