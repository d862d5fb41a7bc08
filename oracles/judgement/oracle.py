"""Oracles: their base class, and how a name, `file.py:Class`, or a notebook becomes one."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Final, Generic, NamedTuple, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from vastflow.oracles.judgement.verdict import Metric, Verdict
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import Trace
from vastflow.sim.model.faults import complaint
from vastflow.sim.model.files import is_file
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.plug_ins.effects import plug_in_code
from vastflow.sim.plug_ins.loading import module_of, snapshot_behind
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.registry import installed_plug_in, known_plug_ins
from vastflow.sim.plug_ins.snapshot import Snapshot, snapshot_of

GROUP: Final = "vastflow.oracles"
SUCCESS: Final = "success"
"""The oracle of the mission's outcome, which always judges first."""


class Parameters(BaseModel):
    """Base of parameter models: unknown keys are faults, values are frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True)


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

    def _verdict(self, trace: Trace, judgement: Any, reason: str, metrics: Mapping[str, float | None]) -> Verdict:
        if unknown := sorted(set(metrics) - set(self.metrics)):
            raise ValueError(f"oracle {self.name!r} measures {sorted(self.metrics)}, got {unknown}")
        values = {name: Metric(metrics.get(name), unit) for name, unit in self.metrics.items()}
        return Verdict(self.name, trace.run.run_index, judgement, reason, values)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        if (snapshot := snapshot_behind(type(self))) is not None:  # in no module that another process could import
            return _restored, (snapshot, self.name, self.parameters.model_dump(), self.base)
        return type(self), (self.parameters, self.name, self.base)  # searching the entry points takes 10 ms


def _restored(snapshot: Snapshot, name: str, parameters: Mapping[str, Any], base: Path) -> Oracle[Any]:
    found = _class_of(snapshot, name)
    oracle: Oracle[Any] = found(found.Parameters.model_validate(parameters), name, base)
    return oracle


class OracleFault(NamedTuple):
    """A mistake in the request of an oracle, at keys and indices below its parameters, or in its name."""

    location: tuple[str | int, ...]
    what: str
    right: str


class OracleError(ValueError):
    """A request that no oracle can be made of, with all faults."""

    def __init__(self, name: str, *faults: OracleFault) -> None:
        self.faults = faults
        lines = (f"{'.'.join(map(str, (name, *at)))}: {complaint(what, right)}" for at, what, right in faults)
        super().__init__("\n".join(lines))


def known_oracles() -> tuple[str, ...]:
    """Names in the entry-point group `vastflow.oracles`, sorted."""
    return known_plug_ins(GROUP)


def oracle_of(name: str, parameters: Mapping[str, Any], base: Path = Path()) -> Oracle[Any]:
    """The oracle called `name` in the entry-point group, or `file.py:Class` or `notebook.ipynb` relative to `base`.

    Raises:
        OracleError: there is none of this name, or its parameters are wrong.
    """
    found = oracle_class(name, base)
    try:
        with plug_in_code():
            return found(found.Parameters.model_validate(dict(parameters)), name, base)
    except ValidationError as error:
        raise OracleError(name, *(_fault(detail, found.Parameters) for detail in error.errors())) from None
    except Exception as error:
        raise _refused(name, f"it raised {type(error).__name__}: {error}", "an oracle that can be made") from error


def oracles_of(requests: Sequence[tuple[str, Mapping[str, Any]]], base: Path = Path()) -> tuple[Oracle[Any], ...]:
    """The oracles of a campaign from names and parameters, in their order of judging: `success` always, and first."""
    parameters = dict(requests)
    ordered = {SUCCESS: parameters.get(SUCCESS, {}), **parameters}
    return tuple(oracle_of(name, values, base) for name, values in ordered.items())


def oracle_class(name: str, base: Path = Path()) -> type[Oracle[Any]]:
    """The class called `name`, see `oracle_of`.

    Raises:
        OracleError: there is none of this name.
    """
    if ".py:" in name or name.endswith(".ipynb"):
        found = _class_of_file(name, base)
    elif (found := installed_plug_in(GROUP, name)) is None:
        raise _refused(name, f"no oracle {name!r}", did_you_mean(name, known_oracles(), listed="known oracles:"))
    if not (isinstance(found, type) and issubclass(found, Oracle)):
        raise _refused(name, f"{name!r} is not an oracle", "a subclass of vastflow.oracles.judgement.oracle.Oracle")
    return found


def _refused(name: str, what: str, right: str) -> OracleError:
    return OracleError(name, OracleFault((), what, right))


def _class_of(snapshot: Snapshot, name: str) -> Any:
    if ".py:" in name:
        return getattr(module_of(snapshot), name.rpartition(":")[2], None)
    from vastflow.oracles.judgement.notebook import notebook_oracle

    return notebook_oracle(snapshot)


def _class_of_file(name: str, base: Path) -> Any:
    file_name, _, class_name = name.rpartition(":") if ".py:" in name else (name, "", "")
    file = base / file_name
    if not is_file(file):
        what = "a Python file" if class_name else "a notebook"
        raise _refused(name, f"no file {str(file)!r}", f"{what} beside the campaign file")
    try:
        if class_name:
            snapshot = snapshot_of(file, base)
        else:
            from vastflow.oracles.judgement.notebook import notebook_code, read_cells

            read_cells(file)  # a cell that is no Python is named as such
            snapshot = snapshot_of(file, base, notebook_code(file))
        found = _class_of(snapshot, name)
    except PlugInError as error:
        raise _refused(name, error.what, error.right) from None
    except Exception as error:
        what = f"{str(file)!r} can't be imported: {type(error).__name__}: {error}"
        raise _refused(str(file), what, "a Python module") from error
    if found is None:
        raise _refused(name, f"{str(file)!r} has no class {class_name!r}", "file.py:Class")
    return found


def _fault(detail: Mapping[str, Any], model: type[Parameters]) -> OracleFault:
    location = tuple(detail["loc"])
    if detail["type"] == "extra_forbidden":
        known = sorted(model.model_fields)
        hint = did_you_mean(str(location[-1]), known, "known keys: none", listed="known keys:")
        return OracleFault(location, f"unknown key {location[-1]!r}", hint)
    message = str(detail["msg"])
    return OracleFault(location, f"got {detail['input']!r}", message[:1].lower() + message[1:])
