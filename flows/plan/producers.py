"""Producers in a dry run: evaluated in this process, with the reason why each evaluation is not in the store."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vastflow.flows.plan.reasons import MADE_BEFORE, NEVER, all_of, lost
from vastflow.flows.results.ingredients import DueReason, changes, evaluation_ingredients, has_ingredients
from vastflow.flows.results.past import Past, values_of
from vastflow.flows.results.tables import json_text
from vastflow.producers.floorplan.environment import environments_in
from vastflow.producers.instantiation.family import Family
from vastflow.producers.model.producer import Producer, evaluate
from vastflow.sim.model.digest import Value
from vastflow.tasks.evaluation import FRAGMENTS, write_evaluation
from vastflow.tasks.instantiation import Evaluation, EvaluationRequest
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
        reasons: None where there is no campaign before.
        environments: Folder for the files that producers make.
        evaluated: Key to what was asked for, in order.
    """

    store: Store
    reasons: "EvaluationReasons | None"
    environments: Path
    evaluated: dict[str, Evaluated] = field(default_factory=dict)

    def __call__(self, requests: Sequence[EvaluationRequest]) -> Mapping[str, str]:
        """Evaluate; key of each evaluation at which the producer raised to the error."""
        errors = {}
        for request in requests:
            name = type(request.producer).__name__
            for each in request.evaluations:
                if self.store.find(each.key) is not None:  # made here before, perhaps
                    self.evaluated.setdefault(each.key, Evaluated(request.family, name, None))
                    continue
                reason = self._reason(request, each)
                self.evaluated[each.key] = Evaluated(request.family, name, reason)
                try:
                    with environments_in(self.environments):
                        found = evaluate(request.producer, each.inputs)
                except Exception as error:  # noqa: BLE001 - a plug-in may raise anything: a fault of the run, too
                    errors[each.key] = f"{type(error).__name__}: {' '.join(str(error).split())}"
                    continue
                self.store.put(each.key, {FRAGMENTS: write_evaluation(found)})
        return errors

    def _reason(self, request: EvaluationRequest, evaluation: Evaluation) -> DueReason:
        return (
            NEVER if self.reasons is None else self.reasons.reason(request.family, request.producer, evaluation.inputs)
        )


class EvaluationReasons:
    """Why evaluations of producers are computed.

    Args:
        past: The campaign before.
        today: What `metadata.json` would say of the ingredients now.
    """

    def __init__(self, past: Past, today: Mapping[str, Any], families: Sequence[Family]) -> None:
        self._past = past
        self._today = today
        self._families = {family.name: family for family in families}
        self._texts: dict[tuple[str, tuple[str, ...]], set[str]] = {}

    def reason(self, family: str, producer: Producer[Any], inputs: Mapping[str, Value]) -> DueReason:
        """Why the evaluation of a producer of `family` on `inputs` is not in the store."""
        if not has_ingredients(self._past.metadata):
            return MADE_BEFORE
        name = type(producer).__name__
        rows = self._past.metadata["producers"].get(family)
        if rows is None:
            return DueReason("producer changed", f"family {family} is new")
        place = next(k for k, each in enumerate(self._families[family].producers) if each is producer)
        today = self._today["producers"][family]
        ordinal = [row["name"] for row in today[:place]].count(name)
        namesakes = [row for row in rows if row["name"] == name]  # the k-th of a name was the k-th of that name
        if ordinal >= len(namesakes):
            return DueReason("producer changed", f"{name} is new in {family}")
        then = evaluation_ingredients(self._past.metadata, namesakes[ordinal])
        now = evaluation_ingredients(self._today, today[place])
        return all_of([*changes(then, now)]) or self._inputs(family, name, inputs)

    def _inputs(self, family: str, name: str, inputs: Mapping[str, Value]) -> DueReason:
        reads = tuple(inputs)
        if json_text(inputs) in self._known(family, reads):
            return lost(self._past)
        fresh = [key for key in reads if json_text({key: inputs[key]}) not in self._known(family, (key,))]
        return DueReason(
            "input changed", f"what {name} reads changed", ", ".join(fresh) or "values that were not together before"
        )

    def _known(self, family: str, keys: tuple[str, ...]) -> set[str]:
        """Values of these keys together, of all configurations that the family had, as text."""
        if (family, keys) not in self._texts:
            rows = (values_of(row) for row in self._past.rows if row["family"] == family)
            self._texts[family, keys] = {json_text({key: each[key] for key in keys if key in each}) for each in rows}
        return self._texts[family, keys]
