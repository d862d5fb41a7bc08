"""The `search` section of a campaign file: its keys, and its template with `$name` for searched values."""

import re
from collections.abc import Container, Iterator, Mapping
from dataclasses import replace
from typing import Annotated, Any, Final, Literal, Self, TypeAlias

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from vastflow.producers.campaign_file.document import Document
from vastflow.producers.campaign_file.sections import NamedSteps, Section, SingleKeys
from vastflow.producers.model.faults import Location, shown
from vastflow.producers.model.numbers import Amount, Count, NotNegative, Number, Positive, Seed
from vastflow.sim.model.faults import Fault, Got, Invalid
from vastflow.sim.model.names import did_you_mean

FAILURE_RATE: Final = "failure_rate"
"""The plug-in of `extract`, and the number that it gives."""
METRICS: Final = "metrics"

_KEYS: Final[Mapping[str, frozenset[str]]] = {
    "float": frozenset({"low", "high", "log"}),
    "int": frozenset({"low", "high", "log", "step"}),
    "choice": frozenset({"values"}),
    "bool": frozenset(),
}
"""Type of a dimension to the keys that it has beside its type."""


class SearchDimension(Section):
    """A searched parameter: `float` or `int` with bounds, `choice` with values, or `bool`."""

    type: Literal["float", "int", "choice", "bool"]
    """Kind of the values: a number, a whole number, one of `values`, or true and false."""
    low: Number | None = None
    """Least value of a number, included."""
    high: Number | None = None
    """Greatest value of a number, included."""
    log: Annotated[bool, Field(strict=True)] = False
    """Whether a number is searched on a logarithmic scale; `low` is then greater than 0."""
    step: Annotated[int, Field(strict=True, ge=1)] | None = None
    """Distance between whole numbers that are tried; 1 where none is given. Not together with `log`."""
    values: Annotated[list[Any], Field(min_length=1)] | None = None
    """The values of a `choice`."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        known = _KEYS[self.type]
        for key in sorted(self.model_fields_set - {"type"} - known):
            right = did_you_mean(key, known) if known else "it takes no other key"
            raise _wrong(Invalid(f"{key!r} has no meaning for type {self.type}", right), at=key)
        if self.type == "choice" and self.values is None:
            raise Invalid("the choice has no values", "add 'values: [...]'")
        if self.type not in ("float", "int"):
            return self
        if self.low is None or self.high is None:
            raise Invalid("the range lacks a bound", "expected both low and high")
        if self.low > self.high:
            raise Invalid(f"'low' is {self.low:g} and 'high' {self.high:g}", "'low' must not be greater than 'high'")
        for name, bound in (("low", self.low), ("high", self.high)):
            if self.type == "int" and not bound.is_integer():
                raise _wrong(Invalid(Got(f"{bound:g}"), "a whole number, as type int has"), at=name)
        if self.log and self.low <= 0:
            raise Invalid(f"'low' is {self.low:g} on a logarithmic scale", "it must be greater than 0")
        if self.log and self.step not in (None, 1):
            raise Invalid("'log' and 'step' are both given", "keep one of them")
        return self

    @property
    def first(self) -> Any:
        """A value of this domain: its lowest, its first, or false."""
        if self.values is not None:
            return self.values[0]
        if self.low is None:
            return False
        return int(self.low) if self.type == "int" else self.low


class Quantity(Section):
    """A number of a point: what one oracle or all say of its runs, taken together."""

    oracle: Annotated[str, Field(min_length=1)] | None = None
    """Name of an oracle of `evaluation.oracles`, or `success`; all together where none is given."""
    metric: Annotated[str, Field(min_length=1)] | None = None
    """Name of a metric of the oracle, in its unit; the failure rate (0 to 1) of judged runs where none is given."""
    aggregate: Literal["mean", "median", "min", "max", "quantile"] = "mean"
    """Function from the metric of single runs to one number; a rate is always a mean."""
    q: Annotated[Number, Field(ge=0, le=1)] | None = None
    """The quantile, from 0 to 1; with `aggregate: quantile`."""

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.metric is not None and self.oracle is None:
            raise Invalid("there is a metric without an oracle", "name the oracle that measures it")
        if self.metric is None and self.model_fields_set & {"aggregate", "q"}:
            raise Invalid("there is an aggregate without a metric", "a failure rate has none")
        if (self.aggregate == "quantile") != (self.q is not None):
            raise Invalid(f"'aggregate' is {self.aggregate}", "quantile needs 'q', and others do without")
        return self


class Extract(Section):
    """The plug-in that turns a point's runs into numbers: `failure_rate`, `metrics` or `file.py:Class`."""

    plugin: Annotated[str, Field(min_length=1)]
    """`failure_rate`, `metrics`, or `file.py:Class` relative to the campaign file."""
    params: dict[str, Any] = Field(default_factory=dict)
    """For `failure_rate` empty or `{oracle}`; for `metrics` name to `{oracle, metric, aggregate, q}`."""


class Objective(Section):
    """A number that the search drives."""

    name: Annotated[str, Field(min_length=1)]
    """Name of the number, as `extract` gives it."""
    direction: Literal["maximize", "minimize"] = "maximize"
    """Whether the search looks for its greatest or its least value."""


class _Criterion(Section):
    @model_validator(mode="after")
    def _one(self) -> Self:
        if not self.model_fields_set:
            raise Invalid(Got(shown({})), f"one of {', '.join(type(self).model_fields)}")
        return self


class Budget(_Criterion):
    """The budget of the search."""

    batches: Count | None = None
    """Batches of points."""
    time: Positive | None = None
    """Seconds on the clock."""
    evaluations: Count | None = None
    """Points that were judged: not those that can't be built."""
    runs: Count | None = None
    """Runs of all points together."""
    simulated_hours: Positive | None = None
    """Not part of version 1 elsewhere."""


class NoImprovement(Section):
    """Stop when the objective no longer improves; a plain number is `patience`."""

    patience: Count
    """Number of batches in a row without improvement after which the search ends."""
    min_delta: NotNegative = 0.0
    """Least change of the objective, in its unit, that counts as improvement."""


class StopMetric(Section):
    """Stop when a number that the strategy reports passes a value."""

    name: Annotated[str, Field(min_length=1)]
    """Name of the number, as the strategy reports it."""
    op: Literal[">", ">=", "<", "<=", "==", "!="] = ">="
    """Comparison of the number with `value`."""
    value: Number
    """Threshold, in the unit of the number."""


def _target(value: Any) -> Any:
    return value["value"] if isinstance(value, Mapping) and set(value) == {"value"} else value


def _patience(value: Any) -> Any:
    return {"patience": value} if isinstance(value, int) and not isinstance(value, bool) else value


class Stopping(_Criterion):
    """When the search ends before its budget is spent."""

    target_objective: Annotated[Number, BeforeValidator(_target)] | None = None
    """Value of the objective, in its unit, at which the search ends: a number, or `{value}`."""
    no_improvement: Annotated[NoImprovement, BeforeValidator(_patience)] | None = None
    """When the objective stands still: a number of batches, or `{patience, min_delta}`."""
    metric: StopMetric | None = None
    """When a number that the strategy reports passes a value."""


def _entries(value: Any) -> Any:
    """Criteria as a list; a mapping is short for a list with one entry."""
    return [] if value is None else [value] if isinstance(value, Mapping) else value


Budgets: TypeAlias = Annotated[list[Budget], BeforeValidator(_entries, json_schema_input_type=list[Budget] | Budget)]
"""Any one that is spent ends the search."""
Stoppings: TypeAlias = Annotated[
    list[Stopping], BeforeValidator(_entries, json_schema_input_type=list[Stopping] | Stopping)
]
"""Any one that is fulfilled ends the search."""


class SearchSpec(Section):
    """Points that a strategy proposes, in place of `configuration`."""

    strategy: Annotated[str, Field(min_length=1)]
    """`random`, `sobol`, `halton`, `optuna`, `qd`, `boundary`, another of the entry points `vastflow.strategies`, or `file.py:Class`."""
    search_space: Annotated[dict[str, SearchDimension], Field(min_length=1)]
    """Name to domain. One that no `$name` stands for is a parameter of the scenario."""
    extract: Extract | None = None
    """Function from a point's runs to numbers; default: their failure rate."""
    objectives: list[Objective] = Field(default_factory=list)
    """The number that the search drives; at most one, and the greatest failure rate where there is none."""
    per_batch: Count = 1
    """Points proposed at a time."""
    max_proposals: Count = 1000
    """Points after which the search ends in any case, those that can't be built included. Not part of version 1 elsewhere."""
    confirm: Amount = 60
    """Runs of the best point, after the search and with run indices that it never used, of which its rate is reported. Not part of
    version 1 elsewhere."""
    baseline: Literal["random"] | None = None
    """A search beside this one, with as many points in each batch, to be compared with it. Not part of version 1 elsewhere."""
    budget: Budgets = Field(default_factory=list)
    """Limits of the search; this or `stopping` is required, and the first limit that is reached ends it."""
    stopping: Stoppings = Field(default_factory=list)
    """When the search ends before its budget is spent."""
    seed: Seed | None = None
    """Seed of the strategy."""
    variations: SingleKeys = Field(default_factory=list)
    """Producers as in a family; `$name` stands for a searched parameter."""
    parameters: SingleKeys = Field(default_factory=list)
    """Fixed parameters as in a family; `$name` stands for a searched parameter."""
    postprocessing: NamedSteps = Field(default_factory=list)
    """Steps over the results of a batch, before objectives are taken from them."""
    strategy_parameters: dict[str, Any] = Field(default_factory=dict)
    """Parameters of the strategy."""

    @model_validator(mode="after")
    def _ends(self) -> Self:
        if not self.budget and not self.stopping:
            raise Invalid("nothing ends the search", "add a budget, stopping, or both")
        if len(self.objectives) > 1:
            raise _wrong(Invalid(Got(f"{len(self.objectives)} objectives"), "one"), at="objectives")
        return self

    @property
    def objective(self) -> Objective:
        """The number that the search drives."""
        return self.objectives[0] if self.objectives else Objective(name=FAILURE_RATE)

    @property
    def direction(self) -> Literal["maximize", "minimize"]:
        """Whether its greatest or its least value is looked for."""
        return self.objective.direction


def _wrong(error: Invalid, at: str) -> PydanticCustomError:
    return PydanticCustomError("search", "{error}", {"error": error, "at": at})


SEARCH: Final[Location] = ("search",)

_MARKER: Final = re.compile(r"\$(?:\{(?P<braced>.*)\}|(?P<bare>[A-Za-z_][\w.-]*))", re.DOTALL)


def marker_of(value: object) -> str | None:
    """The dimension that a value stands for, where it is all of a text, `$name` or `${name}`."""
    found = _MARKER.fullmatch(value) if isinstance(value, str) else None
    return None if found is None else found["bare"] or found["braced"] or ""


def marker_faults(document: Document, spec: SearchSpec) -> Iterator[Fault]:
    """Markers of the template that name no dimension."""
    for part in ("parameters", "variations"):
        for where, name in _markers(document.data["search"].get(part), (*SEARCH, part)):
            if name not in spec.search_space:
                what = f"{shown(document.value(where))} names a dimension that search_space does not have"
                yield document.fault(where, what, did_you_mean(name, spec.search_space))


def with_point(
    document: Document, spec: SearchSpec, point: Mapping[str, Any], left_out: Container[int] = ()
) -> Document:
    """The file with the template as a family would have it, each dimension at its value of a point.

    Places stay. A dimension that no marker names is a parameter of the scenario. Producers at `left_out` can't be had here.
    """
    search = document.data["search"]
    template = {part: search.get(part) or [] for part in ("parameters", "variations")}
    named = {name for _, name in _markers(template, SEARCH)}
    filled = {part: [_filled(entry, point) for entry in entries] for part, entries in template.items()}
    filled["variations"] = [{} if k in left_out else entry for k, entry in enumerate(filled["variations"])]
    values = {(*SEARCH, "parameters"): document.place(SEARCH), **document.values}
    for name in (name for name in point if name not in named):
        where = (*SEARCH, "parameters", len(filled["parameters"]))
        values[where] = values[(*where, name)] = document.place((*SEARCH, "search_space", name))
        filled["parameters"].append({name: point[name]})
    return replace(document, data={**document.data, "search": filled}, values=values)


def _markers(value: Any, where: Location) -> Iterator[tuple[Location, str]]:
    name = marker_of(value)
    if name is not None:
        yield where, name
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from _markers(item, (*where, key))


def _filled(value: Any, point: Mapping[str, Any]) -> Any:
    if isinstance(value, dict):
        return {key: _filled(item, point) for key, item in value.items()}
    if isinstance(value, list):
        return [_filled(item, point) for item in value]
    if isinstance(value, str) and value.startswith("$$"):
        return value[1:]
    name = marker_of(value)
    return value if name is None else point.get(name, value)
