"""Previews: runs of a campaign that is not finished, as a campaign directory of their configuration alone."""

import subprocess
import sys
import threading
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from pydantic import ValidationError

from vastflow.deployments.explorer.directories import CampaignDirectory, Directories
from vastflow.flows.request.run_request import RunRequest
from vastflow.oracles.results.events import EventReader
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.sim.model.digest import digest

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
    command = [sys.executable, "-m", "vastflow.flows.run.stored", request.model_dump_json()]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        wrong = (done.stderr.strip().splitlines() or ["no reason given"])[-1] if done.returncode else ""
    except (OSError, subprocess.TimeoutExpired) as error:
        wrong = str(error)
    if wrong:
        raise UnusableDirectory(f"{configuration}, run {run_index}, can't be had from the store: {wrong}")
