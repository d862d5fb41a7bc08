"""The base class of oracles and of their parameter models."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from pydantic import BaseModel, ConfigDict

from vastflow.oracles.judgment.verdict import Metric, Verdict
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import Trace
from vastflow.sim.plug_ins.loading import module_of, snapshot_behind
from vastflow.sim.plug_ins.snapshot import Snapshot


class OracleParameters(BaseModel):
    """Base of parameter models: unknown keys are faults, values are frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True)


Parameters = OracleParameters
P = TypeVar("P", bound=Parameters)


class Oracle(ABC, Generic[P]):
    """A judge of single runs: a pure function of trace, situation and its parameters.

    A subclass names its parameter model and its metrics, if it has any, and writes `judge`.

    Attributes:
        Parameters: The pydantic model of its parameters in the campaign file.
        metrics: Name to unit of every metric, all of which each verdict has.
        name: Its name in the campaign file.
        base: Folder of names like `file.py:Class`.
    """

    Parameters: ClassVar[type[Parameters]]
    metrics: ClassVar[Mapping[str, str]] = {}

    def __init__(self, parameters: P, name: str, base: Path) -> None:
        self.parameters = parameters
        self.name = name
        self.base = base

    @abstractmethod
    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        """Judge one run with `passed`, `failed` or `not_judged`."""

    def judge_all(self, traces: Sequence[Trace], situation: Situation) -> list[Verdict]:
        """Judge several runs of one configuration, each independently of the others."""
        return [self.judge(trace, situation) for trace in traces]

    def passed(self, trace: Trace, **metrics: float | None) -> Verdict:
        """Return the verdict that the run meets the oracle's criterion."""
        return self._verdict(trace, "pass", "", metrics)

    def failed(self, trace: Trace, reason: str, **metrics: float | None) -> Verdict:
        """Return the verdict that the run misses the criterion; `reason` says how, with numbers."""
        return self._verdict(trace, "fail", reason, metrics)

    def not_judged(self, trace: Trace, reason: str, **metrics: float | None) -> Verdict:
        """The oracle lacks what `reason` names."""
        return self._verdict(trace, "not judged", reason, metrics)

    def _verdict(self, trace: Trace, judgment: Any, reason: str, metrics: Mapping[str, float | None]) -> Verdict:
        if unknown := sorted(set(metrics) - set(self.metrics)):
            raise ValueError(f"oracle {self.name!r} measures {sorted(self.metrics)}, got {unknown}")
        values = {name: Metric(metrics.get(name), unit) for name, unit in self.metrics.items()}
        return Verdict(self.name, trace.run.run_index, judgment, reason, values)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        if (snapshot := snapshot_behind(type(self))) is not None:  # in no module that another process could import
            return _restored, (snapshot, self.name, self.parameters.model_dump(), self.base)
        return type(self), (self.parameters, self.name, self.base)  # searching the entry points takes 10 ms


def _restored(snapshot: Snapshot, name: str, parameters: Mapping[str, Any], base: Path) -> Oracle[Any]:
    found = getattr(module_of(snapshot), name.rpartition(":")[2])
    oracle: Oracle[Any] = found(found.Parameters.model_validate(parameters), name, base)
    return oracle
