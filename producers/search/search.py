"""The search of a campaign file: its space, its strategy, and the family of each point."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Protocol

from vastflow.producers.campaign_file.document import Document
from vastflow.producers.campaign_file.search import SEARCH, Quantity, SearchSpec, with_point
from vastflow.producers.instantiation.coverage import FamilyCount, coverage_of
from vastflow.producers.instantiation.family import FamilyReader
from vastflow.producers.instantiation.instantiate import Family, Instantiation, mark_duplicates
from vastflow.producers.model.configuration import Configuration
from vastflow.producers.search.sampling import Random, SamplingParameters
from vastflow.producers.search.space import Point, Space
from vastflow.producers.search.strategy import BASELINE, Problem, Proposal, Strategy
from vastflow.sim.model.faults import Fault, FileError

_BASELINE_BATCHES: Final = 10**6
"""Batches from this one on draw what no strategy draws."""


class ReadsFamilies(Protocol):
    """Gives a reader of the families of a document."""

    def __call__(self, document: Document) -> FamilyReader: ...


@dataclass(frozen=True)
class Search:
    """A search that has no fault; `quantities` are the numbers of a point that `extract` gives, by name."""

    spec: SearchSpec
    space: Space
    kind: type[Strategy[Any]]
    parameters: Any
    quantities: Mapping[str, Quantity]
    document: Document = field(repr=False)
    reader: ReadsFamilies = field(repr=False)

    @property
    def measures(self) -> Sequence[str]:
        """Names of the numbers or dimensions that the strategy needs in addition to the objective."""
        return self.kind.measures(self.parameters)

    def strategy(self) -> Strategy[Any]:
        """The strategy at its beginning; a UserError if it needs a library that is not installed."""
        return self.kind(self.parameters, self._problem)

    def baseline(self, proposals: Sequence[Proposal]) -> list[Proposal]:
        """Return as many random points as the strategy's of a batch; none if the file asks for none."""
        if self.spec.baseline is None or not proposals:
            return []
        random, stream = Random(SamplingParameters(), self._problem), _BASELINE_BATCHES + proposals[0].batch
        points = random.ask(stream, len(proposals))
        return [
            Proposal(each.number, each.batch, point, BASELINE) for each, point in zip(proposals, points, strict=True)
        ]

    @property
    def _problem(self) -> Problem:
        return Problem(self.space, self.spec.direction, self.spec.seed or 0, self.spec.per_batch)

    def family(self, proposal: Proposal) -> Family:
        """The family of one configuration that a proposal is.

        Raises:
            FileError: the template is wrong at this point; most such faults are found at the corners of the space before.
        """
        family, faults = family_at(self.document, self.spec, self.reader, proposal.point, proposal.name)
        if faults:
            at = ", ".join(f"{name} = {value}" for name, value in proposal.point.items())
            places = [replace(fault.place, where=f"{fault.place.where} at {at}") for fault in faults]
            raise FileError(replace(fault, place=place) for fault, place in zip(faults, places, strict=True))
        return family

    def instantiation(self, proposals: Sequence[Proposal], made: Instantiation) -> Instantiation:
        """Return the instantiation of proposals: one configuration each, called as the proposal.

        Raises:
            FileError: the template makes several configurations of a point.
        """
        named: list[Configuration] = []
        seen: set[str] = set()
        asked = {proposal.name: proposal for proposal in proposals}
        for each in made.configurations:
            if each.family in seen:
                step = next((k for k, one in enumerate(each.steps) if one.choice > 1), 0)
                producer = each.steps[step].producer if each.steps else ""
                raise FileError([several_fault(self.document, step, producer)])
            seen.add(each.family)
            proposal = asked[each.family]
            factors = {**proposal.point, **each.factors}
            named.append(replace(each, name=proposal.name, family=proposal.family, factors=factors, duplicate_of=None))
        configurations = tuple(mark_duplicates(named))
        rejections = tuple(
            replace(each, parent=each.family, family=asked[each.family].family) for each in made.rejections
        )
        excluded = tuple(replace(each, name=each.family, family=asked[each.family].family) for each in made.excluded)
        first = self.family(proposals[0])
        counts = [
            FamilyCount(name, first.producers, first.design, (1,) * len(first.producers))
            for name in dict.fromkeys(proposal.family for proposal in proposals)
        ]
        coverage = coverage_of(counts, configurations, rejections, excluded)
        return Instantiation(configurations, rejections, excluded, coverage)


def family_at(
    document: Document, spec: SearchSpec, reader: ReadsFamilies, point: Point, name: str, left_out: Sequence[int] = ()
) -> tuple[Family, list[Fault]]:
    """The template at a point as a family, without the producers `left_out`, and what is wrong with it there."""
    families = reader(with_point(document, spec, point, left_out))
    family = families.read(SEARCH, name, {})
    return family, [*families.faults, *families.unavailable.get(name, ())]


def several_fault(document: Document, step: int, producer: str) -> Fault:
    """Return the fault that a producer of the template makes several configurations of one point."""
    where = document.known((*SEARCH, "variations", step, producer))
    what = f"{producer or 'the template'} makes several configurations of one point"
    return document.fault(where, what, "ask for one path, one value, one obstacle configuration", "key")


def corners(space: Space) -> Iterator[Point]:
    """The points of least and of greatest values; and for each value of a choice one that has it."""
    n = len(space.dimensions)
    first = space.decoded([0.0] * n)
    yield first
    yield space.decoded([1.0] * n)
    for name, dimension in space.dimensions.items():
        yield from ({**first, name: value} for value in dimension.values or ())
