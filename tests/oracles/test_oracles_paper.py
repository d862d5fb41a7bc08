"""Results of the paper's campaigns beside the paper's own."""

import json

import paper_results as paper_weights
import pytest
from hypothesis import given
from hypothesis import strategies as st
from paper_page import paper_page
from paper_published import ALL_RUNS, PUBLISHED
from paper_results import Begun, Requested, Starts, paper_results, requested_of
from table import each_row

from vastflow.oracles.statistics.intervals import Counts, Interval, clustered, pooled, wilson
from vastflow.sim.loop.standstill import POINTS_IN_FOOTPRINT

RADIUS = "global_costmap.robot_radius"


def start(x_m):
    """Factors of a configuration in a room of 3 m × 3 m with walls of one cell."""
    return {"start_pose": {"position": {"x": x_m, "y": 1.525}, "orientation": {"yaw": 0.0}}}


def family(kind="cartesian", *, rows, product, realized, duplicate=0, rejected=None, factors=()):
    return {
        "design": {"kind": kind, "rows": rows, "product": product, "size": rows},
        "realized": realized,
        "duplicate": duplicate,
        "unrealizable_by": {name: {"count": n} for name, n in (rejected or {}).items()},
        "factors": [{"name": name, "levels": levels} for name, levels in factors],
    }


def coverage(of_family):
    return {"families": {"0": of_family}, "duplicate": of_family["duplicate"], "realized": of_family["realized"]}


def margins(footprint_m, cube_m):
    """The metrics of `safety` in a run without contacts."""
    values = {"footprint_margin": footprint_m, "cube_margin": cube_m, "obstacle_contacts": 0}
    return {name: {"value": value, "unit": "m"} for name, value in values.items()}


@pytest.fixture
def safety(build, tmp_path):
    """Without obstacles everything passes, and thrice; with boxes one run reaches the goal too near to one."""
    empty = {**start(1.025), RADIUS: 0.22, "static_objects": []}, {"_path_length": 10.0}
    configurations = [
        *((name, of, *empty) for name, of in (("a-1", None), ("a-2", "a-1"), ("a-3", "a-1"))),
        ("a-4", None, {**start(0.275), RADIUS: 0.175, "static_objects": [{}] * 5}, {"_path_length": 9.6}),
    ]
    moved = [("a-1", 20.0, 10.0, None), ("a-1", 20.0, 10.0, None), ("a-4", 60.0, 40.0, None)]
    runs = [*moved, ("a-4", 60.0, 0.0, POINTS_IN_FOOTPRINT)]
    verdicts = [
        *(("a-1", i, oracle, "pass", margins(None, None)) for i in (0, 1) for oracle in ("success", "safety")),
        ("a-4", 0, "success", "pass", {}),
        ("a-4", 0, "safety", "fail", margins(0.1, -0.02)),
        ("a-4", 1, "success", "fail", {}),
        ("a-4", 1, "safety", "pass", margins(0.4, 0.2)),
    ]
    made = build.campaign(tmp_path / "safety")
    for configuration, run_index, oracle, judgment, metrics in verdicts:
        row = {"configuration": configuration, "run_index": run_index, "oracle": oracle, "judgment": judgment}
        made.verdicts.append({**row, "metrics": json.dumps(metrics)})
    for k, (configuration, simulated_s, distance_m, stood_still) in enumerate(runs):
        moved = {"simulated_s": simulated_s, "distance_m": distance_m, "stood_still": stood_still}
        made.runs.append({"configuration": configuration, "run_index": k % 2, **moved})
    for configuration, duplicate_of, *texts in configurations:
        scenario = {"environment": {}, "task": {"goal_pose": configuration}}
        columns = zip(("factors", "provenance", "scenario"), map(json.dumps, (*texts, scenario)), strict=True)
        row = {"name": configuration, "duplicate_of": duplicate_of, "environment": "room"}
        made.configurations.append({**row, **dict(columns)})
    said = {
        "success": {"passed": 3, "failed": 1, "not_judged": 0},
        "safety": {"passed": 3, "failed": 1, "not_judged": 0},
    }
    counts = {"executed": len(runs), "simulated_s": 100.0, "cpu_s": 20.0, "oracles": said}
    made.metadata = {"name": "paper-safety-original-maps", "counts": counts, "host": {"cpus": 2}, "asked": {"runs": 2}}
    directory = made.write()
    found = coverage(family(rows=4, product=4, realized=2, duplicate=2))
    (directory / "coverage.json").write_text(json.dumps(found))
    build.write_map(directory / "environments" / "room", build.walled_room(3.0, 3.0))
    (directory / "logs").mkdir()
    costs = {"configuration": "a-1", "runs": [{"cpu_s": 0.25}] * len(runs)}
    (directory / "logs" / "runs.jsonl").write_text(json.dumps(costs))
    return directory


def test_papers_figures_are_consistent():
    assert ALL_RUNS == 109_600
    found = {kind: (round(100 * each.rate, 2), each.not_started) for kind, each in PUBLISHED.items()}
    assert found == {"performance": (98.12, 3997), "robustness": (82.8, 4390), "safety": (61.24, 11474)}


ROOMS = (("start_pose, goal_pose", 9), ("static_objects", 24), (RADIUS, 2))
"""The rooms of the paper's safety campaign: 3 of 9 paths, 24 settings, 2 radii; 6 placements find no room."""
NO_ROOM = {"PathVariationRandom": 6, "OneOfVariation": 6}


@each_row(
    ("rows", "requested"),
    [
        (family(rows=132, product=432, realized=102, duplicate=30, rejected=NO_ROOM, factors=ROOMS), (432, 288, 12, 30, 102)),
        (family("sample", rows=100, product=1262, realized=100, rejected={"PathVariationRasterized": 4}), (100, 0, 0, 0, 100)),
    ],
)  # fmt: skip
def test_requests_count_missing_paths_with_all_that_follows(rows, requested):
    assert requested_of(coverage(rows)) == Requested(*requested)


def test_paper_results_reduce_directory_to_figures(safety):
    found = paper_results(safety)
    assert (found.kind, found.original_maps, found.runs, found.sampled_from) == ("safety", True, 2, None)
    assert found.counts == {"a-1": Counts(2, 0), "a-4": Counts(0, 2)}
    assert found.weights == {"a-1": 3, "a-4": 1}
    assert (found.oracles["safety"], found.reached) == (Counts(3, 1), Counts(2, 1))
    assert [(way.simulated_s, way.distance_m) for way in found.ways] == [(40.0, 15.0), (30.0, 12.5)]
    assert (found.runs_cpu_s, found.alone, found.call) == (1.0, 160.0, 5.0)
    assert [(part.name, part.counts) for part in found.parts] == [
        ("global radius 0.175 m", Counts(0, 2)),
        ("global radius 0.220 m", Counts(2, 0)),
        ("no obstacles", Counts(2, 0)),
        ("obstacles, 0.6 for each meter", Counts(0, 2)),
    ]
    # `a-4` starts 0.225 m from the wall, and its second run does not move.
    near, free = Begun(1, Counts(0, 2), 1), Begun(1, Counts(2, 0), 0)
    assert found.starts == Starts(near, free, Counts(2, 1), {POINTS_IN_FOOTPRINT: 1})


def test_page_has_rates_as_the_paper_counts_and_of_moved_runs(safety):
    page = paper_page([paper_results(safety)])
    (row,) = (line for line in page.splitlines() if line.startswith("| safety | **") and "| 2 | 2 |" in line)
    for words in ("| 50.0 % [15.0, 85.0] |", "| 75.0 % [", "| **61.2 %** |"):
        assert words in row
    stood = "safety: 1 stood still, the collision monitor stopped every command: scan points inside the footprint."
    for words in ("| **66.7 % [20.7, 93.9]** | **61.2 %** |", stood, "| `cube` | 0.090 m | 75.0 %"):
        assert words in page
    assert "Every distinct configuration was run" in page and "spawn_delays" not in page


def test_weights_count_configurations_with_their_duplicates():
    rows = [("a-1", None), ("a-2", None), ("a-3", "a-1"), ("b-1", "a-1"), ("b-2", None)]
    assert paper_weights.weights_of(rows) == {"a-1": 3, "a-2": 1, "b-2": 1}
    assert paper_weights.weighted_counts({"a": Counts(1, 0)}, {"a": 2, "gone": 9}) == {"a": Counts(2, 0)}
    assert paper_weights.weighted_rate({"a": Counts(2, 0), "b": Counts(0, 2, 1)}, {"a": 6}).counts == Counts(12, 2, 1)
    # Kish: (6 · 2 + 1 · 2)² / (36 · 2 + 1 · 2) = 196 / 74 effective runs of the four.
    effective = 196 / 74
    found = paper_weights.weighted_rate({"a": Counts(2, 0), "b": Counts(0, 2)}, {"a": 6})
    assert found.interval == wilson(12 / 14 * effective, effective)
    assert paper_weights.weighted_rate({"a": Counts(3, 1)}, {"a": 5}).clustered is None
    for nothing in ({}, {"a": Counts(0, 0, 3)}):
        found = paper_weights.weighted_rate(nothing, {"a": 2})
        assert (found.rate, found.interval, found.clustered) == (None, Interval(0.0, 1.0), None)
    assert paper_weights.weighted_rate({"a": Counts(4, 0), "b": Counts(4, 0)}, {"a": 3}).interval.high == 1.0
    assert paper_weights.weighted_rate({"a": Counts(0, 4), "b": Counts(0, 4)}, {"a": 3}).interval.low == 0.0


@given(st.integers(1, 20), st.lists(st.integers(0, 20), max_size=6))
def test_equal_weights_and_numbers_of_runs_give_the_pooled_rate(runs, passes):
    counts = {f"c-{k}": Counts(min(x, runs), runs - min(x, runs)) for k, x in enumerate(passes)}
    plain, heavy = (
        paper_weights.weighted_rate(counts, {}),
        paper_weights.weighted_rate(counts, dict.fromkeys(counts, 4)),
    )
    whole = pooled(counts.values())
    assert plain.counts == whole
    for found in (plain, heavy):
        assert found.rate == (None if whole.rate is None else pytest.approx(whole.rate))
        assert (found.interval.low, found.interval.high) == pytest.approx((whole.interval.low, whole.interval.high))
    assert plain.clustered == clustered(list(counts.values()))
