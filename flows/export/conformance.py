"""The contract of export formats, as checks that a format's author can call in a test."""

from collections.abc import Callable
from functools import partial
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import pyarrow as pa

from vastflow.flows.export.format import ExportedCampaign, ExportedConfiguration, ExportedFile, Format
from vastflow.flows.export.run import ExportedRun
from vastflow.oracles.results.schema import JUDGED_RUNS, VERDICTS
from vastflow.sim.model.recording import RunLog
from vastflow.sim.plug_ins.conformance import must


def check_format(chosen: Format) -> None:
    """Run all `CHECKS` on a format; raise an `AssertionError` that says what it must do at the first that fails."""
    for check in CHECKS:
        check(chosen)


def check_files(chosen: Format) -> None:
    """Check that it yields each file once, inside the folder, with bytes or a path as content."""
    name = type(chosen).__name__
    for campaign in sample_campaigns():
        taken: set[str] = set()
        for place, content in _files(chosen, campaign):
            path = PurePosixPath(place)
            inside = isinstance(place, str) and bool(path.parts) and not path.is_absolute() and ".." not in path.parts
            must(inside and "\\" not in place, f"{name} must yield a path inside the folder, got {place!r}")
            is_content = isinstance(content, bytes) or (isinstance(content, Path) and content.is_file())
            must(is_content, f"{name} must yield bytes or the path of a file for {place!r}")
            must(str(path) not in taken, f"{name} must yield {place!r} once")
            taken.add(str(path))
        above = taken & {str(parent) for place in taken for parent in PurePosixPath(place).parents}
        must(not above, f"{name} must not yield files at {sorted(above)}, which are folders of others")


def check_determinism(chosen: Format) -> None:
    """Check that the same campaign gives the same files."""
    for campaign in sample_campaigns():
        same = _files(chosen, campaign) == _files(chosen, campaign)
        must(same, f"{type(chosen).__name__} must yield the same files for the same campaign")


CHECKS: Final[tuple[Callable[[Format], None], ...]] = (check_files, check_determinism)
"""All checks, for a test that is parametrized with them and reports each on its own."""


def sample_campaigns() -> tuple[ExportedCampaign, ...]:
    """Return an empty campaign, and one with runs of all kinds, a duplicate, and texts that XML lacks."""
    log = RunLog(1_700_000_000.0, 0.5, 0.4, 4096, ("0.1 s: \x00 begun",))
    metrics = {"time": {"value": 7.5, "unit": "s"}}
    verdict = _row(VERDICTS, oracle="success", judgment="pass", metrics=metrics)
    failed = _row(VERDICTS, oracle="näh<e>", judgment="fail", reason='a "box"\n& a wall', metrics={})
    run = partial(ExportedRun, "sample", host={"host": {"name": "bench"}, "versions": {}, "pid": 1})
    row = _row(JUDGED_RUNS, simulated_s=7.5, outcome="succeeded", distance_m=5.0)
    columns = {name: np.array([0, 5, 10], dtype=np.int32) for name in ("t_ms", "x_mm", "y_mm", "yaw_mrad")}
    for column in columns.values():  # here and in outputs, a change raises
        column.flags.writeable = False
    robot = [run("room-1", 0, [verdict], row, log, recorded=columns), run("room-1", 1, [verdict, failed], row, log)]
    program = [
        run("job-1", 0, [], None, None),
        run("job-1", 3, [failed], None, log, outputs=MappingProxyType({"a/b.csv": b"n\n1\n", "ü": b""})),
    ]
    values = {"map_file": PurePosixPath("maps/room.yaml"), "goal": {"x": 1.0}, "empty": None}
    configurations = (
        ExportedConfiguration("room-1", "room", "navigate", values, None, robot),
        ExportedConfiguration("room-2", "room", "navigate", values, "room-1"),
        ExportedConfiguration("job-1", "job", runs=program),
    )
    files = {"campaign.vast": Path(__file__), "maps/room.yaml": Path(__file__)}
    return ExportedCampaign("empty"), ExportedCampaign("sample", "2 of 4 runs passed", configurations, files)


def _row(schema: pa.Schema, **values: Any) -> dict[str, Any]:
    return {field.name: values.get(field.name, "" if pa.types.is_string(field.type) else 0) for field in schema}


def _files(chosen: Format, campaign: ExportedCampaign) -> list[ExportedFile]:
    try:
        return list(chosen.files(campaign))
    except Exception as error:
        what = f"{type(chosen).__name__} must not raise, and raised {type(error).__name__}: {error}"
        raise AssertionError(what) from error
