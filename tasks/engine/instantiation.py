"""Instantiation over the store: evaluations of producers are looked up, and the missing ones requested together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeAlias

from vastflow.producers.campaign import Campaign, Family
from vastflow.producers.instantiation.instantiate import (
    Growth,
    Instantiation,
    growth_of,
    instantiation_of,
    mark_duplicates,
)
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.producer import Producer
from vastflow.sim.model.digest import Value
from vastflow.tasks.engine.evaluation import FRAGMENTS, evaluation_keys, files_in, read_evaluation
from vastflow.tasks.engine.forced import Forced
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import SourceTree
from vastflow.tasks.store.store import Lost, Store

EvaluationResults: TypeAlias = Mapping[str, Sequence[Fragment | Rejection]]


@dataclass(frozen=True, slots=True)
class Evaluation:
    """A producer's evaluation on one restricted input, with the key of its artifact."""

    key: str
    inputs: Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class EvaluationRequest:
    """Evaluations of a producer that a family needs."""

    family: str
    producer: Producer[Any]
    evaluations: Sequence[Evaluation]


class Evaluator(Protocol):
    """Brings evaluations into the store."""

    def __call__(self, requests: Sequence[EvaluationRequest]) -> Mapping[str, str]:
        """Wait until all are stored; return the producers' errors by key."""


@dataclass(frozen=True, slots=True)
class ProducerFault:
    """A fault of a producer or file, which leaves some configurations of a family unknown.

    Attributes:
        producer: Empty if nothing of the family is known.
    """

    family: str
    producer: str
    error: str

    def concerns(self, name: str) -> bool:
        """True if a family or configuration of this name may differ without the fault."""
        return name == self.family or name.startswith(f"{self.family}-")

    def __str__(self) -> str:
        return f"{self.producer} of {self.family}: {self.error}" if self.producer else f"{self.family}: {self.error}"


@dataclass(frozen=True, slots=True)
class Instantiated:
    """An instantiation without what follows from a producer that raised."""

    instantiation: Instantiation
    faults: tuple[ProducerFault, ...] = ()


@dataclass(frozen=True, slots=True)
class Instantiator:
    """Instantiates a campaign from evaluations in the store.

    Attributes:
        refuse_empty: True if constraints that leave nothing are a fault of the file.
        forced: Removes evaluations that are made again.
    """

    campaign: Campaign
    store: Store
    keys: Keys
    tree: SourceTree
    refuse_empty: bool = True
    forced: Forced = field(default_factory=Forced)

    def stored(self) -> Instantiated | None:
        """Return the instantiation, if every evaluation is in the store."""
        try:
            return self.instantiated(self._all_there)
        except Lost:
            return None

    def instantiated(self, evaluator: Evaluator) -> Instantiated:
        """Return the instantiation; `evaluator` is called once for the i-th producers of all families.

        Raises:
            Lost: an evaluation is damaged.
            CampaignError: a constraint can't be evaluated, constraints leave nothing, or a design is too large.
        """
        families = [_Growing(family, growth_of(family)) for family in self.campaign.families]
        for step in range(max((len(family.producers) for family in self.campaign.families), default=0)):
            self._step([growing for growing in families if step < len(growing.family.producers)], step, evaluator)
        grown = [growing.growth.grown() for growing in families]
        instantiation = instantiation_of(self.campaign, grown, refuse_empty=self.refuse_empty)
        unavailable = [
            ProducerFault(family, "", str(fault))
            for family, missing in self.campaign.unavailable.items()
            for fault in missing
        ]
        faults = [fault for growing in families for fault in growing.faults]
        return Instantiated(instantiation, (*unavailable, *faults))

    def _all_there(self, requests: Sequence[EvaluationRequest]) -> Mapping[str, str]:
        for request in requests:
            if any(self.store.find(each.key) is None for each in request.evaluations):
                raise Lost(f"an evaluation of {type(request.producer).__name__} of {request.family}")
        return {}

    def _step(self, families: Sequence["_Growing"], step: int, evaluator: Evaluator) -> None:
        """Grow each family from C^step to C^(step + 1)."""
        asked: set[str] = set()
        requests: list[EvaluationRequest] = []
        inputs, keys = [], []
        for growing in families:
            producer = growing.family.producers[step]
            inputs.append(growing.growth.inputs())
            keys.append(evaluation_keys(self.keys, self.tree, producer, inputs[-1]))
            new = [Evaluation(key, inputs[-1][digest]) for digest, key in keys[-1].items() if key not in asked]
            asked.update(each.key for each in new)
            if new:
                requests.append(EvaluationRequest(growing.family.name, producer, new))
        self.forced.remove_evaluations(self.store, asked)
        errors = evaluator(requests)
        for growing, their_inputs, their_keys in zip(families, inputs, keys, strict=True):
            files = files_in(growing.family.producers[step].parameters, *their_inputs.values())
            results = {digest: self._read(key, files) for digest, key in their_keys.items() if key not in errors}
            growing.join(step, results, [errors[key] for key in their_keys.values() if key in errors])

    def _read(self, key: str, files: Mapping[str, str]) -> list[Fragment | Rejection]:
        content = self.store.read(key, FRAGMENTS)
        try:
            return read_evaluation(content, files)
        except Lost as error:  # it is whole, but names a file that a producer made and somebody deleted
            self.store.discard(key, str(error))
            raise


class _Growing:
    """A family on its way through its producers."""

    def __init__(self, family: Family, growth: Growth) -> None:
        self.family = family
        self.growth = growth
        self.faults: list[ProducerFault] = []

    def join(self, step: int, results: EvaluationResults, errors: Sequence[str]) -> None:
        kind = type(self.family.producers[step]).__name__
        self.faults += [ProducerFault(self.family.name, kind, error) for error in dict.fromkeys(errors)]
        self.growth.join(results)


def selected(instantiation: Instantiation, only: Sequence[str]) -> Instantiation:
    """Return the instantiation of the families and configurations called `only`.

    A configuration that stood for duplicates outside of `only` is run under the first remaining one's name.

    Raises:
        UnknownName: there is no such family or configuration.
    """
    families = {
        *(each.family for each in instantiation.configurations),
        *(each.family for each in instantiation.rejections),
        *(each.family for each in instantiation.excluded),
    }
    names = {c.name for c in instantiation.configurations}
    for name in only:
        if name not in families | names:
            raise UnknownName(name, tuple(sorted(families | names)))
    wanted = frozenset(only)
    configurations = [c for c in instantiation.configurations if not wanted.isdisjoint((c.family, c.name))]
    return replace(
        instantiation,
        configurations=tuple(mark_duplicates(configurations)),
        rejections=tuple(r for r in instantiation.rejections if r.family in wanted),
        excluded=tuple(e for e in instantiation.excluded if e.family in wanted),
    )


class UnknownName(LookupError):
    """No family or configuration has this name; `known` lists the names."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        super().__init__(f"no family or configuration {name!r}")
        self.name = name
        self.known = known
