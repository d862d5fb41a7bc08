"""Sequential stopping: the next number of runs of a configuration, from the judgments of its first runs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from vastflow.oracles.statistics.classes import ClassBounds, StoppingRule
from vastflow.oracles.statistics.looks import Looks
from vastflow.producers.campaign_file.sections import Sequential
from vastflow.tasks.engine.engine import judgments
from vastflow.tasks.engine.index import ConfigurationRuns, Index
from vastflow.tasks.store.artifact import Stored
from vastflow.tasks.store.store import Artifact


@dataclass(frozen=True)
class Stopping(Looks):
    """Looks at stored runs, and says whether a configuration wants more."""

    @property
    def as_json(self) -> dict[str, Any]:
        """The rule as `metadata.json` has it; `vastflow.oracles.evidence.findings.stopping_rule` reads it."""
        rule = self.rule
        return {
            "min": rule.min_runs,
            "max": rule.max_runs,
            "error": rule.error,
            "systematic": rule.bounds.systematic,
            "reliable": rule.bounds.reliable,
        }

    def stored(self, index: Index, configuration: ConfigurationRuns) -> tuple[ConfigurationRuns, list[Stored]]:
        """Return a configuration with its wanted runs by stored judgments, and its stored blocks."""
        there = index.stored(replace(configuration, runs=self.most))
        known = {
            run: said for each in there if each.verdicts for run, said in self.judged(index, each.verdicts).items()
        }
        wanted = replace(configuration, runs=self.wanted(known))
        return wanted, [each for each in there if each.block.start < wanted.runs]

    def judged(self, index: Index, verdicts: Artifact) -> Mapping[int, str]:
        """Run index to the judgment that counts: what all oracles together say."""
        return judgments(verdicts)


def stopping_of(sequential: Sequential) -> Stopping:
    """The stopping that a campaign file asks for."""
    stop = sequential.stop
    bounds = ClassBounds(stop.systematic, stop.reliable)
    return Stopping(StoppingRule(sequential.min, sequential.max, bounds, stop.error))
