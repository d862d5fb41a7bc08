"""The test by which a candidate fails: sequential, on the verdicts of one oracle, at a stated error."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from vastflow.flows.request.stopping import Stopping
from vastflow.oracles.statistics.classes import ClassBounds
from vastflow.oracles.statistics.stopping import StoppingRule
from vastflow.oracles.verdict import read_verdicts
from vastflow.producers.minimization.minimize import Standing
from vastflow.tasks.index import Index
from vastflow.tasks.store import Artifact
from vastflow.tasks.work import VERDICTS

ERROR: Final = 0.05
"""Probability, at most, that a candidate is said to fail in a trial and does not, or the other way round."""
LEAST_RUNS: Final = 5
MOST_RUNS: Final = 30
_APART: Final = 0.2
"""Share of the success rates above that of a failing candidate in which neither may be shown."""


@dataclass(frozen=True)
class FailureTest(Stopping):
    """Ends the runs of a candidate when it is shown to fail, or not to.

    To fail is to be of the rule's class *systematic*, whose bound is the success rate `1 - rate`.

    Attributes:
        oracle: Whose failures count.
    """

    oracle: str

    def judged(self, index: Index, verdicts: Artifact) -> Mapping[int, str]:
        """Run index to what the oracle says.

        Raises:
            Lost: the verdicts are damaged.
        """
        found = read_verdicts(index.store.load(verdicts, VERDICTS))
        return {each.run_index: each.judgement for each in found if each.oracle == self.oracle}

    def standing(self, failed: int, judged: int) -> Standing:
        """What so many runs show."""
        claim = self.rule.decision(judged - failed, judged) if judged else None
        return "fails" if claim == "systematic" else "does not fail" if claim in ("reliable", "flaky") else "undecided"


def failure_test(oracle: str, rate: float, error: float = ERROR) -> FailureTest:
    """The test for a failure rate of `rate` or more."""
    passes = 1.0 - rate
    return FailureTest(StoppingRule(LEAST_RUNS, MOST_RUNS, ClassBounds(passes, passes + _APART * rate), error), oracle)
