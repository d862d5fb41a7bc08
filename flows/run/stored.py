"""Stored runs: a campaign directory of one configuration's runs that the store has by now, with tables alone.

Nothing is computed.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.request.configurations import narrowed
from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results.directory import new_directory
from vastflow.flows.results.summary import Results
from vastflow.flows.run.computing import Computing
from vastflow.flows.run.judged import Judged, read_store, run_batches
from vastflow.flows.run.prepared import PreparedCampaign, open_run
from vastflow.flows.run.reporting import write_judged
from vastflow.flows.run.search_progress import BatchClock, SearchProgress
from vastflow.oracles.evidence.wide import wide_table, write_wide
from vastflow.oracles.results.tables import read_tables
from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine.index import FoundRuns


def write_stored(request: RunRequest, configuration: str, runs: int) -> Results:
    """Write the campaign directory of the first `runs` runs of a configuration, or of a point of a search.

    Args:
        request: The campaign's request, with another folder for results.

    Raises:
        UserError: the store lacks some of them, or the campaign file is another by now.
    """
    map_dir = None if request.map_dir is None else Path(request.map_dir)
    if read_campaign(Path(request.campaign), map_dir)[0].search is None:
        request = request.model_copy(update={"only": (configuration,), "runs": runs})
    with open_run(request) as (run, computing):
        run.store.refresh()
        if run.search is None:
            judged = read_store(run, computing)
        else:
            judged = _of_point(run, run.search, computing, configuration, runs)
        if judged is None or judged.incomplete(computing.engine):
            raise UserError("not all of these runs are judged yet, or the campaign file has changed")

        with new_directory(run.delivery.folder, run.name, computing.created) as directory, directory.writing():
            return write_judged(run, computing, judged, directory, run.record, _report)


def _report(place: Path) -> None:
    write_wide(place, wide_table(read_tables(place)))


def _of_point(
    run: PreparedCampaign, search: SearchProgress, computing: Computing, name: str, runs: int
) -> Judged | None:
    """Repeat a search as far as the store has it, and return the runs of one of its points."""
    search.clock = BatchClock(run.store, "")  # this process's time ends no search
    batches: list[Judged] = []

    def noted(judged: Judged | None) -> Judged | None:
        batches.extend(filter(None, [judged]))
        return judged

    run_batches(run, computing, read_store(run, computing), noted)
    for batch in reversed(batches):
        if (found := batch.found.get(name)) is not None:
            wanted = FoundRuns(replace(found.configuration, runs=runs), found.stored)
            return Judged(narrowed(batch.instantiated, run.opened.file, (name,)), {name: wanted})
    return None


def answer(request: Mapping[str, Any]) -> None:
    """Write stored runs in a child process, which keeps a campaign's plug-ins out of the one that asks."""
    write_stored(RunRequest.model_validate(request["request"]), request["configuration"], request["runs"])
