"""Runs that stood still at the start: shown apart, and in every rate and gate."""

import json
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from vastflow.flows.cli.__main__ import app
from vastflow.flows.results.provenance import STAGES
from vastflow.flows.terminal.outcome import outcome
from vastflow.oracles.evidence.causes import Standstills, standstills_of
from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.evidence.findings import findings_of, shape_of
from vastflow.oracles.page.report import write_report
from vastflow.oracles.results.tables import read_tables
from vastflow.sim.loop.standstill import POINTS_IN_FOOTPRINT, STOOD_STILL
from vastflow.sim.model.recording import Event

CONFIGURATIONS, RUNS = 12, 10
NEAR_A_WALL = 4
"""So many of the configurations start near a wall, where the wide one of two robots stands still."""
THIN, WIDE = 0.2, 0.3
CAUSE = "the collision monitor stopped every command: scan points inside the footprint"

INGREDIENTS = {
    "numeric_class": "x86_64; glibc 2.36; -; -; Python 3.11",
    "seed": 0,
    "oracles": [],
    "source": dict.fromkeys(STAGES, "one"),
    "code": {stage: {"files": {}, "libraries": {}} for stage in STAGES},
}
"""Ingredients of the results in `metadata.json`, for a comparison."""


@pytest.fixture(scope="module")
def driven(build, tmp_path_factory):
    """Campaign directories of two systems that differ in their radius: thin, wide."""
    map_file = build.write_map(tmp_path_factory.mktemp("room"), build.walled_room(6.0, 6.0))
    stood = {"outcome": "timed_out", "events": (Event(0.0, STOOD_STILL, 1.0, 1.0, POINTS_IN_FOOTPRINT),)}

    def campaign(radius_m):
        made = build.campaign(tmp_path_factory.mktemp(f"radius-{radius_m}"))
        made.metadata |= INGREDIENTS
        for k in range(CONFIGURATIONS):
            path, given = ([(1, 1)] * 20, stood) if radius_m == WIDE and k < NEAR_A_WALL else ([(1, 1), (2, 2)], {})
            task = {"start_pose": {"x": 1, "y": 1}, "goal_pose": {"x": 2, "y": 2 + 0.1 * k}}
            system = {"robot_radius": radius_m}
            recordings = [build.a_recording(path, run_index=index, **given) for index in range(RUNS)]
            made.add(f"start-{k}", "room", map_file, task, recordings=recordings, factors=system, system=system)
        return made.write()

    return campaign(THIN), campaign(WIDE)


@pytest.mark.slow
def test_gate_fails_immobile_robot(driven):
    thin, wide = map(str, driven)
    called = CliRunner().invoke(app, ["compare", thin, wide, "--gate", "--pictures", "0"], terminal_width=200)
    assert called.exit_code == 1, called.output
    assert "gate does not hold" in called.stdout
    assert f"B stood still at the start: 40 runs (40: {CAUSE})" in " ".join(called.stdout.split())
    equal = CliRunner().invoke(app, ["compare", thin, thin, "--gate", "--margin", "0.04", "--pictures", "0", "--json"])
    assert equal.exit_code == 0
    assert json.loads(equal.stdout)["stood_still"] == {"before": 0, "after": 0}


def test_standstills_are_failed_runs_in_every_rate(driven):
    tables = read_tables(driven[1])
    evidence, findings = evidence_of(tables)[None], findings_of(tables)
    of = {f"start-{k}": 10 for k in range(NEAR_A_WALL)}
    assert standstills_of(tables) == Standstills({"points in footprint": 40}, of)
    earlier = replace(tables, runs=tables.runs.drop_columns(["stood_still"]))  # as an earlier version wrote them
    assert standstills_of(earlier).runs == 0
    assert (evidence.campaign.counts.passed, evidence.campaign.counts.failed) == (80, 40)
    assert evidence.families["room"].counts.failed == 40
    assert shape_of(findings) == {"always": CONFIGURATIONS - NEAR_A_WALL, "never": NEAR_A_WALL, "mixed": 0}


def test_terminal_report_and_evidence_show_standstills(driven):
    thin, wide = driven
    tables = read_tables(wide)
    said = [str(part) for part in outcome(tables, evidence_of(tables))]
    assert f"stood still at the start: 40 runs (40: {CAUSE})" in said
    write_report(wide)
    report = " ".join((wide / "report.html").read_text().split())
    headline = report[: report.index('<details class="fold" id="rates">')]
    assert "<b>40 runs stood still at the start</b>" in headline
    assert f"Stood still at the start: 40 runs (40: {CAUSE})." in headline
    assert '<th scope="col" class="n">Stood still</th>' in report
    found = json.loads((wide / "evidence.json").read_text())["stood_still"]
    assert (found["runs"], found["causes"]) == (40, {"points in footprint": 40})
    assert not [part for part in outcome(read_tables(thin), evidence_of(read_tables(thin))) if "stood" in str(part)]
