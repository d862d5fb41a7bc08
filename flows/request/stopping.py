"""Sequential stopping: the next number of runs of a configuration, from the judgements of its first runs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

from vastflow.oracles.statistics.classes import ClassBounds, StoppingRule
from vastflow.producers.campaign_file.sections import Sequential
from vastflow.tasks.engine.engine import judgements
from vastflow.tasks.engine.index import ConfigurationRuns, Index
from vastflow.tasks.store.artifact import Stored
from vastflow.tasks.store.store import Artifact

MOST_ROUNDS: Final = 16
"""Maximum number of looks. Between two of them there are as many runs as this allows, and one if possible: up to 21 runs
from a minimum of 5. A round costs about a hundred task runs and a moment in which workers wait for the last run, a run
more of every configuration costs more."""


@dataclass(frozen=True)
class Stopping:
    """Looks at a configuration's first runs, and says whether it wants more.

    Looks are on a fixed grid, and each uses the runs before it alone. So the number of runs follows from the judgements, whatever
    else the store holds, whoever computed it and in which order.
    """

    rule: StoppingRule

    @property
    def most(self) -> int:
        """Runs that no configuration exceeds."""
        return self.rule.max_runs

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

    @cached_property
    def looks(self) -> tuple[int, ...]:
        """Numbers of runs after which it is looked, in order: from the rule's least to its most."""
        least, most = self.rule.min_runs, self.rule.max_runs
        step = max(1, -(-(most - least) // MOST_ROUNDS))
        return (*range(least, most, step), most)

    def wanted(self, judgements: Mapping[int, str]) -> int:
        """Return the number of runs a configuration wants, given the known judgements.

        Where all of these are among `judgements` it wants no more. A look at which nothing could be decided, however the runs before
        it end, is passed over: that saves a round and changes no outcome.

        Args:
            judgements: Run index to `pass`, `fail` or `not judged`, which is no evidence; any other runs, later ones too.
        """
        runs = passed = judged = 0
        while True:
            look = self._next(runs, passed, judged)
            for run in range(runs, look):
                said = judgements.get(run)
                if said is None:
                    return look
                passed += said == "pass"
                judged += said != "not judged"
            runs = look
            if runs >= self.most or self._decided[judged][passed]:
                return runs

    def stored(self, index: Index, configuration: ConfigurationRuns) -> tuple[ConfigurationRuns, list[Stored]]:
        """Return a configuration with its wanted runs by stored judgements, and its stored blocks."""
        there = index.stored(replace(configuration, runs=self.most))
        known = {
            run: said for each in there if each.verdicts for run, said in self.judged(index, each.verdicts).items()
        }
        wanted = replace(configuration, runs=self.wanted(known))
        return wanted, [each for each in there if each.block.start < wanted.runs]

    def judged(self, index: Index, verdicts: Artifact) -> Mapping[int, str]:
        """Run index to the judgement that counts: what all oracles together say."""
        return judgements(verdicts)

    def _next(self, runs: int, passed: int, judged: int) -> int:
        """The next look, after `runs`, at which something may be decided."""
        key = runs, passed, judged
        if key not in self._found:

            def may_decide(more: int) -> bool:
                return any(any(self._decided[judged + k][passed : passed + k + 1]) for k in range(more + 1))

            later = (look for look in self.looks if look > runs)
            self._found[key] = next(look for look in later if look >= self.most or may_decide(look - runs))
        return self._found[key]

    @cached_property
    def _found(self) -> dict[tuple[int, int, int], int]:
        """Next looks that were found; thousands of configurations come by the same few."""
        return {}

    @cached_property
    def _decided(self) -> list[list[bool]]:
        """Whether a class is decided, by judged runs and passes."""
        return [
            [
                found not in (None, "undecided")
                for found in self.rule.decisions(range(judged + 1), [judged] * (judged + 1))
            ]
            for judged in range(self.most + 1)
        ]


def stopping_of(sequential: Sequential) -> Stopping:
    """The stopping that a campaign file asks for."""
    stop = sequential.stop
    bounds = ClassBounds(stop.systematic, stop.reliable)
    return Stopping(StoppingRule(sequential.min, sequential.max, bounds, stop.error))
