"""Instantiation of families: C^i = {c ⊕ f : c ∈ C^(i-1), f ∈ p_i(c)}, less what φ excludes.

A producer is evaluated once per distinct restricted input and its results are joined back, so the flow can map
tasks over those inputs: a family's `Growth` gives the inputs of the next producer and is joined with the results, and
`instantiation_of` makes configurations of all families that are grown. `instantiate` does all of it in this process.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.campaign_file.sections import CARTESIAN, DesignSpec
from vastflow.producers.campaign_file.spec import ExecutionSpec, StartCheckKind
from vastflow.producers.constraints.constraint import NOWHERE, Checker, Constraint, step_of
from vastflow.producers.designs.covering_array import covering_array
from vastflow.producers.designs.space import DesignSpace, FactorBlock, TooLarge, sampled
from vastflow.producers.instantiation.coverage import FamilyCount, coverage_of
from vastflow.producers.model.configuration import (
    Configuration,
    ExcludedInstance,
    Fragment,
    Partial,
    RejectedInstance,
    Rejection,
    Step,
    restricted_digest,
)
from vastflow.producers.model.producer import Producer, evaluate, tags_of
from vastflow.producers.places.start_check import StartCheck
from vastflow.producers.places.stops import GOAL_KEY, GOALS_KEY
from vastflow.sim.model.digest import FileContent, Texts, Value
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.sim.model.scenario import Dimension, ProcessSetup, scenario_of
from vastflow.sim.world.environment import GROUND_KEYS


@dataclass(frozen=True, slots=True)
class Family:
    """A scenario family F, ready to be instantiated.

    Attributes:
        values: K: the fixed parameters, maps as `FileContent`.
        dimensions: Dimension of each fixed parameter that differs from the usual one of its key.
        producers: Π, in order.
        constraints: φ.
        design: Which combinations of the producers' choices become configurations.
        place: Place of the design, for messages.
        max_configurations: Greatest number of configurations.
        overrides: Values that take the place of those of every configuration.
        start_check: Whether the robot's own footprint must fit where they begin and end.
    """

    name: str
    values: Mapping[str, Value]
    dimensions: Mapping[str, Dimension]
    producers: tuple[Producer[Any], ...]
    constraints: tuple[Constraint, ...] = ()
    design: DesignSpec = CARTESIAN
    place: Place = NOWHERE
    max_configurations: int = ExecutionSpec().max_configurations
    overrides: Mapping[str, Value] = field(default_factory=dict)
    start_check: StartCheckKind = "none"

    @property
    def drives(self) -> bool:
        """Whether a robot may drive in its configurations: without a map or a world nothing does."""
        written = {*self.values, *self.overrides, *(key for each in self.producers for key in each.writes)}
        return not written.isdisjoint(GROUND_KEYS)


@dataclass(frozen=True, slots=True)
class Grown:
    """A family that went through all its producers: its complete partial configurations and its counts."""

    partials: Sequence[Partial]
    rejections: Sequence[RejectedInstance]
    excluded: Sequence[ExcludedInstance]
    count: FamilyCount


class InstantiableCampaign(Protocol):
    """The interface of `vastflow.producers.campaign.Campaign` that instantiation uses.

    `abstract` is empty for a mission to the goals of each configuration; `timeout_s` is simulated time.
    """

    @property
    def families(self) -> Sequence[Family]: ...
    @property
    def abstract(self) -> str | FileContent: ...
    @property
    def programs(self) -> ProcessSetup | None: ...
    @property
    def timeout_s(self) -> float: ...


@dataclass(frozen=True)
class Instantiation:
    """All of a campaign's configurations, duplicates included.

    Attributes:
        excluded: Configurations that constraints exclude; a partial one once, though more producers would have followed.
        coverage: Coverage of the requested test space, see `vastflow.producers.instantiation.coverage.coverage_of`.
        sampled_from: Number of distinct configurations that the sample is drawn from; None without a sample.
    """

    configurations: tuple[Configuration, ...]
    rejections: tuple[RejectedInstance, ...]
    excluded: tuple[ExcludedInstance, ...]
    coverage: Mapping[str, Any]
    sampled_from: int | None = None


def instantiate(campaign: InstantiableCampaign) -> Instantiation:
    """Every family of a campaign, one producer after the other, in this process.

    Raises:
        FileError: a constraint can't be evaluated, constraints leave nothing, or a design is too large.
    """
    grown = []
    for family in campaign.families:
        growth = growth_of(family)
        for producer in family.producers:
            growth.join({key: evaluate(producer, inputs) for key, inputs in growth.inputs().items()})
        grown.append(growth.grown())
    return instantiation_of(campaign, grown)


def instantiation_of(
    campaign: InstantiableCampaign, grown: Sequence[Grown], *, refuse_empty: bool = True
) -> Instantiation:
    """Configurations and coverage of grown families; by default a FileError if constraints exclude everything."""
    configurations = mark_duplicates(
        configuration
        for family, each in zip(campaign.families, grown, strict=True)
        for configuration in _finished(family, each.partials, campaign)
    )
    excluded = tuple(instance for each in grown for instance in each.excluded)
    rejections = tuple(instance for each in grown for instance in each.rejections)
    if refuse_empty and not configurations and excluded and not rejections:
        raise FileError(
            fault for family in campaign.families for fault in contradictions(family.constraints, family.name, excluded)
        )
    coverage = coverage_of([each.count for each in grown], configurations, rejections, excluded)
    return Instantiation(tuple(configurations), rejections, excluded, coverage)


def contradictions(constraints: Sequence[Constraint], family: str, excluded: Iterable[ExcludedInstance]) -> list[Fault]:
    """Return the fault of a family without configurations, with the exclusions of each constraint."""
    counts = {constraint.name: 0 for constraint in constraints}
    for instance in excluded:
        if instance.family == family:
            counts[instance.constraint] += 1
    guilty = [constraint for constraint in constraints if counts[constraint.name]]
    if not guilty:
        return []
    named = ", ".join(f"{constraint.name} excludes {counts[constraint.name]}" for constraint in guilty)
    what = f"the constraints leave nothing of family {family!r}: {named}"
    return [Fault(guilty[0].place, what, "relax them")]


class CartesianGrowth:
    """The growth by every combination: each partial configuration with every choice of the next producer.

    `inputs` and `join` are called in turn for each producer, then `grown`; each raises a FileError where a constraint can't
    be evaluated. `inputs` gives digest and restricted input of all that the next producer must be evaluated on; `join` takes what
    `evaluate` gave for each digest, and drops what has no result.

    Children are called `<parent>-<k>`, k from 1 for each parent; a rejection takes no number. A parent for which the
    producer yielded nothing at all is a rejected instance too, so that none is lost in silence.
    """

    def __init__(self, family: Family) -> None:
        self._family = family
        self._checker = Checker(family.name)
        self._steps = [step_of(constraint, family.producers) for constraint in family.constraints]
        self._start_check = StartCheck(family.name, family.overrides) if family.start_check == "footprint" else None
        self._check_step = step_of(self._start_check, family.producers) if self._start_check else None
        self._rejections: list[RejectedInstance] = []
        self._excluded: list[ExcludedInstance] = []
        self._levels: list[int] = []
        self._partials = self._kept([Partial(family.name, dict(family.values), dict(family.dimensions))])

    def inputs(self) -> dict[str, dict[str, Value]]:
        found: dict[str, dict[str, Value]] = {}
        for _, digest, restricted in self._restricted():
            found.setdefault(digest, restricted)
        return found

    def join(self, results: Mapping[str, Sequence[Fragment | Rejection]]) -> None:
        producer = self._family.producers[len(self._levels)]
        most = max(map(len, results.values()), default=0)
        self._check_size(type(producer).__name__, most, results)
        written = tags_of(producer, itertools.chain.from_iterable(results.values()))
        label = type(producer).__name__
        offered = {digest: _offered(label, digest, items, written) for digest, items in results.items()}
        children: list[Partial] = []
        for parent, digest, restricted in self._restricted():
            if digest not in offered:
                continue
            fragments, rejections = offered[digest]
            self._rejections += [
                RejectedInstance(self._family.name, parent.name, label, each.reason, each.requested, restricted)
                for each in rejections
            ]
            for suffix, values, tags, step in fragments:
                dimensions = {**parent.dimensions, **tags} if tags else parent.dimensions
                children.append(
                    Partial(parent.name + suffix, {**parent.values, **values}, dimensions, (*parent.steps, step))
                )
        self._levels.append(most)
        self._partials = self._kept(children)

    def _restricted(self) -> Iterator[tuple[Partial, str, dict[str, Value]]]:
        """Yield each partial configuration with the next producer's input and its digest."""
        reads = self._family.producers[len(self._levels)].reads
        known: dict[
            tuple[tuple[str, int], ...], str
        ] = {}  # equal objects once, since siblings share their parents' values
        for partial in self._partials:
            restricted = partial.restricted(reads)
            key = tuple((name, id(value)) for name, value in restricted.items())
            if key not in known:
                known[key] = restricted_digest(restricted)
            yield partial, known[key], restricted

    def _check_size(self, label: str, most: int, results: Mapping[str, Sequence[Fragment | Rejection]]) -> None:
        """Refuse a product that is too large, of producers that do not declare their number of choices."""
        limit = self._family.max_configurations
        if len(self._partials) * most <= limit:
            return
        total = sum(len(results.get(digest, ())) for _, digest, _ in self._restricted())
        if total > limit:
            what = f"{label} makes {total:,} configurations of family {self._family.name!r}"
            right = f"at most {limit:,} are allowed, unless 'execution: {{max_configurations: {total}}}' permits more"
            raise FileError([Fault(self._family.place, what, right)])

    def grown(self) -> Grown:
        count = FamilyCount(self._family.name, self._family.producers, self._family.design, tuple(self._levels))
        return Grown(self._partials, self._rejections, self._excluded, count)

    def _kept(self, partials: list[Partial]) -> list[Partial]:
        """The partial configurations that keep all constraints which can be looked at by now, and the start check then."""
        step = len(self._levels) - 1
        ready = [c for c, own in zip(self._family.constraints, self._steps, strict=True) if own == step]
        start_check = self._start_check if step == self._check_step else None
        if not ready and start_check is None:
            return partials
        kept = []
        for partial in partials:
            excluded = self._checker.excluded(partial, ready)
            if excluded is not None:
                self._excluded.append(excluded)
            elif start_check is not None and (rejected := start_check.rejected(partial)):
                self._rejections.append(rejected)
            else:
                kept.append(partial)
        self._checker.raise_faults()
        return kept


class DesignGrowth:
    """The growth by a covering array or sample.

    Every producer is evaluated on all combinations of what it reads; then the design's rows are chosen.

    The rows are of those combinations only that can be built and are not excluded, so no row is lost. What producers
    rejected and constraints excluded on the way is told, each partial combination once.
    """

    def __init__(self, family: Family) -> None:
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
        try:
            found = self._space.inputs()
        except TooLarge as error:
            raise self._too_large(error) from None
        self._checker.raise_faults()
        return found

    def join(self, results: Mapping[str, Sequence[Fragment | Rejection]]) -> None:
        self._space.join(results)

    def grown(self) -> Grown:
        try:
            blocks = self._space.blocks()
            self._checker.raise_faults()
            rows = self._rows(blocks)
        except TooLarge as error:
            raise self._too_large(error) from None
        partials = [self._space.partial(row) for row in rows.tolist()]
        for partial in partials:
            if broken := self._checker.excluded(partial, self._family.constraints):
                raise RuntimeError(f"{partial.name} breaks {broken.constraint}")
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
        return covering_array(blocks, levels, design.t_way.strength)

    def _too_large(self, error: TooLarge) -> FileError:
        what = f"the design of family {self._family.name!r} is too large: {error}"
        right = "ask for fewer choices, or for constraints that tie fewer producers together"
        return FileError([Fault(self._family.place, what, right)])


Growth: TypeAlias = CartesianGrowth | DesignGrowth
"""A family under way through its producers."""


def growth_of(family: Family) -> Growth:
    return CartesianGrowth(family) if family.design.cartesian is not None else DesignGrowth(family)


def _offered(
    label: str, digest: str, items: Sequence[Fragment | Rejection], tags: Mapping[str, Dimension]
) -> tuple[list[tuple[str, Mapping[str, Value], dict[str, Dimension], Step]], list[Rejection]]:
    """Return the name's suffix, values, tags and step of each fragment of one input, and the rejections."""
    places = [(place, item) for place, item in enumerate(items, 1) if isinstance(item, Fragment)]
    fragments = [
        (
            f"-{k}",
            item.values,
            {key: tags[key] for key in item.values if key in tags},
            Step(label, tuple(item.values), place, digest),
        )
        for k, (place, item) in enumerate(places, 1)
    ]
    rejections = [item for item in items if isinstance(item, Rejection)]
    return fragments, rejections if items else [Rejection(f"{label} yielded nothing for this input")]


def _finished(family: Family, partials: Iterable[Partial], campaign: InstantiableCampaign) -> Iterator[Configuration]:
    for partial in partials:
        values = {**partial.values, **family.overrides}
        single = GOAL_KEY in values and GOALS_KEY not in values
        mission = "builtin:navigate_to_pose" if single else "builtin:navigate_through_poses"
        yield Configuration(
            name=partial.name,
            family=family.name,
            scenario=scenario_of(
                values,
                partial.dimensions,
                abstract=campaign.abstract or mission,
                timeout_s=campaign.timeout_s,
                programs=campaign.programs,
            ),
            factors={key: value for key, value in values.items() if not key.startswith("_")},
            provenance={key: value for key, value in values.items() if key.startswith("_")},
            steps=partial.steps,
        )


def mark_duplicates(configurations: Iterable[Configuration]) -> list[Configuration]:
    """The configurations, where a repeated scenario names its first configuration in `duplicate_of`."""
    first: dict[str, str] = {}
    marked: list[Configuration] = []
    texts = Texts()
    for configuration in configurations:
        name = first.setdefault(configuration.scenario.digested(texts), configuration.name)
        duplicate_of = None if name == configuration.name else name
        same = duplicate_of == configuration.duplicate_of
        marked.append(configuration if same else replace(configuration, duplicate_of=duplicate_of))
    return marked
