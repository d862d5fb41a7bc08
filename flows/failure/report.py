"""A reported failure: everything that somebody else needs to see it and to repeat it, in at most one megabyte."""

import io
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import yaml
from jinja2 import Template

from vastflow.flows.analysis.candidate_file import FILE as MINIMAL
from vastflow.flows.analysis.failing import NotMinimized
from vastflow.flows.analysis.minimize import minimize_configuration
from vastflow.flows.analysis.minimized import Minimized
from vastflow.flows.api import run_campaign
from vastflow.flows.export.mcap.bag import NAME as BAG
from vastflow.flows.export.mcap.mcap import bag_of
from vastflow.flows.failure.failed_run import FailedRun, check_repeats
from vastflow.flows.failure.small_map import Bounds, with_small_map
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.inputs import write_files
from vastflow.oracles.figures.case_figure import case_of
from vastflow.oracles.figures.film import LAST_MS, PICTURE_MS, FilmedRun, FilmError, write_film
from vastflow.oracles.results.executed import KeptFiles
from vastflow.oracles.results.tables import read_tables
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.faults import UserError
from vastflow.sim.reading.script import script_of
from vastflow.sim.replay import Box, replay
from vastflow.tasks.engine.progress import Observer

MOST_BYTES: Final = 1_000_000
FILM: Final = "film.mp4"
README: Final = "README.md"
PARAMETERS: Final = "nav2_parameters.yaml"
MINIMIZED: Final = "minimized"
_COSTMAPS: Final = ("/global_costmap/costmap", "/local_costmap/costmap")
_SENSED: Final = ("/scan", "/particle_cloud")
_LEAVING: Final = (
    ((), ()),
    (_COSTMAPS, ("the costmaps of the bag",)),
    ((*_COSTMAPS, *_SENSED), ("the costmaps, scans, and particles of the bag",)),
    ((*_COSTMAPS, *_SENSED), ("the costmaps, scans, and particles of the bag", "the film")),
    (None, ("the bag",)),
    (None, ("the bag", "the film")),
)
"""Topics that a bag lacks, None for no bag, and what is left out in words."""
_LONG_AGO: Final = (1980, 1, 1, 0, 0, 0)
_CRF: Final = 28
_LOOK_TICKS: Final = 10
_MARGIN_M: Final = 1.0
CUT_RUNS: Final = 10
"""Runs that show whether a minimized campaign still fails on a cut map."""
_TEMPLATE: Final = Path(__file__).with_name("README.md.j2")


@dataclass(frozen=True)
class Report:
    """A report of a failure.

    Attributes:
        files: Content by place, the README among it.
        left_out: What had no room.
    """

    files: Mapping[str, bytes] = field(repr=False)
    left_out: tuple[str, ...]

    def zipped(self) -> bytes:
        """Return the files as an archive; equal files give equal bytes."""
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
            for name, content in sorted(self.files.items()):
                archive.writestr(zipfile.ZipInfo(name, _LONG_AGO), content, zipfile.ZIP_DEFLATED, 9)
        return out.getvalue()


def minimized(
    failed: FailedRun, for_s: float, observer: Observer | None = None, **asked: Any
) -> tuple[dict[str, bytes], str]:
    """Minimize the configuration of a failed run, cut its map to what its robot sees, and return files and words.

    Args:
        for_s: See `minimize_configuration`.
        asked: Store and workers.
    """
    failing = failed.failing
    try:
        found = minimize_configuration(
            failing.directory, failing.name, oracle=failing.oracle, observer=observer, for_s=for_s, **asked
        )
    except NotMinimized as error:
        return {}, f"It is not minimized: {str(error).removeprefix(f'{failing.directory}: ')}"
    words = " ".join(line.removeprefix("# ") for line in found.text.partition("\n\n")[0].splitlines())
    files = {**found.files, MINIMAL: found.text.encode()}
    files.pop("campaign.vast", None)
    cut, said = _cut(files, found, asked)
    return cut, f"{words} {said}"


def _cut(files: Mapping[str, bytes], found: Minimized, asked: Mapping[str, Any]) -> tuple[dict[str, bytes], str]:
    """Return the files with a map cut to what the robot saw, and the outcome in words."""
    whole = with_small_map(files)
    with _laid_out(whole) as folder:
        campaign, _ = read_campaign(folder / MINIMAL)
        (configuration,) = instantiate(campaign).configurations
        smaller = with_small_map(files, _seen(configuration.scenario, campaign.seed))
    if smaller == whole:
        return whole, "Its map is whole: the robot saw all of it."
    with suppress(UserError), _laid_out(smaller) as folder:
        summary = run_campaign(folder / MINIMAL, results=folder / "results", runs=CUT_RUNS, **asked).summary
        counted = summary.oracles.get(found.failing.oracle)
        failed = summary.failed if counted is None else counted.failed
        if failed >= (1.0 - found.rule.bounds.systematic) * CUT_RUNS:
            return smaller, f"Its map is cut to what the robot saw, on which {failed} of {CUT_RUNS} runs fail."
        return whole, f"Its map is whole: on what the robot saw of it, only {failed} of {CUT_RUNS} runs fail."
    return whole, "Its map is whole: nothing runs on what the robot saw of it."


def _seen(scenario: Any, seed: int) -> Bounds:
    """Return what encloses the path and the scans of a scenario's first run."""
    looks = dict.fromkeys(range(0, round(scenario.timeout_s * 20), _LOOK_TICKS), Box(0.0, 0.0, 0.0, 0.0))
    replayed = replay(scenario, 0, seed, looks)
    poses = [(each.true.x_m, each.true.y_m) for each in replayed.moments]
    goals = [(goal.x_m, goal.y_m) for goal in script_of(scenario).goals]
    points = np.concatenate([np.array(poses + goals), *(each.scan_xy_m for each in replayed.snapshots)])
    (x0, y0), (x1, y1) = (points.min(axis=0) - _MARGIN_M).tolist(), (points.max(axis=0) + _MARGIN_M).tolist()
    return x0, y0, x1, y1


@contextmanager
def _laid_out(files: Mapping[str, bytes]) -> Iterator[Path]:
    """Yield a temporary folder with files."""
    with TemporaryDirectory(prefix="vastflow-") as place:
        write_files(Path(place).resolve(), files)
        yield Path(place).resolve()


def report_of(failed: FailedRun, smaller: Mapping[str, bytes], words: str) -> Report:
    """Return the report of a failed run, which was repeated from the report's own files before.

    What has no room is left out: costmaps, scans and particles, the film, and at last the bag.

    Args:
        smaller, words: See `minimized`.

    Raises:
        UnusableDirectory: the run does not repeat here, or the map and the recording alone are too large.
        UserError: the extra `ros` is not installed.
    """
    files = failed.files()
    with _laid_out(files) as folder:
        check_repeats(folder, failed)
    files |= {f"{MINIMIZED}/{name}": content for name, content in smaller.items()}
    if failed.parameters:
        values = yaml.safe_dump(_plain(failed.parameters), sort_keys=False, allow_unicode=True)
        files[PARAMETERS] = (
            f"# What the campaign sets of robot and Nav2, and what its Nav2 file has that differs from Nav2's defaults.\n{values}".encode()
        )
    film, bag = _film(failed), cache(partial(bag_of, failed.recorded))
    for without, named in _LEAVING:
        left_out = tuple(each for each in named if film or each != "the film")
        parts = files | ({} if "the film" in named else film)
        if without is not None:
            parts |= {f"{BAG}/{name}": content for name, content in bag(without).items()}
        report = Report({**parts, README: _readme(failed, words, parts, left_out).encode()}, left_out)
        if len(report.zipped()) <= MOST_BYTES:
            return report
    raise UnusableDirectory(
        f"{failed.failing.directory}: expected at most {MOST_BYTES:,} bytes of map and recording, packed, got more"
    )


def _film(failed: FailedRun) -> dict[str, bytes]:
    """Return the film of the recording; nothing where it can't be encoded."""
    directory, name = failed.failing.directory, failed.recorded.configuration
    with reading(directory), TemporaryDirectory(prefix="vastflow-") as folder:
        tables = read_tables(directory)
        case = case_of(tables, tables.configurations.names.index(name), KeptFiles(directory))
        filmed = FilmedRun(case, failed.recorded.recording, "fail", case.situation.circumscribed_radius_m)
        try:
            write_film(file := Path(folder, FILM), filmed.pictures(), PICTURE_MS, LAST_MS, _CRF)
        except FilmError:
            return {}
        return {FILM: file.read_bytes()}


def _readme(failed: FailedRun, words: str, files: Mapping[str, bytes], left_out: Sequence[str]) -> str:
    columns, metadata = failed.recorded.recording.columns, failed.recorded.metadata
    system = [metadata["host"].get(key) for key in ("machine", "system")]
    text: str = Template(_TEMPLATE.read_text(encoding="utf-8"), trim_blocks=True, lstrip_blocks=True).render(
        failed=failed,
        campaign=metadata["name"],
        facts=failed.facts,
        end_m=[int(columns[name][-1]) / 1000 for name in ("x_mm", "y_mm")],
        words=words,
        files=files,
        left_out=left_out,
        versions={"vastflow": metadata["vastflow"], **metadata["versions"]},
        host=" ".join(str(each) for each in system if each),
    )
    return text


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: list(value) if isinstance(value, tuple) else Path(value.path).name if hasattr(value, "path") else value
        for key, value in values.items()
    }
