"""RoboVAST's own configurations, where they lie beside the repository, still run.

`expected.json` has for each file what `table.py` said of it with two configurations of a campaign and one run of each. A row that
is better than that fails nothing; one that got worse does.
"""

import json
import sys
from pathlib import Path

import pytest
from table import each_row

UPSTREAM = Path(__file__).parents[3] / "shared" / "upstream" / "robovast-configs"
EXPECTED = json.loads((Path(__file__).parent / "expected.json").read_text())
RANKS = ("refused", "valid", "ran")

VARIED = [f"navigation_variation{kind}" for kind in ("", "_random", "_rasterized")]
NAVIGATION = [f"navigation/{name}.vast" for name in ("nav_to_pose_multiple", *VARIED, "small_dataset")]
PROGRAMS = ["examples/growth_sim/growth_sim.vast", "examples/quadrotor_landing/quadrotor_landing.vast"]
DRIVING = ["examples/basic_nav/basic_nav.vast", *NAVIGATION]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not UPSTREAM.is_dir(), reason="RoboVAST's configurations are not beside the repository"),
    pytest.mark.timeout(2400),  # the first of them executes all files
]


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    sys.path.insert(0, str(Path(__file__).parent))
    try:
        from rows import Trial, copied, rows_of
    finally:
        sys.path.pop(0)
    folder = copied(UPSTREAM, tmp_path_factory.mktemp("upstream"))
    return {row.file: row for row in rows_of(folder, Trial(sample=2))}


def test_expectations_cover_all_files(rows):
    assert sorted(rows) == sorted(EXPECTED)


@each_row("file", EXPECTED)
def test_file_fares_no_worse_than_it_did(rows, file):
    row, expected = rows[file], EXPECTED[file]
    assert RANKS.index(row.outcome) >= RANKS.index(expected["outcome"]), row
    assert row.configurations >= expected["configurations"], row
    assert row.broken <= expected["broken"], row
    if expected["sent"]:
        assert row.sent and row.drove / row.sent >= expected["drove"] / expected["sent"], row


@each_row("file", [*DRIVING, *PROGRAMS])
def test_campaign_runs_and_nine_robots_in_ten_drive_a_meter(rows, file):
    row = rows[file]
    assert row.outcome == "ran" and row.runs > 0, row
    assert row.passed + row.failed == row.runs if file in PROGRAMS else row.sent == row.runs, row
    assert row.drove >= 0.9 * row.sent, row


def test_scenarios_and_floor_plans_run_except_one_of_ros_nodes(rows):
    scenarios = {file: row for file, row in rows.items() if row.kind == "scenario"}
    assert len(scenarios) == 8
    assert [file for file, row in scenarios.items() if row.outcome == "refused"] == ["examples/ros2_basic/scenario.osc"]
    for file, row in scenarios.items():
        assert row.broken == 0, row
        assert row.drove == row.sent, row
        if "nav" in file:
            assert row.sent == 1, row
    plans = [row for row in rows.values() if row.kind in ("floor plan", "variation")]
    assert len(plans) == 4 and all(row.outcome == "ran" for row in plans)


def test_searches_are_valid_files(rows):
    executed = [file for file, row in rows.items() if row.reason.startswith("a search")]
    assert executed == ["navigation/navigation_search.vast"]
    others = [row for row in rows.values() if row.reason.startswith("No module named 'robovast'")]
    assert len(others) == 3 and all(row.outcome == "valid" for row in others)
