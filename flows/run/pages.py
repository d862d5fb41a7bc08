"""A campaign on Prefect's pages: progress, results, a link to the report, a readable name.

Nothing of it is needed for the campaign: where Prefect's API refuses, a line in the log says so and the campaign goes on.
"""

import json
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final
from uuid import UUID

from prefect import get_run_logger
from prefect.client.orchestration import get_client
from prefect.client.schemas.actions import ArtifactCreate, ArtifactUpdate
from prefect.runtime import flow_run

from vastflow.flows.results.summary import Results
from vastflow.flows.terminal.progress import Meter, pace_words
from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.results.tables import read_tables
from vastflow.oracles.statistics.intervals import LEVEL
from vastflow.sim.model.files import read_json
from vastflow.sim.model.names import label_of
from vastflow.tasks.engine.progress import Phase, Progress
from vastflow.tasks.prefect.server import is_embedded

LOGGER: Final = logging.getLogger("vastflow.artifacts")

INTERVAL_S: Final = 2.0
"""Time between two updates of the progress."""
TABLE_INTERVAL_S: Final = 10.0
"""Time between two updates of the workers."""

QUIET_S: Final = 30.0
"""Pause after a refused request, which may have taken seconds."""

_SAID: Final[dict[Phase, str]] = {
    "instantiating": "instantiating",
    "running": "executing, observing and judging what the store does not have",
    "reporting": "writing the report",
    "postprocessing": "running the steps of postprocessing",
}


class LiveArtifact:
    """An artifact of a flow run that is shown again and again.

    Args:
        key: Lowercase letters, digits and hyphens; versions of one key are listed together.
        kind: Prefect's type of artifact, such as `progress`.
        interval_s: Least time between two updates; each is a request that costs some 20 ms.
    """

    def __init__(self, key: str, flow_run_id: str, kind: str, interval_s: float) -> None:
        self._key = key
        self._flow_run_id = UUID(flow_run_id)
        self._kind = kind
        self._interval_s = interval_s
        self._id: UUID | None = None
        self._shown: tuple[Any, str] | None = None
        self._at_s = 0.0

    @property
    def is_due(self) -> bool:
        """True if the last update is `interval_s` ago."""
        return time.monotonic() >= self._at_s + self._interval_s

    def show(self, data: Any, text: str, now: bool = False) -> None:
        """Show data and a description, if they changed and an update is due or `now` is set."""
        if (data, text) == self._shown or not (now or self.is_due):
            return
        self._shown, self._at_s = (data, text), time.monotonic()
        with get_client(sync_client=True) as client:
            if self._id is None:
                artifact = ArtifactCreate(
                    key=self._key, type=self._kind, data=data, description=text, flow_run_id=self._flow_run_id
                )
                self._id = client.create_artifact(artifact).id
            else:
                client.update_artifact(self._id, ArtifactUpdate(data=data, description=text))


class ProgressBar(LiveArtifact):
    """A progress artifact of a flow run."""

    def __init__(self, key: str, flow_run_id: str) -> None:
        super().__init__(key, flow_run_id, "progress", INTERVAL_S)

    def show(self, share: float, text: str, now: bool = False) -> None:
        """Show a share between 0 and 1; the last one is shown at once."""
        super().show(100 * share, text, now or share >= 1)


class Page:
    """The page of a flow run that runs a campaign, as an observer of the campaign.

    Args:
        say: Writes a line of the flow run's log.
        asked: Runs of each configuration, and whether these are its most; None keeps the flow run's name.
        workers: Gives rows about a cluster's workers.
    """

    def __init__(
        self,
        name: str,
        flow_run_id: str,
        say: Callable[[str], None],
        asked: tuple[int, bool] | None = None,
        workers: Callable[[], list[dict[str, Any]]] = list,
    ) -> None:
        self._name = name
        self._asked = asked
        self._flow_run_id = flow_run_id
        self._say = say
        self._bar = ProgressBar(f"{key_of(name)}-progress", flow_run_id)
        self._workers = workers
        self._table = LiveArtifact(f"{key_of(name)}-workers", flow_run_id, "table", TABLE_INTERVAL_S)
        self._meter = Meter(time.monotonic())
        self._phase: Phase | None = None
        self._noticed = 0
        self._sized = False
        self._named = 0
        self._quiet_until_s = 0.0

    def update(self, progress: Progress) -> None:
        """Show `progress`."""
        for notice in progress.notices[self._noticed :]:
            self._say(notice)
        self._noticed = len(progress.notices)
        count = progress.configurations_total
        if progress.runs_total and not self._sized:
            self._sized = True
            self._say(
                f"{size_text(count, progress.runs_total, progress.at_most)}; {progress.reused} runs are in the store"
            )
        if self._asked and progress.runs_total and count != self._named:  # a search comes to more and more
            runs, at_most = self._asked
            name = f"{self._name}, {size_text(count, count * runs, at_most)}"
            if self._sent(lambda: update(self._flow_run_id, name=name)):
                self._named = count
        new_phase = progress.phase != self._phase
        if new_phase and progress.phase in _SAID:
            self._say(_SAID[progress.phase])
        self._phase = progress.phase
        if progress.runs_total:
            share, now_s = progress.runs_done / progress.runs_total, time.monotonic()
            self._meter.note(progress, now_s)
            text = ", ".join([progress_text(progress), *pace_words(progress, self._meter.pace(progress, now_s))])
            self._sent(lambda: self._bar.show(share, text, now=new_phase))
        if self._table.is_due and (rows := self._workers()):
            counted = Counter(row["state"] for row in rows)
            said = ", ".join(f"{number} {state}" for state, number in counted.most_common())
            self._sent(lambda: self._table.show(json.dumps(rows), f"Workers of the cluster: {said}"))

    def _sent(self, request: Callable[[], None]) -> bool:
        """True if the API accepted the request; after a refusal, requests pause for a while."""
        if time.monotonic() < self._quiet_until_s:
            return False
        with tolerated() as refused:
            request()
        if refused:
            self._quiet_until_s = time.monotonic() + QUIET_S
        return not refused


def outcome_text(found: Results) -> str:
    """Format the outcome of a campaign in one line."""
    summary = found.summary
    counts = f"{summary.passed} passed, {summary.failed} failed, {summary.not_judged} not judged"
    work = f"{summary.executed} runs executed, {summary.reused} from the store"
    headline = f"{said}. " if (said := summary.headline.get("text")) else ""
    return f"{headline}{size_text(summary.configurations, summary.runs)}: {counts}; {work}"


def publish(found: Results, name: str, reports: str | None = None) -> None:
    """Publish a table of results and a link to the report on the current flow run's page.

    Args:
        reports: Web address of the results folder; None links to the file, which a browser opens on its own machine only.
    """
    if is_embedded():
        return
    outcome = outcome_text(found)
    report = found.directory.resolve() / "report.html"
    get_run_logger().info("%s; report: %s", outcome, report)
    link = report.as_uri() if reports is None else f"{reports.rstrip('/')}/{found.directory.name}/report.html"
    with tolerated():
        _create(f"{key_of(name)}-results", "table", json.dumps(result_rows(found)), f"**{name}**, {outcome}")
        if why := read_json(found.directory / "metadata.json").get("why"):
            _create(f"{key_of(name)}-why", "table", json.dumps(why), f"What **{name}** computed, and why")
        _create(f"{key_of(name)}-report", "markdown", f"[report.html]({link})", f"Report of **{name}**: `{report}`")


def show_text(key: str, text: str, about: str) -> None:
    """Show Markdown text on the current flow run's page, if any."""
    if not is_embedded():
        with tolerated():
            _create(key, "markdown", text, about)


def result_rows(found: Results) -> list[dict[str, Any]]:
    """Rows of the report's first table: each family, and all together if there are several."""
    tables = read_tables(found.directory)
    whole, rows = evidence_of(tables)[None], []
    for name, group in [*whole.families.items(), *([("all", whole.campaign)] if len(whole.families) != 1 else [])]:
        counts, rate = group.counts, group.rate
        low, high = group.interval.thousandths if group.interval else (0, 0)
        row = {
            "family": name,
            "configurations": group.configurations,
            "runs": counts.judged + counts.not_judged,
            "passed": counts.passed,
            "failed": counts.failed,
            "not judged": counts.not_judged,
            "rate": "–" if rate is None else f"{100 * rate:.1f} %",
            f"{100 * LEVEL:.0f} % interval": "–" if rate is None else f"{low / 10:.1f} – {high / 10:.1f} %",
        }
        rows.append(row)
    return rows


def progress_text(progress: Progress) -> str:
    """Runs done and their verdicts."""
    verdicts = f"{progress.passed} passed, {progress.failed} failed, {progress.not_judged} not judged"
    total = f"{'at most ' * progress.at_most}{progress.runs_total}"
    return f"{progress.runs_done} of {total} runs done: {verdicts}"


def size_text(configurations: int, runs: int, at_most: bool = False) -> str:
    """Format a size, such as `24 configurations × 5 runs` or `24 configurations, 341 runs`."""
    said = f"{configurations} configuration{'s'[: configurations != 1]}"
    each, rest = divmod(runs, configurations) if configurations else (0, 0)
    most = "at most " * at_most
    return f"{said}, {most}{runs} runs" if rest or at_most else f"{said} × {each} run{'s'[: each != 1]}"


def key_of(name: str) -> str:
    """A campaign's name as the keys of its artifacts have it."""
    return label_of(name) or "campaign"


def update(flow_run_id: str, **fields: Any) -> None:
    """Set fields of a flow run, such as `name` and `tags`."""
    with get_client(sync_client=True) as client:
        client.update_flow_run(UUID(flow_run_id), **fields)


@contextmanager
def tolerated() -> Iterator[list[Exception]]:
    """Log a refusal of Prefect's API, and yield a list that receives it."""
    refused: list[Exception] = []
    try:
        yield refused
    except Exception as error:  # noqa: BLE001 - a campaign of hours is not lost for a picture of it
        refused.append(error)
        LOGGER.warning("Prefect does not show the campaign's progress or results: %s", error)


def _create(key: str, kind: str, data: str, description: str) -> None:
    of = UUID(str(flow_run.id))
    with get_client(sync_client=True) as client:
        client.create_artifact(ArtifactCreate(key=key, type=kind, data=data, description=description, flow_run_id=of))
