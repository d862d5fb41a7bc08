"""The film of the report's first failure, as H.264 within the page."""

import base64
import logging
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from vastflow.oracles.evidence.causes import CauseCount
from vastflow.oracles.figures.case_figure import case_of
from vastflow.oracles.figures.drawing import Before, Drawing, Files
from vastflow.oracles.figures.film import LAST_MS, PICTURE_MS, FilmedRun, FilmError, write_film
from vastflow.oracles.page.words import number
from vastflow.oracles.results.executed import KeptFiles
from vastflow.oracles.results.tables import Tables
from vastflow.sim.model.blocks import read_recordings

LOGGER: Final = logging.getLogger("vastflow.report")

MOST_BYTES: Final = 600_000
"""Most bytes of the film in the page, where it is as long by a third as its file."""
_CRF: Final = 26


@dataclass(frozen=True, slots=True)
class Film:
    """A film of the report.

    Attributes:
        name: File name below `figures/`, without suffix.
    """

    name: str
    alt: str
    caption: str
    size: tuple[int, int]
    drawing: Drawing = field(repr=False)

    @property
    def mp4(self) -> bytes:
        return self.drawing.files["mp4"]

    @property
    def source(self) -> str:
        """The film as a `data:` address."""
        return f"data:video/mp4;base64,{base64.b64encode(self.mp4).decode()}"


def cause_film(tables: Tables, count: CauseCount, files: KeptFiles, before: Before) -> Film | None:
    """The example run of a cause; None without map or recording, or where it is too large.

    It is drawn from the recording, so that nothing is executed, and a report has the same film on every host.
    """
    name = count.configuration
    configuration = tables.configurations.names.index(name)
    file = tables.directory / "recordings" / f"{name}.parquet"
    if not tables.configurations.environments[configuration] or not file.is_file():
        return None
    recordings = {each.run.run_index: each for each in read_recordings(file)}
    recording = recordings.get(count.run_index)
    if recording is None or len(recording.columns.get("t_ms", ())) < 2:
        return None
    case = case_of(tables, configuration, files)
    filmed = FilmedRun(case, recording, "fail", case.situation.circumscribed_radius_m)
    drawing = Drawing(_encoded, filmed)
    drawing.take(before)
    mp4 = drawing.files["mp4"]
    if not mp4 or 4 * len(mp4) > 3 * MOST_BYTES:
        return None
    caption = f"{name}, run {count.run_index}: {recording.run.simulated_s:.1f} s, {number(filmed.times_real_time)} × real time. "
    caption += "Dark: the robot. Orange: where it took itself to be. Ticks: recoveries and contacts."
    alt = f"Film of run {count.run_index} of {name}, which failed: {count.cause}"
    return Film(f"film-{name}-{count.run_index}", alt, caption, filmed.size, drawing)


def _encoded(filmed: FilmedRun) -> Files:
    pictures = list(filmed.pictures())
    with TemporaryDirectory(prefix="vastflow-") as folder:
        file = Path(folder, "film.mp4")
        try:
            write_film(file, pictures, PICTURE_MS, LAST_MS, _CRF)
        except FilmError as error:
            LOGGER.warning("the report has no film: %s", error)
            return {"mp4": b""}
        return {"mp4": file.read_bytes()}
