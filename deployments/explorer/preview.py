"""Previews: runs of a campaign that is not finished, as a campaign directory of their configuration alone."""

import subprocess
import sys
import threading
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

from pydantic import ValidationError

from vastflow.deployments.explorer.directories import CampaignDirectory, Directories
from vastflow.flows.request.run_request import RunRequest
from vastflow.oracles.results.events import EventReader
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.sim.model.digest import digest
from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from vastflow.flows.results.tables import StoredResult
    from vastflow.producers.model.configuration import Configuration

PATIENCE_S: Final = 120
_SHARED: Final = ("store", "map_dir", "as_v1")
"""Options that decide which runs a configuration has, and where they are."""


class Previews:
    """Directories of single configurations, written from the store when they are asked for, and removed with this object."""

    def __init__(self, directories: Directories) -> None:
        self._directories = directories
        self._folder: TemporaryDirectory[str] | None = None
        self._lock = threading.Lock()

    def of(self, campaign: CampaignDirectory, configuration: str, run_index: int) -> CampaignDirectory:
        """Return a finished directory with the runs of a configuration up to `run_index`; some seconds the first time.

        Raises:
            UnusableDirectory: the events don't tell how the campaign was begun, or a run is not judged yet.
        """
        with self._lock:
            if self._folder is None:
                self._folder = TemporaryDirectory(prefix="vastflow-")
                self._directories.hide(Path(self._folder.name))
            place = Path(self._folder.name).resolve() / digest(campaign.id, configuration, run_index)[:16]
            if not any(place.glob("[!.]*")):
                _fetch(campaign, configuration, run_index, place)
            return next(each for each in self._directories.hidden() if each.path.parent == place)


def _fetch(campaign: CampaignDirectory, configuration: str, run_index: int, place: Path) -> None:
    """Write a preview in a process of its own, as a campaign's plug-ins don't belong into the server."""
    events = EventReader(campaign.path).new()
    try:
        values = events[0].values
        asked = RunRequest.model_validate(values["request"]).model_dump(include={*_SHARED})
        own = {"campaign": values["file"], "only": (configuration,), "runs": run_index + 1, "results": str(place)}
        request, folder = RunRequest.model_validate({**asked, **own}), str(values["folder"])
    except (LookupError, ValidationError):
        raise UnusableDirectory(f"{campaign.name}: its events don't tell how it was begun.") from None
    command = [sys.executable, "-m", __name__, request.model_dump_json()]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        wrong = (done.stderr.strip().splitlines() or ["no reason given"])[-1] if done.returncode else ""
    except (OSError, subprocess.TimeoutExpired) as error:
        wrong = str(error)
    if wrong:
        raise UnusableDirectory(f"{configuration}, run {run_index}, can't be had from the store: {wrong}")


def write(request: RunRequest) -> None:
    """Write the campaign directory of stored runs, without a report; nothing is computed.

    Raises:
        UserError: the store lacks runs, or the campaign file is another by now.
    """
    from vastflow.flows.results.directory import new_directory
    from vastflow.flows.results.results import write_results
    from vastflow.flows.results.tables import StoredResult
    from vastflow.flows.run.judged import look
    from vastflow.flows.run.prepared import open_run

    with open_run(request) as (run, computing):
        run.store.refresh()
        judged = look(run, computing)
        if judged is None or judged.incomplete(computing.engine):
            raise UserError("not all runs up to it are judged yet, or the campaign file has changed")

        def found(configuration: "Configuration") -> "StoredResult":
            own = judged.found[configuration.name]
            return StoredResult(run.store, own.stored, own.configuration.runs, [])

        with new_directory(run.delivery.folder, run.name, computing.created) as directory, directory.writing():
            write_results(
                directory,
                run.campaign,
                run.inputs,
                judged.instantiated.instantiation,
                found,
                runs=judged.runs,
                oracles=[oracle.name for oracle in run.opened.oracles],
                keys=run.keys,
                record=run.record,
                faults=judged.faults,
                created=computing.created,
                work=run.work,
                report=lambda place: None,
            )


if __name__ == "__main__":
    try:
        write(RunRequest.model_validate_json(sys.argv[1]))
    except UserError as error:
        sys.exit(str(error))
