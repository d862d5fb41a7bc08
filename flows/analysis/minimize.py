"""`minimize_configuration`: the smallest configuration that still fails, with its picture."""

import io
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final, TypeAlias

from PIL import Image

from vastflow.flows.analysis.candidate_file import BuiltCandidate, candidate_files, placed
from vastflow.flows.analysis.failing import Failing, NotMinimized, failing_configuration
from vastflow.flows.analysis.minimized import Minimized, comment_of
from vastflow.flows.plan.plan import plan_view_of
from vastflow.flows.request.campaign_file import OpenCampaign, campaign_keys
from vastflow.flows.request.stopping import Stopping
from vastflow.flows.results.trust import executing
from vastflow.flows.run.computing import Computing, open_computing, show_progress
from vastflow.flows.run.search_progress import PointRuns
from vastflow.flows.run.task_runs import compute
from vastflow.oracles.figures.case_figure import plan_view_figure
from vastflow.oracles.figures.style import png
from vastflow.oracles.judgment.verdict import read_verdicts
from vastflow.oracles.statistics.classes import ClassBounds, StoppingRule
from vastflow.producers.minimization.circumstance import Subject
from vastflow.producers.minimization.minimize import (
    Candidate,
    Candidates,
    Minimum,
    NotBuilt,
    Outcome,
    Standing,
    Unconfirmed,
    minimize,
)
from vastflow.producers.model.configuration import Configuration
from vastflow.tasks.engine.index import ConfigurationRuns, FoundRuns, Index
from vastflow.tasks.engine.progress import Observer
from vastflow.tasks.engine.shards import Shard, missing_shards
from vastflow.tasks.engine.work import VERDICTS
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.store import Artifact, Lost, open_store

ERROR: Final = 0.05
"""Maximum probability of a wrong decision on a candidate."""
LEAST_RUNS: Final = 5
MOST_RUNS: Final = 30
_APART: Final = 0.2
"""Width of the rates of passing, as a share of the failure rate, in which a candidate may stay undecided."""


@dataclass(frozen=True)
class FailureTest(Stopping):
    """Stops a candidate's runs once its verdict by the oracle is certain.

    A failing candidate has the rule's class *systematic*, whose bound is the rate of passing `1 - rate`.
    """

    oracle: str

    @property
    def rate(self) -> float:
        """Failure rate from which a candidate fails."""
        return 1.0 - self.rule.bounds.systematic

    def judged(self, index: Index, verdicts: Artifact) -> Mapping[int, str]:
        """Return the oracle's judgment by run index; raises `Lost` if the verdicts are damaged."""
        found = read_verdicts(index.store.load(verdicts, VERDICTS))
        return {each.run_index: each.judgment for each in found if each.oracle == self.oracle}

    def standing(self, failed: int, judged: int) -> Standing:
        """Return the decision after so many runs."""
        claim = self.rule.decision(judged - failed, judged) if judged else None
        return "fails" if claim == "systematic" else "does not fail" if claim in ("reliable", "flaky") else "undecided"


Compute: TypeAlias = Callable[[Sequence[Shard]], None]
"""Takes shards through execute, observe and judge."""


@dataclass
class Trials:
    """Judges the candidates of a minimization.

    Attributes:
        runs: Number of runs that a candidate needs; the confirmed one gets more, with indices that no trial used.
        compute: None to look into the store alone.
        until_s: Time of the monotonic clock after which candidates are no longer tried; the first one always is.
        configurations, used: Each built candidate in order, and how many runs its trial and confirmation took.
    """

    run: Computing
    candidates: Candidates
    test: FailureTest
    runs: PointRuns
    compute: Compute | None = None
    until_s: float | None = None
    configurations: dict[Candidate, ConfigurationRuns] = field(default_factory=dict)
    used: dict[Candidate, int] = field(default_factory=dict)
    _number: int = 0

    def judge(self, candidate: Candidate) -> Outcome:
        """Return whether a candidate fails.

        Raises:
            Lost: its runs are not in the store, and nothing computes them, or what was computed is gone.
        """
        self._number += 1
        is_late = self.until_s is not None and self._number > 1 and time.monotonic() > self.until_s
        outcome = Outcome("not tried", reason="the time was over") if is_late else self._judged(candidate)
        if self.compute is not None:
            self.run.tally.notice(f"{self._number}: {_text(self.candidates.subject, candidate)}: {outcome.text}")
        return outcome

    def confirm(self, candidate: Candidate) -> Outcome:
        """Return whether a failing candidate fails on fresh runs at the rate, without a test; raises as `judge`."""
        self.runs.confirmed = self.configurations[candidate].name
        failed, judged = self._counts(candidate, self.used[candidate])
        fails = judged > 0 and failed / judged >= self.test.rate - 1e-9
        outcome = Outcome("fails" if fails else "undecided", failed, judged)
        self.run.tally.notice(f"confirmation on fresh runs: {outcome.text}")
        return outcome

    def _judged(self, candidate: Candidate) -> Outcome:
        try:
            scenario = self.candidates.scenario(candidate)
        except NotBuilt as error:
            return Outcome("not tried", reason=f"it can't be built: {error}")
        name = f"candidate-{self._number:03}"
        runs = self.runs.wanted({})
        self.configurations[candidate] = ConfigurationRuns(name, "minimization", self._number, scenario, runs)
        self.run.tally.expect({each.name: each.runs for each in self.configurations.values()})
        failed, judged = self._counts(candidate)
        if fault := next((each for each in self.run.engine.faults if each.configuration == name), None):
            return Outcome("not tried", reason=f"its runs broke: {fault.error}")
        if not judged:
            return Outcome("not tried", reason="no run of it is judged")
        return Outcome(self.test.standing(failed, judged), failed, judged)

    def _counts(self, candidate: Candidate, first: int = 0) -> tuple[int, int]:
        found = self._found(self.configurations[candidate])
        self.used[candidate] = found.configuration.runs
        known: dict[int, str] = {}
        for each in found.stored:
            if each.verdicts:
                known |= self.test.judged(self.run.engine.index, each.verdicts)
        said = [known.get(run) for run in range(first, found.configuration.runs)]
        return said.count("fail"), said.count("fail") + said.count("pass")

    def _found(self, configuration: ConfigurationRuns) -> FoundRuns:
        engine, name, runs = self.run.engine, configuration.name, -1
        while True:
            found = engine.scan([configuration])[name]
            if found.complete or name in engine.broken:
                return found
            if self.compute is None or found.configuration.runs == runs:
                raise Lost(f"results of {name}")
            runs = found.configuration.runs
            self.run.tally.begin("running")
            self.compute(missing_shards([found.configuration], {name: found.missing_runs}))
            engine.check()


def _text(subject: Subject, candidate: Candidate) -> str:
    whole = [each for each in subject.circumstances if each.can_be_left_out]
    if len(candidate.kept) == len(whole) and not candidate.levels:
        return "all of it"
    kept = [each.text for each in whole if each in candidate.kept]
    named = ", ".join(kept) if 0 < len(kept) <= 2 else f"{len(kept)} of {len(whole)} circumstances"
    order = {each: k for k, each in enumerate(subject.circumstances)}
    nearer = sorted(candidate.levels, key=lambda pair: order[pair[0]])
    return ", ".join([f"with {named}", *(f"{each.text} at {level}/8" for each, level in nearer)])


def before_and_after(before: Configuration, after: Configuration) -> bytes:
    """Return a PNG of two plan views side by side."""
    first, second = (
        Image.open(io.BytesIO(png(plan_view_figure(replace(plan_view_of(configuration), title=title)))))
        for title, configuration in (("before", before), ("minimized", after))
    )
    both = Image.new("RGB", (first.width + second.width, max(first.height, second.height)), "white")
    both.paste(first, (0, 0))
    both.paste(second, (first.width, 0))
    out = io.BytesIO()
    both.save(out, format="png")
    return out.getvalue()


CONFIRMING_RUNS: Final = 20


def minimize_configuration(
    results: str | os.PathLike[str],
    configuration: str,
    *,
    oracle: str | None = None,
    rate: float = 0.5,
    store: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    observer: Observer | None = None,
    trust: bool = False,
    for_s: float | None = None,
) -> Minimized:
    """Reduce a failing configuration of a campaign directory to the smallest one that still fails.

    Args:
        oracle, rate: See `failing_configuration`.
        store, workers, observer: See `vastflow.flows.api.run_campaign`. Cached runs are not executed again.
        trust: Execute code in the directory that this user did not make, now and from now on.
        for_s: Time after which no further candidate is tried, and the smallest one so far is confirmed; None for no limit.

    Raises:
        NotMinimized: the configuration does not fail.
        NotPermitted: the directory has code that the user neither made nor permitted.
        UnusableDirectory: the campaign directory can't be used.
        StoreError: the store can't be used.
        PrefectUnavailable: Prefect's API can't be started.
    """
    until_s = None if for_s is None else time.monotonic() + for_s
    with ExitStack() as stack:
        stack.enter_context(executing(Path(results), "" if trust else None))
        failing = failing_configuration(Path(results), configuration, oracle, rate)
        files = stack.enter_context(candidate_files(failing))
        whole = Candidate(frozenset(each for each in failing.subject.circumstances if each.can_be_left_out))
        try:
            before = files.built(whole)
        except NotBuilt as error:
            raise NotMinimized(f"{failing.directory}: {failing.name} can't be built from its inputs: {error}") from None
        opened = OpenCampaign(before.campaign, before.oracles, open_store(store))
        keys = campaign_keys(installed_tree(), before.campaign.seed, before.oracles)
        rule = StoppingRule(LEAST_RUNS, MOST_RUNS, ClassBounds(1.0 - rate, 1.0 - rate + _APART * rate), ERROR)
        test = FailureTest(rule, placed(failing.oracle, failing.places))
        runs = PointRuns(test, test.most, CONFIRMING_RUNS)
        with (
            show_progress(observer) as tally,
            open_computing(
                opened, keys, before.oracles, tally, stage="minimize", workers=workers, stopping=runs
            ) as run,
        ):
            found, trials = _answered(run, failing, before, test, runs, until_s)
            executed = run.tally.progress().executed
        if isinstance(found, Unconfirmed):
            raise NotMinimized(
                f"{failing.directory}: {failing.name} {found.text}. Give another configuration or a lower --rate."
            )
        after = files.built(found.candidate, trials.used[found.candidate], comment_of(failing, found))
        picture = before_and_after(before.configuration, after.configuration)
        used = sum(trials.used.values())
        return Minimized(failing, test.rule, found, after.text, after.inputs.files, picture, used, executed)


def _answered(
    run: Computing,
    failing: Failing,
    before: BuiltCandidate,
    test: FailureTest,
    runs: PointRuns,
    until_s: float | None,
) -> tuple[Minimum | Unconfirmed, Trials]:
    """Minimize by the store alone, and start a flow only if runs are missing."""
    candidates = before.candidates(failing)
    answers: list[tuple[Minimum | Unconfirmed, Trials]] = []

    def ask(compute: Compute | None) -> None:
        runs.confirmed = ""
        trials = Trials(run, candidates, test, runs, compute, until_s)
        with suppress(Lost):  # what the store lost meanwhile is computed again by the next attempt
            answers.append((minimize(failing.subject.circumstances, trials.judge, trials.confirm), trials))

    for _ in run.engine.attempts():
        ask(None)
        if not answers:
            run.engine.warm_up([before.configuration.scenario.system])
            run.run_alone(lambda task_runs: ask(partial(compute, task_runs)))
        if answers:
            break
    return answers[-1]
