"""Reading a search, with its faults and the reasons why a valid one can't run here."""

import importlib.util
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from vastflow.producers.campaign_file.document import Document, faults_of
from vastflow.producers.campaign_file.postprocessing import plug_in_complaint
from vastflow.producers.campaign_file.search import FAILURE_RATE, METRICS, SEARCH, Quantity, SearchSpec, marker_faults
from vastflow.producers.campaign_file.sections import Sequential
from vastflow.producers.campaign_file.spec import ExecutionSpec
from vastflow.producers.instantiation.instantiate import Family
from vastflow.producers.model.faults import NOT_EXECUTED, Location
from vastflow.producers.model.producer import find_producer
from vastflow.producers.search.boundary import Boundary, boundary_complaint
from vastflow.producers.search.search import ReadsFamilies, Search, corners, family_at, several_fault
from vastflow.producers.search.space import Space
from vastflow.producers.search.strategy import Strategy, find_strategy, missing_library
from vastflow.sim.model.faults import Fault, Got, Problem
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.plug_ins.neighbors import PlugInError

_EXTRACT: Location = (*SEARCH, "extract")
_PARAMETERS: Location = (*SEARCH, "strategy_parameters")
_PLUG_IN = "expected file.py:Class, relative to this file"


@dataclass(frozen=True)
class SearchReading:
    """A search as read from a file.

    Attributes:
        search: None where it has a fault or can't be run.
        families: The template at corners of the space: they name all files that points may need.
        unexecutable: Why this version can't run it.
    """

    search: Search | None
    families: tuple[Family, ...]
    faults: tuple[Fault, ...]
    unexecutable: tuple[Fault, ...]


def read_search(
    document: Document, spec: SearchSpec, execution: ExecutionSpec, base: Path, reader: ReadsFamilies
) -> SearchReading:
    """Read the search from a well-formed section; file names are relative to `base`."""
    reading = _Reading(document, spec, base)
    reading.faults += marker_faults(document, spec)
    left_out = [k for k, entry in enumerate(spec.variations) for name in entry if reading.is_left_out(k, name)]
    quantities = reading.quantities()
    found = reading.strategy()
    reading.check_steps()
    space = Space(spec.search_space)
    families = []
    known = {fault.place for fault in reading.faults}  # such as a marker's, of which a producer complains too
    for k, point in enumerate(corners(space), 1):
        family, faults = family_at(document, spec, reader, point, f"corner-{k}", left_out)
        reading.faults += [fault for fault in faults if fault.place not in known]
        families.append(family)
    for family in families[:1]:
        for k, producer in enumerate(family.producers if not left_out else ()):
            if (producer.most_choices or 1) > 1:
                reading.faults.append(several_fault(document, k, type(producer).__name__))
    reading.check_numbers(quantities, found)
    reading.check_budget(execution)
    search = None
    if found is not None and not reading.faults and not reading.unexecutable:
        search = Search(spec, space, *found, quantities, document, reader)
    return SearchReading(search, tuple(families), tuple(reading.faults), tuple(reading.unexecutable))


def unknown_strategy(document: Document, name: str, base: Path) -> list[Fault]:
    """Return the fault of a name that no strategy has, in a section that can't be read as a whole."""
    try:
        if ".py:" not in name:
            find_strategy(name, base)
    except PlugInError as error:
        return [document.fault((*SEARCH, "strategy"), error.problem, error.expected)]
    return []


class _Reading:
    """The parts of a section, each with what is wrong of it."""

    def __init__(self, document: Document, spec: SearchSpec, base: Path) -> None:
        self.faults: list[Fault] = []
        self.unexecutable: list[Fault] = []
        self._document = document
        self._spec = spec
        self._base = base

    def _fault(self, where: Location, what: Problem, right: str, at: Literal["key", "value"] = "value") -> None:
        self.faults.append(self._document.fault(where, what, right, at))

    def _not_here(self, where: Location, what: Problem, right: str, at: Literal["key", "value"] = "value") -> None:
        self.unexecutable.append(self._document.fault(where, what, right, at))

    def _has_class(self, where: Location, name: str, at: Literal["key", "value"] = "value") -> bool:
        complaint = plug_in_complaint(name, self._base)
        if complaint is not None:
            self._fault(where, complaint, _PLUG_IN, at)
        return complaint is None

    def is_left_out(self, k: int, name: str) -> bool:
        """True if a template's producer names a file without a producer of vastflow's; records the fault."""
        where: Location = (*SEARCH, "variations", k, name)
        if ".py:" not in name:
            return False
        if self._has_class(where, name, "key"):
            try:
                find_producer(name, self._base)
                return False
            except PlugInError as error:
                self._not_here(where, str(error), "expected a subclass of vastflow's Producer", "key")
        return True

    def quantities(self) -> dict[str, Quantity]:
        """The numbers that `extract` gives, by name; a failure rate in any case."""
        extract, found = self._spec.extract, {FAILURE_RATE: Quantity()}
        if extract is None:
            return found
        if ".py:" in extract.plugin:
            where: Location = (*_EXTRACT, "plugin")
            if self._has_class(where, extract.plugin):
                what = f"{extract.plugin!r} is {NOT_EXECUTED}"
                self._not_here(where, what, f"use {FAILURE_RATE}, or {METRICS} of an oracle file.py:Class")
            return found
        if extract.plugin not in (FAILURE_RATE, METRICS):
            right = did_you_mean(extract.plugin, (FAILURE_RATE, METRICS))
            self._fault((*_EXTRACT, "plugin"), f"unknown plug-in {extract.plugin!r}", right)
            return found
        try:
            if extract.plugin == FAILURE_RATE:
                return {FAILURE_RATE: Quantity.model_validate(extract.params)}
            return {**found, **TypeAdapter(dict[str, Quantity]).validate_python(extract.params)}
        except ValidationError as error:
            self.faults += faults_of(self._document, (*_EXTRACT, "params"), Quantity, error)
            return {**found, **dict.fromkeys(extract.params, Quantity())}

    def strategy(self) -> tuple[type[Strategy[Any]], Any] | None:
        """The strategy's class and its parameters."""
        name, where = self._spec.strategy, (*SEARCH, "strategy")
        if ".py:" in name and not self._has_class(where, name):
            return None
        try:
            kind = find_strategy(name, self._base)
        except PlugInError as error:
            say = self._not_here if ".py:" in name else self._fault
            say(where, error.problem, error.expected)
            return None
        if kind is Boundary and (complaint := boundary_complaint(self._spec.search_space)):
            self._fault((*SEARCH, "search_space"), complaint, "", "key")
        if kind.library and importlib.util.find_spec(kind.library) is None:
            self._fault(where, str(missing_library(kind.library)), "")
        try:
            return kind, kind.Parameters.model_validate(self._spec.strategy_parameters)
        except ValidationError as error:
            self.faults += faults_of(self._document, _PARAMETERS, kind.Parameters, error)
            return None

    def check_steps(self) -> None:
        """Steps over a batch's results, which nothing here reads."""
        for k, step in enumerate(self._spec.postprocessing):
            for name in step:
                what = f"{name!r} is {NOT_EXECUTED}"
                self._not_here((*SEARCH, "postprocessing", k), what, "extract, which reads verdicts")

    def check_numbers(self, quantities: Mapping[str, Quantity], found: tuple[type[Strategy[Any]], Any] | None) -> None:
        """The objective, measures and metrics are numbers that there are."""
        if any(fault.place.where.endswith("extract.plugin") for fault in self.unexecutable):
            return  # what it gives only RoboVAST knows
        for k, objective in enumerate(self._spec.objectives):
            self._check_name((*SEARCH, "objectives", k, "name"), "objective", objective.name, quantities)
        if found is None:
            return
        kind, parameters = found
        numbers = [name for name, each in self._spec.search_space.items() if each.type in ("float", "int")]
        for name in kind.measures(parameters):
            below = (at for at in self._document.keys if at[: len(_PARAMETERS)] == _PARAMETERS and at[-1] == name)
            where = next(below, _PARAMETERS)
            self._check_name(where, "measure", name, [*quantities, *numbers], "key")
        for k, stopping in enumerate(self._spec.stopping):
            if stopping.metric is not None:
                where = (*SEARCH, "stopping", k, "metric", "name")
                self._check_name(where, f"metric of {self._spec.strategy}", stopping.metric.name, kind.reports)

    def _check_name(
        self, where: Location, what: str, name: str, known: Iterable[str], at: Literal["key", "value"] = "value"
    ) -> None:
        if name not in known:
            self._fault(where, f"unknown {what} {name!r}", did_you_mean(name, known, "it reports none"), at)

    def check_budget(self, execution: ExecutionSpec) -> None:
        """A budget of runs pays at least one batch."""
        runs = execution.runs.min if isinstance(execution.runs, Sequential) else execution.runs
        batch = self._spec.per_batch * runs
        for k, budget in enumerate(self._spec.budget):
            if budget.runs is not None and budget.runs < batch:
                what = Got(f"{budget.runs}, less than a batch of {self._spec.per_batch} points with {runs} runs each")
                self._fault((*SEARCH, "budget", k, "runs"), what, f"{batch} or more")
        if self._spec.max_proposals < self._spec.per_batch:
            what = Got(f"{self._spec.max_proposals}, less than a batch of {self._spec.per_batch} points")
            self._fault((*SEARCH, "max_proposals"), what, f"{self._spec.per_batch} or more")
