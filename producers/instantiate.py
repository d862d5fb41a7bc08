"""Instantiation: C^0 = {∅}; C^i = {c ⊕ f : c ∈ C^(i-1), f ∈ p_i(c restricted to what p_i reads)}.

A producer is evaluated once per distinct restricted input and its results are joined back, so the flow can map
tasks over those inputs: `start`, then for each producer `distinct_inputs`, `evaluate` and `join`, then `finish`, and
over all families `mark_duplicates`. `instantiate` does all of it in this process.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from vastflow.producers.configuration import (
    Configuration,
    Fragment,
    Partial,
    RejectedInstance,
    Rejection,
    Step,
    restricted_digest,
)
from vastflow.producers.producer import Producer, evaluate
from vastflow.producers.stops import GOAL_KEY, GOALS_KEY
from vastflow.sim.digest import Value
from vastflow.sim.scenario import Dimension, scenario_of


class Family(Protocol):
    """What instantiation needs of `vastflow.producers.family.Family`."""

    @property
    def name(self) -> str:
        """First part of every configuration's name."""

    @property
    def values(self) -> Mapping[str, Value]:
        """The fixed parameters."""

    @property
    def dimensions(self) -> Mapping[str, Dimension]:
        """Tags of fixed parameters."""

    @property
    def producers(self) -> Sequence[Producer[Any]]:
        """Π, in order."""


class Campaign(Protocol):
    """What instantiation needs of `vastflow.producers.campaign.Campaign`."""

    @property
    def families(self) -> Sequence[Family]:
        """The scenario families."""

    @property
    def abstract(self) -> str:
        """`builtin:…`, or empty where it follows from the goal."""

    @property
    def timeout_s(self) -> float:
        """Simulated time after which a run ends."""


@dataclass(frozen=True)
class Instantiation:
    """All of a campaign's configurations, duplicates included.

    Attributes:
        coverage: How much of the requested test space was realised, see `coverage_of`.
    """

    configurations: tuple[Configuration, ...]
    rejections: tuple[RejectedInstance, ...]
    coverage: Mapping[str, Any]


def instantiate(campaign: Campaign) -> Instantiation:
    """Every family of a campaign, one producer after the other, in this process."""
    configurations: list[Configuration] = []
    rejections: list[RejectedInstance] = []
    for family in campaign.families:
        partials = start(family)
        for producer in family.producers:
            results = {key: evaluate(producer, inputs) for key, inputs in distinct_inputs(producer, partials).items()}
            partials, rejected = join(family, producer, partials, results)
            rejections += rejected
        configurations += finish(family, partials, campaign.abstract, campaign.timeout_s)
    configurations = mark_duplicates(configurations)
    names = [family.name for family in campaign.families]
    return Instantiation(tuple(configurations), tuple(rejections), coverage_of(names, configurations, rejections))


def start(family: Family) -> list[Partial]:
    """C^0: the fixed parameters alone."""
    return [Partial(family.name, dict(family.values), dict(family.dimensions))]


def distinct_inputs(producer: Producer[Any], partials: Iterable[Partial]) -> dict[str, dict[str, Value]]:
    """Digest to input of everything `producer` must be evaluated on, in order of appearance."""
    inputs: dict[str, dict[str, Value]] = {}
    for partial in partials:
        restricted = partial.restricted(producer.reads)
        inputs.setdefault(restricted_digest(restricted), restricted)
    return inputs


def join(
    family: Family,
    producer: Producer[Any],
    partials: Iterable[Partial],
    results: Mapping[str, Sequence[Fragment | Rejection]],
) -> tuple[list[Partial], list[RejectedInstance]]:
    """C^i: each partial configuration with each fragment of its restricted input.

    Children are called `<parent>-<k>`, k from 1 for each parent; a rejection takes no number. A parent for
    which the producer yielded nothing at all is a rejected instance too, so that none is lost in silence.

    Args:
        results: Digest of the restricted input (as `distinct_inputs` has it) to what `evaluate` gave.
    """
    children: list[Partial] = []
    rejected: list[RejectedInstance] = []
    label = type(producer).__name__
    tags = {key: tag for key, tag in producer.writes.items() if tag is not None}
    for parent in partials:
        inputs = parent.restricted(producer.reads)
        k = 0
        for item in results[restricted_digest(inputs)] or [Rejection(f"{label} yielded nothing for this input")]:
            if isinstance(item, Rejection):
                rejected.append(RejectedInstance(family.name, parent.name, label, item.reason, item.requested, inputs))
                continue
            k += 1
            children.append(
                Partial(
                    f"{parent.name}-{k}",
                    {**parent.values, **item.values},
                    {**parent.dimensions, **{key: tags[key] for key in item.values if key in tags}},
                    (*parent.steps, Step(label, tuple(item.values))),
                )
            )
    return children, rejected


def finish(family: Family, partials: Iterable[Partial], abstract: str, timeout_s: float) -> list[Configuration]:
    """The configurations of a family's complete partial configurations.

    Args:
        abstract: Name of the abstract scenario; empty: navigate_to_pose with a `goal_pose`, else
            navigate_through_poses.
        timeout_s: Simulated time after which a run ends.
    """
    return [
        Configuration(
            name=partial.name,
            family=family.name,
            scenario=scenario_of(
                partial.values,
                partial.dimensions,
                abstract=abstract or _abstract_of(partial),
                timeout_s=timeout_s,
            ),
            factors={key: value for key, value in partial.values.items() if not key.startswith("_")},
            provenance={key: value for key, value in partial.values.items() if key.startswith("_")},
            steps=partial.steps,
        )
        for partial in partials
    ]


def mark_duplicates(configurations: Iterable[Configuration]) -> list[Configuration]:
    """The same configurations; one whose scenario an earlier one has names that one in `duplicate_of`."""
    first: dict[str, str] = {}
    marked: list[Configuration] = []
    for configuration in configurations:
        name = first.setdefault(configuration.scenario.digest, configuration.name)
        marked.append(replace(configuration, duplicate_of=None if name == configuration.name else name))
    return marked


def coverage_of(
    families: Sequence[str], configurations: Sequence[Configuration], rejections: Sequence[RejectedInstance]
) -> dict[str, Any]:
    """Counts for the whole campaign and, below `families`, for each family.

    `requested` is |Q|, the sum of `realised` (distinct scenarios), `duplicate` and `unrealisable`. A rejected
    instance counts once, though later producers would have made several configurations of it.
    """

    def counts(members: Sequence[Configuration], rejected: int) -> dict[str, int]:
        duplicates = sum(member.duplicate_of is not None for member in members)
        return {
            "requested": len(members) + rejected,
            "unrealisable": rejected,
            "duplicate": duplicates,
            "realised": len(members) - duplicates,
        }

    return {
        **counts(configurations, len(rejections)),
        "families": {
            family: counts(
                [member for member in configurations if member.family == family],
                sum(instance.family == family for instance in rejections),
            )
            for family in families
        },
    }


def _abstract_of(partial: Partial) -> str:
    single = GOAL_KEY in partial.values and GOALS_KEY not in partial.values
    return "builtin:navigate_to_pose" if single else "builtin:navigate_through_poses"
