"""`minimize_configuration`: the smallest configuration that still fails, with its picture."""

import io
import os
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from PIL import Image

from vastflow.flows.flow_runs.mapped import compute
from vastflow.flows.minimization.candidate_file import BuiltCandidate, candidate_files, placed
from vastflow.flows.minimization.failing import Failing, NotMinimized, failing_configuration
from vastflow.flows.minimization.minimized import Minimized, comment_of
from vastflow.flows.minimization.trials import Compute, FailureTest, Trials, failure_test
from vastflow.flows.plan.pictures import plan_view_of
from vastflow.flows.request.campaign_file import OpenCampaign
from vastflow.flows.request.campaign_keys import campaign_keys
from vastflow.flows.run.computing import Computing, computing, told
from vastflow.flows.search.progress import PointRuns
from vastflow.oracles.figures.plan_view import plan_view_figure
from vastflow.oracles.figures.style import png
from vastflow.producers.minimization.candidates import NotBuilt
from vastflow.producers.minimization.minimize import Candidate, Minimum, Unconfirmed, minimize
from vastflow.producers.model.configuration import Configuration
from vastflow.tasks.engine.progress import Observer
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.store import Lost, open_store

if TYPE_CHECKING:
    from vastflow.flows.flow_runs.task_runs import TaskRuns


def before_and_after(before: Configuration, after: Configuration) -> bytes:
    """Return a PNG of two plan views side by side."""
    pictures = []
    for title, configuration in (("before", before), ("minimized", after)):
        view = replace(plan_view_of(configuration), title=title)
        pictures.append(Image.open(io.BytesIO(png(plan_view_figure(view)))).convert("RGB"))
    width, height = sum(each.width for each in pictures), max(each.height for each in pictures)
    both = Image.new("RGB", (width, height), "white")
    x = 0
    for each in pictures:
        both.paste(each, (x, 0))
        x += each.width
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
) -> Minimized:
    """Reduce a failing configuration of a campaign directory to the smallest one that still fails.

    Args:
        oracle, rate: See `failing_configuration`.
        store, workers, observer: See `vastflow.flows.api.run_campaign`. Cached runs are not executed again.

    Raises:
        NotMinimized: the configuration does not fail.
        UnusableDirectory: the campaign directory can't be used.
        StoreError: the store can't be used.
        PrefectUnavailable: Prefect's API can't be started.
    """
    failing = failing_configuration(Path(results), configuration, oracle, rate)
    with candidate_files(failing) as files:
        whole = Candidate(frozenset(each for each in failing.subject.circumstances if each.can_be_left_out))
        try:
            before = files.built(whole)
        except NotBuilt as error:
            raise NotMinimized(f"{failing.directory}: {failing.name} can't be built from its inputs: {error}") from None
        opened = OpenCampaign(before.campaign, before.oracles, open_store(store))
        keys = campaign_keys(installed_tree(), before.campaign.seed, before.oracles)
        test = failure_test(placed(failing.oracle, failing.places), rate)
        runs = PointRuns(test, test.most, CONFIRMING_RUNS)
        with (
            told(observer) as tally,
            computing(opened, keys, before.oracles, tally, stage="minimize", workers=workers, stopping=runs) as run,
        ):
            found, trials = _answered(run, failing, before, test, runs)
            executed = run.tally.progress().executed
        if isinstance(found, Unconfirmed):
            raise NotMinimized(
                f"{failing.directory}: {failing.name} {found.text}; give another configuration or a lower --rate"
            )
        after = files.built(found.candidate, trials.used[found.candidate], comment_of(failing, found))
        picture = before_and_after(before.configuration, after.configuration)
        used = sum(trials.used.values())
        return Minimized(failing, test, found, after.text, after.inputs.files, picture, used, executed)


def _answered(
    run: Computing, failing: Failing, before: BuiltCandidate, test: FailureTest, runs: PointRuns
) -> tuple[Minimum | Unconfirmed, Trials]:
    """Minimize by the store alone, and start a flow only if runs are missing."""
    candidates = before.candidates(failing)
    answers: list[tuple[Minimum | Unconfirmed, Trials]] = []

    def ask(compute: Compute | None) -> None:
        runs.confirmed = ""
        trials = Trials(run, candidates, test, runs, compute)
        with suppress(Lost):  # what the store lost meanwhile is computed again by the next attempt
            answers.append((minimize(failing.subject.circumstances, trials.judge, trials.confirm), trials))

    def body(task_runs: "TaskRuns") -> None:
        ask(partial(compute, task_runs))

    for _ in run.engine.attempts():
        ask(None)
        if not answers:
            run.engine.warm_up([before.configuration.scenario.system])
            run.run_alone(body)
        if answers:
            break
    return answers[-1]
