"""The work of a call, and the reasons for it, by comparison with the campaign before."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from vastflow.flows.results.past import Past, newest_past
from vastflow.flows.results.provenance import STAGES, Stage
from vastflow.flows.results.reasons import Reasons, Step, run_steps, whys
from vastflow.producers.instantiation.instantiate import Family
from vastflow.producers.model.configuration import Configuration
from vastflow.tasks.engine.forced import Forced
from vastflow.tasks.engine.index import FoundRuns
from vastflow.tasks.engine.instantiation import EvaluationRequest
from vastflow.tasks.store.store import Store

WHY: Final = "why"
"""Key of `metadata.json` with the rows of `DueWork`; absent where a directory is of before 0.2."""


@dataclass
class DueWork:
    """Work of a call: taken from the store, or computed and why.

    Attributes:
        folder: Has the directory of the campaign before, if there is one; it is read when something is due.
        today: Current ingredients, as `metadata.json` records them.
    """

    name: str
    folder: Path
    today: Mapping[str, Any] = field(repr=False)
    families: Sequence[Family] = field(repr=False)
    forced: Forced = field(default_factory=Forced, repr=False)
    _reused: dict[str, Counter[tuple[str, Stage]]] = field(default_factory=dict, repr=False)
    _due: list[Step] = field(default_factory=list, repr=False)

    @cached_property
    def _past(self) -> Past | None:
        return newest_past(self.folder, self.name)

    def reuse(self, found: Mapping[str, FoundRuns]) -> None:
        """Count what the store has of the campaign or a batch, which may have been counted before."""
        counted = self._reused[next(iter(found), "")] = Counter()
        for each in found.values():
            for step in run_steps(each.configuration, 0, each.stored):
                counted[step.family, step.stage] += step.amount

    def evaluate(self, store: Store, requests: Iterable[EvaluationRequest]) -> None:
        """Count evaluations of producers."""
        reasons = Reasons(self._past, self.today, self.families, self.forced)
        for request in requests:
            for each in request.evaluations:
                reason = None
                if store.find(each.key) is None:
                    reason = reasons.evaluation(request.family, request.producer, each)
                self._due.append(Step("instantiate", request.family, type(request.producer).__name__, 1, reason))

    def compute(self, found: Iterable[FoundRuns], configurations: Iterable[Configuration]) -> None:
        """Count what the store lacks, just before it is computed; `configurations` are all of today."""
        reasons = Reasons(self._past, self.today, self.families, self.forced)
        reasons.configurations = {each.name: each for each in configurations}
        for each in found:
            steps = run_steps(each.configuration, each.configuration.runs, each.stored, reasons)
            self._due += [step for step in steps if step.reason is not None]

    def rows(self) -> list[dict[str, Any]]:
        """Return family, stage, reused and computed amounts, and why.

        Amounts are evaluations and runs. What is computed anew is observed and judged, at most: a run that comes out as before
        keeps both.
        """
        reused, due = Counter[tuple[str, Stage]](), whys(self._due)
        for each in self._reused.values():
            reused += each
        for step in self._due:
            reused[step.family, step.stage] += step.amount * (step.reason is None)
        rows = []
        for family, stage in sorted(reused, key=lambda of: (of[0], STAGES.index(of[1]))):
            reasons = [why for why in due if (why.family, why.stage) == (family, stage)]
            row = {"family": family, "stage": stage, "reused": reused[family, stage]}
            rows.append({**row, "computed": sum(why.amount for why in reasons), "why": "; ".join(map(str, reasons))})
        return rows
