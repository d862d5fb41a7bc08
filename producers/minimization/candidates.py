"""Candidates of a minimization as scenarios, checked as the values of a campaign file are."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from vastflow.producers.campaign_file.scenario import AbstractScenario
from vastflow.producers.campaign_file.scenario_values import (
    Complaint,
    combined_complaint,
    complaint_of,
    mask_complaints,
)
from vastflow.producers.minimization.circumstance import Subject
from vastflow.producers.minimization.minimize import Candidate
from vastflow.producers.model.configuration import Partial
from vastflow.producers.places.start_check import StartCheck
from vastflow.producers.places.stops import GOAL_KEY
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.scenario import Scenario, scenario_of
from vastflow.sim.nav2.parameter_files.parameter_file import FILE_KEY


class NotBuilt(UserError, ValueError):
    """A candidate is no scenario."""


@dataclass(frozen=True)
class Candidates:
    """Makes scenarios of candidates of the `whole`; without `start_check`, start and goals are not checked."""

    subject: Subject
    whole: Scenario
    abstract: AbstractScenario
    start_check: StartCheck | None

    def scenario(self, candidate: Candidate) -> Scenario:
        """Return the scenario of a candidate.

        Raises:
            NotBuilt: its values don't go together, or the robot can't begin or end where it says.
        """
        try:
            values = self.subject.reduced(candidate.kept, dict(candidate.levels))
        except ValueError as error:
            raise NotBuilt(str(error)) from None
        whole = {**self.whole.environment, **self.whole.task, **self.whole.system}
        values = {key: whole[key] if isinstance(value, FileContent) else value for key, value in values.items()}
        if complaint := next(self._complaints(values), None):
            raise NotBuilt("; ".join(complaint))
        tags = self.subject.dimensions
        if self.start_check and (rejected := self.start_check.rejected(Partial("minimal", values, tags))):
            raise NotBuilt(rejected.reason)
        abstract, timeout_s, programs = self.whole.abstract, self.whole.timeout_s, self.whole.programs
        return scenario_of(values, tags, abstract=abstract, timeout_s=timeout_s, programs=programs)

    def _complaints(self, values: Mapping[str, Value]) -> Iterator[Complaint]:
        tags = self.subject.dimensions
        system = {key: value for key, value in values.items() if tags[key] == "system"}
        for key, value in values.items():
            if key != FILE_KEY and (
                said := complaint_of(key, value, tags[key], system) or self.abstract.complaint(key, value)
            ):
                yield said
        if combined := combined_complaint(system):
            yield combined[1]
        yield from (said for _, said in mask_complaints(system, values))
        goal = {GOAL_KEY} if self.abstract.goal_keys(values) else set()
        for group in self.abstract.needed:
            if goal.union(values).isdisjoint(group):
                yield f"the scenario needs {' or '.join(group)}", "a value of it"
