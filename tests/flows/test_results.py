"""The campaign directory: complete on its own, and the same bytes for the same runs."""

import json
import math
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from table import each_row
from whole_directory import ConfigurationResult, write_results

from vastflow.flows.results.results import write_map
from vastflow.flows.results.rows import complete, one_block
from vastflow.flows.results.summary import Summary
from vastflow.oracles.judgment.verdict import Metric, Verdict
from vastflow.oracles.observation.trace import NOWHERE_MM
from vastflow.oracles.page.report import write_report
from vastflow.oracles.results.tables import read_tables
from vastflow.oracles.statistics.intervals import Counts
from vastflow.sim.model.blocks import read_block, read_recordings, write_block, write_recordings
from vastflow.sim.model.recording import Event, Recording, Run
from vastflow.sim.world.map_file import LARGEST_CELL_M, LEAST_CELL_M, load_map
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.tasks.engine.engine import RunFault


def recording(run_index):
    samples = np.arange(50 + run_index, dtype=np.int32)
    run = Run(run_index, "7", "succeeded", 0, "", 10.0, 5.0, 0, 0, (Event(1.0, "contact", 0.0, 0.0, "wall", 0.1),))
    return Recording(run, {"t_ms": samples * 100, "x_mm": samples * 7 - run_index})


def blocks_of(*blocks):
    return [write_recordings([recording(k) for k in block]) for block in blocks]


def found_of(runs, judgment="pass"):
    verdicts = [Verdict("success", k, judgment, "", {"time": Metric(10.0, "s")}) for k in runs]
    return ConfigurationResult(blocks_of(runs), blocks_of(runs), verdicts)


def written(path, root, found, report=lambda directory: None):
    return write_results(path, root, found, report=report)


@each_row(
    "blocking",
    [
        [range(5)],
        [range(3), range(3, 5)],
        [range(3, 5), range(3)],
        [[k] for k in range(5)],
        [range(8)],
        [range(2), range(1, 8)],
    ],
)
def test_joined_blocks_have_equal_bytes_for_any_cut(blocking):
    assert one_block(blocks_of(*blocking), 5) == write_recordings([recording(k) for k in range(5)])
    assert (one_block(blocks_of(range(5, 8)), 5), one_block([], 5)) == (b"", b"")


def test_joined_blocks_fill_missing_signals():
    near, far = (np.full(3, 7, dtype=np.int32), np.full(3, NOWHERE_MM, dtype=np.int32))
    without = write_block([{"run_index": 0}], [{"localization_error_mm": near}])
    having = write_block([{"run_index": 1}], [{"localization_error_mm": near, "separation_mm/box": near}])
    (_, first), (_, second) = read_block(one_block([without, having], 2))
    assert first["separation_mm/box"].tolist() == far.tolist()
    assert second["separation_mm/box"].tolist() == near.tolist()


def test_complete_fills_missing_verdicts_with_faults():
    result = ConfigurationResult(
        verdicts=[Verdict("safety", 0, "pass"), Verdict("success", 0, "pass"), Verdict("success", 9, "fail")],
        faults=[RunFault("room-1", 1, "execute", "MemoryError: 3 GB")],
    )
    assert complete(result, 3, ["success", "safety"]) == [
        Verdict("success", 0, "pass"),
        Verdict("safety", 0, "pass"),
        Verdict("success", 1, "not judged", "fault in execute: MemoryError: 3 GB"),
        Verdict("safety", 1, "not judged", "fault in execute: MemoryError: 3 GB"),
        Verdict("success", 2, "not judged", "fault: there is no verdict"),
        Verdict("safety", 2, "not judged", "fault: there is no verdict"),
    ]


def whole(configuration):
    return found_of(range(2))


def test_directory_is_complete_without_campaign_files(small_room, tmp_path):
    digest, campaign = load_map(small_room.with_name("room.yaml")).digest, small_room.read_bytes()
    directory = written(small_room, tmp_path / "results", whole).directory
    shutil.rmtree(small_room.parent)
    assert directory == tmp_path / "results/small-room-2026-11-21-060504"
    tables = ["configurations", "exclusions", "rejections", "runs", "verdicts"]
    runs = [f"{folder}/room-{k}.parquet" for folder in ("recordings", "traces") for k in (1, 2)]
    maps = [f"environments/{digest}/map.{kind}" for kind in ("pgm", "yaml")]
    files = ["campaign.vast", "coverage.json", "inputs/room.pgm", "inputs/room.yaml", "metadata.json"]
    assert sorted(p.relative_to(directory).as_posix() for p in directory.rglob("*.*")) == sorted(
        [*files, *maps, *runs, *(f"{name}.parquet" for name in tables)]
    )
    assert (directory / "campaign.vast").read_bytes() == campaign
    found = read_tables(directory)
    assert found.configurations.environments == [digest, digest]
    assert load_map(directory / "environments" / digest / "map.yaml").digest == digest
    assert len(read_recordings((directory / "recordings/room-1.parquet").read_bytes())) == 2
    rows = [(row["configuration"], row["run_index"], row["contacts"]) for row in found.runs.to_pylist()]
    assert rows == [(name, k, 1) for name in ("room-1", "room-2") for k in (0, 1)]


def test_results_escape_characters_outside_utf_8(small_room, tmp_path):
    said = "no file a\udcff.csv"
    fault = RunFault("room-2", None, "judge", said)
    failed = ConfigurationResult(verdicts=[Verdict("success", k, "fail", said) for k in range(2)])
    found = {"room-1": failed, "room-2": ConfigurationResult(faults=[fault])}
    results = written(small_room, tmp_path, lambda configuration: found[configuration.name], write_report)
    assert results.faults == (fault,)
    assert json.loads((results.directory / "metadata.json").read_text())["faults"][0]["error"] == said
    assert "no file a\\udcff.csv" in (results.directory / "report.html").read_text()


def test_metadata_has_summary_and_faults(small_room, tmp_path):
    fault = RunFault("room-1", 1, "execute", "MemoryError: 3 GB")

    def found(configuration):
        both = found_of(range(2))
        if configuration.name == "room-2":
            return both
        return ConfigurationResult(blocks_of([0]), blocks_of([0]), both.verdicts[:1], [fault])

    results = written(small_room, tmp_path, found)
    metadata = json.loads((results.directory / "metadata.json").read_text())
    assert metadata["counts"] == results.summary.as_json()
    assert metadata["counts"]["not_judged"] == 1
    assert metadata["faults"] == [
        {"configuration": "room-1", "run_index": 1, "stage": "execute", "error": "MemoryError: 3 GB"}
    ]
    assert metadata["name"] == "small_room" and metadata["created"] == "2026-11-21T06:05:04"
    assert {"python", "numpy", "pyarrow"} <= set(metadata["versions"])
    assert metadata["numeric_class"] == "x86_64; glibc 2.36; avx2 fma; "
    assert metadata["source"] == {"execute": "e" * 64, "observe": "o" * 64, "judge": "j" * 64, "oracles": {}}
    assert pq.read_metadata(results.directory / "runs.parquet").num_rows == 3


def test_report_is_written_before_directory_appears(small_room, tmp_path):
    seen = []

    def report(directory):
        assert read_tables(directory).metadata["counts"]["runs"] == 4
        seen.extend(p.name for p in tmp_path.glob("results/[!.]*"))
        raise RuntimeError("no font")

    results = written(small_room, tmp_path / "results", whole, report)
    assert seen == [] and results.faults == (RunFault("", None, "report", "RuntimeError: no font"),)
    assert json.loads((results.directory / "metadata.json").read_text())["faults"][0]["stage"] == "report"


METERS = st.floats(-1e3, 1e3, allow_nan=False)
RESOLUTIONS = st.sampled_from([0.05, 0.025, 0.1, 1.0, LEAST_CELL_M, LARGEST_CELL_M, 1 / 3])


@pytest.mark.parametrize("values", [(0, 100, -1), tuple(range(-1, 101))], ids=["trinary", "scale"])
def test_written_map_equals_original(tmp_path_factory, values):
    @given(
        arrays(np.int8, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.sampled_from(values)),
        RESOLUTIONS,
        st.tuples(METERS, METERS),
        st.sampled_from([0.0, 0.3, -math.pi / 4, math.pi / 4, 1e-4]),
    )
    def check(cells, resolution_m, origin_xy_m, yaw_rad):
        occupancy = OccupancyMap(cells, resolution_m, origin_xy_m, yaw_rad)
        directory = tmp_path_factory.mktemp("map")
        write_map(directory, occupancy)
        assert load_map(directory / "map.yaml").digest == occupancy.digest

    check()


def test_trinary_map_has_the_gray_values_of_map_saver(tmp_path):
    write_map(tmp_path / "e", OccupancyMap(np.array([[0, 100, -1]], dtype=np.int8), 0.05, (0.0, 0.0)))
    assert (tmp_path / "e/map.pgm").read_bytes().endswith(bytes([254, 0, 205]))


KEYS = """
configurations rejected duplicates runs executed reused passed failed not_judged simulated_s cpu_s wall_s results
oracles excluded excluded_by sampled_from stood_still headline
"""


def test_summary_prints_one_line_of_json_with_rounded_seconds():
    counts = {"success": Counts(119, 1, 0)}
    summary = Summary(24, 1, 2, 120, 100, 20, 110, 9, 1, 4800.123456, 61.0004, 35.5, "results/c", counts)
    text = summary.json_text()
    assert "\n" not in text and list(json.loads(text)) == KEYS.split()
    assert summary.as_json()["oracles"] == {"success": {"passed": 119, "failed": 1, "not_judged": 0}}
    assert summary.as_json()["simulated_s"] == 4800.123
