"""Producers in a dry run: evaluated in this process, with the reason why each evaluation is not in the store."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vastflow.flows.plan.reasons import NEVER, DueReason, Origins, parameter_changes
from vastflow.flows.results.past import Past, values_of
from vastflow.flows.results.tables import json_text
from vastflow.producers.family import Family
from vastflow.producers.floorplan.environment import environments_in
from vastflow.producers.producer import Producer, evaluate
from vastflow.sim.digest import Value
from vastflow.tasks.evaluation import FRAGMENTS, write_evaluation
from vastflow.tasks.instantiation import Request
from vastflow.tasks.store import Store


@dataclass(frozen=True, slots=True)
class Evaluated:
    """An evaluation that a run would ask for.

    Attributes:
        reason: Why it would be computed; None where it is in the store.
    """

    family: str
    producer: str
    reason: DueReason | None


@dataclass
class HereEvaluator:
    """Evaluates what is missing in this process; see `vastflow.tasks.instantiation.Evaluator`.

    Attributes:
        store: Opened to be read only: what is evaluated here stays in it.
        environments: Folder for the files that producers make.
        evaluated: Key to what was asked for, in order.
    """

    store: Store
    reasons: "ProducerReasons"
    environments: Path
    evaluated: dict[str, Evaluated] = field(default_factory=dict)

    def __call__(self, requests: Sequence[Request]) -> Mapping[str, str]:
        """Evaluate; key of each evaluation at which the producer raised to the error."""
        errors = {}
        for request in requests:
            name = type(request.producer).__name__
            for each in request.evaluations:
                if self.store.find(each.key) is not None:  # made here before, perhaps
                    self.evaluated.setdefault(each.key, Evaluated(request.family, name, None))
                    continue
                reason = self.reasons.reason(request.family, request.producer, each.inputs)
                self.evaluated[each.key] = Evaluated(request.family, name, reason)
                try:
                    with environments_in(self.environments):
                        found = evaluate(request.producer, each.inputs)
                except Exception as error:  # noqa: BLE001 - a plug-in may raise anything: a fault of the run, too
                    errors[each.key] = f"{type(error).__name__}: {' '.join(str(error).split())}"
                    continue
                self.store.put(each.key, {FRAGMENTS: write_evaluation(found)})
        return errors


class ProducerReasons:
    """Why evaluations are computed.

    Args:
        past, origins: The campaign before and what changed since; None where there is none.
        today: What `metadata.json` would say of producers now.
    """

    def __init__(
        self,
        past: Past | None,
        origins: Origins | None,
        families: Sequence[Family],
        today: Mapping[str, Sequence[Mapping[str, Any]]],
    ) -> None:
        self._past = past
        self._origins = origins
        self._families = {family.name: family for family in families}
        self._today = today
        self._values: dict[str, list[dict[str, Any]]] = {}
        self._texts: dict[tuple[str, tuple[str, ...]], set[str]] = {}

    def reason(self, family: str, producer: Producer[Any], inputs: Mapping[str, Value]) -> DueReason:
        """Why the evaluation of a producer of `family` on `inputs` is not in the store."""
        if self._past is None or self._origins is None:
            return NEVER
        if "producers" not in self._past.metadata:
            return DueReason(
                "never computed", "not in this store; the campaign before, of an earlier version, says no more"
            )
        name = type(producer).__name__
        if family not in self._past.metadata["producers"]:
            return DueReason("producer changed", f"family {family} is new")
        then, now = self._rows(self._past, family, producer)
        if then is None:
            return DueReason("producer changed", f"{name} is new in {family}")
        if then["parameters"] != now["parameters"]:
            words = parameter_changes(then["parameters"], now["parameters"])
            return DueReason("producer changed", f"parameters of {name} changed", words)
        if then["source"] != now["source"]:
            own = ["its file"] if then["file"] != now["file"] else []
            words = "; ".join([*own, *self._origins.code(type(producer))])
            return DueReason("source changed", f"source of {name} changed", words)
        if changed := self._origins.stage_code("instantiate"):
            return DueReason("source changed", "source of instantiate changed", "; ".join(changed))
        if numeric := self._origins.numeric():
            return numeric
        return self._input_reason(self._past, family, producer, inputs)

    def _rows(
        self, past: Past, family: str, producer: Producer[Any]
    ) -> tuple[Mapping[str, Any] | None, Mapping[str, Any]]:
        """What is recorded of a producer and what would be now: the k-th of its name is the k-th of that name."""
        place = next(k for k, each in enumerate(self._families[family].producers) if each is producer)
        now = self._today[family]
        ordinal = [row["name"] for row in now[:place]].count(now[place]["name"])
        namesakes = [row for row in past.metadata["producers"][family] if row["name"] == now[place]["name"]]
        return (namesakes[ordinal] if ordinal < len(namesakes) else None), now[place]

    def _input_reason(self, past: Past, family: str, producer: Producer[Any], inputs: Mapping[str, Value]) -> DueReason:
        reads = tuple(inputs)
        if json_text(inputs) in self._known(past, family, reads):
            return DueReason("lost", "not in this store, though an earlier campaign had it", past.directory.name)
        fresh = [key for key in reads if json_text({key: inputs[key]}) not in self._known(past, family, (key,))]
        what = f"what {type(producer).__name__} reads changed"
        return DueReason("input changed", what, ", ".join(fresh) or "values that were not together before")

    def _known(self, past: Past, family: str, keys: tuple[str, ...]) -> set[str]:
        """Values of these keys together, of all configurations that the family had, as text."""
        if family not in self._values:
            self._values[family] = [values_of(row) for row in past.rows if row["family"] == family]
        if (family, keys) not in self._texts:
            of_keys = ({key: each[key] for key in keys if key in each} for each in self._values[family])
            self._texts[family, keys] = set(map(json_text, of_keys))
        return self._texts[family, keys]
