"""Instantiation of families: C^i = {c ⊕ f : c ∈ C^(i-1), f ∈ p_i(c)}, less what φ excludes.

A producer is evaluated once per distinct restricted input and its results are joined back, so the flow can map
tasks over those inputs: a family's `Growth` gives the inputs of the next producer and is joined with the results, and
`instantiation_of` makes configurations of all families that are grown. `instantiate` does all of it in this process.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeAlias

from vastflow.producers.constraints.constraint import Checker, Constraint, step_of
from vastflow.producers.instantiation.coverage import FamilyCount, coverage_of
from vastflow.producers.instantiation.growth import DesignGrowth, Family, Grown
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
from vastflow.sim.model.faults import Fault, FileError
from vastflow.sim.model.scenario import Dimension, ProcessSetup, scenario_of


class InstantiableCampaign(Protocol):
    """The interface of `vastflow.producers.campaign.Campaign` that instantiation uses."""

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
        excluded: What constraints exclude; a partial configuration once, though more producers would have followed.
        coverage: How much of the requested test space was realised, see `vastflow.producers.instantiation.coverage.coverage_of`.
        sampled_from: How many distinct configurations these are a sample of; None where they are no sample.
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
    """Configurations and coverage of all families, each grown.

    Raises:
        FileError: constraints alone exclude everything there is, and `refuse_empty`.
    """
    configurations = mark_duplicates(
        configuration
        for family, each in zip(campaign.families, grown, strict=True)
        for configuration in finish(family, each.partials, campaign.abstract, campaign.timeout_s, campaign.programs)
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
    """One fault for a family of which constraints leave nothing: which they are and what each excluded."""
    counts = {constraint.name: 0 for constraint in constraints}
    for instance in excluded:
        if instance.family == family:
            counts[instance.constraint] += 1
    guilty = [constraint for constraint in constraints if counts[constraint.name]]
    if not guilty:
        return []
    named = ", ".join(f"{constraint.name} excludes {counts[constraint.name]}" for constraint in guilty)
    what = f"the constraints leave nothing of family {family!r}: {named}"
    return [Fault(guilty[0].place, what, "constraints that some configuration keeps")]


class CartesianGrowth:
    """The growth by every combination: each partial configuration with every choice of the next producer.

    `inputs` and `join` are called in turn for each producer, then `grown`; each raises a FileError where a constraint can't
    be evaluated. `inputs` gives digest and restricted input of all that the next producer must be evaluated on; `join` takes what
    `evaluate` gave for each digest, and drops what has no result.
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
        self._partials = self._kept(start(family))

    def inputs(self) -> dict[str, dict[str, Value]]:
        return distinct_inputs(self._family.producers[len(self._levels)], self._partials)

    def join(self, results: Mapping[str, Sequence[Fragment | Rejection]]) -> None:
        producer = self._family.producers[len(self._levels)]
        self._check_size(producer, results)
        children, rejected = join(self._family, producer, self._partials, results)
        self._rejections += rejected
        self._levels.append(max(map(len, results.values()), default=0))
        self._partials = self._kept(children)

    def _check_size(self, producer: Producer[Any], results: Mapping[str, Sequence[Fragment | Rejection]]) -> None:
        """Most producers have told before how many there are at most; this is for those that have not."""
        most = self._family.max_configurations
        if len(self._partials) * max(map(len, results.values()), default=0) <= most:
            return
        digest_of = _Digests()
        total = sum(len(results.get(digest_of(each.restricted(producer.reads)), ())) for each in self._partials)
        if total > most:
            what = f"{type(producer).__name__} makes {total:,} configurations of family {self._family.name!r}"
            right = f"at most {most:,}, or 'execution: {{max_configurations: {total}}}'"
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


Growth: TypeAlias = CartesianGrowth | DesignGrowth
"""A family under way through its producers."""


def growth_of(family: Family) -> Growth:
    """The growth of a family by its design."""
    return CartesianGrowth(family) if family.design.cartesian is not None else DesignGrowth(family)


def start(family: Family) -> list[Partial]:
    """C^0: the fixed parameters alone."""
    return [Partial(family.name, dict(family.values), dict(family.dimensions))]


def distinct_inputs(producer: Producer[Any], partials: Iterable[Partial]) -> dict[str, dict[str, Value]]:
    """Digest to input of everything `producer` must be evaluated on, in order of appearance."""
    reads = producer.reads
    inputs: dict[str, dict[str, Value]] = {}
    digest_of = _Digests()
    for partial in partials:
        restricted = partial.restricted(reads)
        inputs.setdefault(digest_of(restricted), restricted)
    return inputs


def join(
    family: Family,
    producer: Producer[Any],
    partials: Iterable[Partial],
    results: Mapping[str, Sequence[Fragment | Rejection]],
) -> tuple[list[Partial], list[RejectedInstance]]:
    """C^i: each partial configuration with each fragment of its restricted input; one without results is dropped.

    Children are called `<parent>-<k>`, k from 1 for each parent; a rejection takes no number. A parent for
    which the producer yielded nothing at all is a rejected instance too, so that none is lost in silence.

    Args:
        results: Digest of the restricted input (as `distinct_inputs` has it) to what `evaluate` gave.
    """
    children: list[Partial] = []
    rejected: list[RejectedInstance] = []
    label = type(producer).__name__
    reads, digest_of = producer.reads, _Digests()
    written = tags_of(producer, itertools.chain.from_iterable(results.values()))
    offered = {digest: _offered(label, items, written) for digest, items in results.items()}
    for parent in partials:
        inputs = parent.restricted(reads)
        digest = digest_of(inputs)
        if digest not in offered:
            continue
        fragments, rejections = offered[digest]
        for item in rejections:
            rejected.append(RejectedInstance(family.name, parent.name, label, item.reason, item.requested, inputs))
        for suffix, values, tags, step in fragments:
            dimensions = {**parent.dimensions, **tags} if tags else parent.dimensions
            children.append(
                Partial(parent.name + suffix, {**parent.values, **values}, dimensions, (*parent.steps, step))
            )
    return children, rejected


_Offered = list[tuple[str, Mapping[str, Value], Mapping[str, Dimension], Step]]


def _offered(
    label: str, items: Sequence[Fragment | Rejection], tags: Mapping[str, Dimension]
) -> tuple[_Offered, list[Rejection]]:
    """Return the name's suffix, values, tags and step of each fragment of one input, and the rejections."""
    fragments: _Offered = []
    for place, item in enumerate(items, 1):
        if isinstance(item, Fragment):
            own = {key: tags[key] for key in item.values if key in tags}
            fragments.append((f"-{len(fragments) + 1}", item.values, own, Step(label, tuple(item.values), place)))
    rejections = [item for item in items if isinstance(item, Rejection)]
    if not items:
        rejections.append(Rejection(f"{label} yielded nothing for this input"))
    return fragments, rejections


class _Digests:
    """Digests of restricted inputs; equal objects are digested once, since siblings share their parents' values."""

    def __init__(self) -> None:
        self._known: dict[tuple[tuple[str, int], ...], str] = {}

    def __call__(self, restricted: Mapping[str, Value]) -> str:
        """The digest; the values must outlive this object."""
        key = tuple((name, id(value)) for name, value in restricted.items())
        if key not in self._known:
            self._known[key] = restricted_digest(restricted)
        return self._known[key]


def finish(
    family: Family,
    partials: Iterable[Partial],
    abstract: str | FileContent,
    timeout_s: float,
    programs: ProcessSetup | None = None,
) -> list[Configuration]:
    """The configurations of a family's complete partial configurations.

    Args:
        abstract: The abstract scenario; empty: navigate_to_pose with a `goal_pose`, else navigate_through_poses.
        timeout_s: Simulated time after which a run ends.
    """
    chosen = [replace(partial, values={**partial.values, **family.overrides}) for partial in partials]
    return [
        Configuration(
            name=partial.name,
            family=family.name,
            scenario=scenario_of(
                partial.values,
                partial.dimensions,
                abstract=abstract or _abstract_of(partial),
                timeout_s=timeout_s,
                programs=programs,
            ),
            factors={key: value for key, value in partial.values.items() if not key.startswith("_")},
            provenance={key: value for key, value in partial.values.items() if key.startswith("_")},
            steps=partial.steps,
        )
        for partial in chosen
    ]


def mark_duplicates(configurations: Iterable[Configuration]) -> list[Configuration]:
    """The same configurations; one whose scenario an earlier one has names that one in `duplicate_of`."""
    first: dict[str, str] = {}
    marked: list[Configuration] = []
    texts = Texts()
    for configuration in configurations:
        name = first.setdefault(configuration.scenario.digested(texts), configuration.name)
        duplicate_of = None if name == configuration.name else name
        same = duplicate_of == configuration.duplicate_of
        marked.append(configuration if same else replace(configuration, duplicate_of=duplicate_of))
    return marked


def _abstract_of(partial: Partial) -> str:
    single = GOAL_KEY in partial.values and GOALS_KEY not in partial.values
    return "builtin:navigate_to_pose" if single else "builtin:navigate_through_poses"
