"""The report's section on a search: of an archive the runs of its worst cells."""

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vastflow.oracles.evidence.findings import findings_of
from vastflow.oracles.page.facts import facts_of
from vastflow.oracles.page.failures import cases
from vastflow.oracles.page.report import write_report
from vastflow.oracles.page.search_section import CELLS_DRAWN, search_section
from vastflow.oracles.results.tables import read_tables

TASK = {"start_pose": {"x": 1.0, "y": 1.0, "yaw": 0.0}, "goal_pose": {"x": 4.0, "y": 1.0, "yaw": 0.0}}
PATH = np.array([[1.0, 1.0], [2.0, 1.0], [4.0, 1.0]])
COUNT = CELLS_DRAWN + 2


def test_runs_of_the_worst_cells_are_drawn_worst_first(synthetic_campaign, tmp_path, build):
    room = build.write_map(tmp_path / "room", build.walled_room(5.0, 4.0))
    for k in range(COUNT):
        obstacles = [build.box_at(3.0, 1.5 + 0.2 * k)]
        recordings = [build.a_recording(PATH)]
        synthetic_campaign.add(f"point-{k}", "search", room, TASK, recordings=recordings, obstacles=obstacles)
    archive = {"measures": {"x": {"low": 0, "high": 10}, "y": {"low": 0, "high": 10}}}
    best = {"configuration": "point-3", "point": {}, "objective": 1.0, "runs": 1}
    said = {
        "strategy": "qd",
        "parameters": {"archive": archive},
        "space": {},
        "objective": "failure_rate",
        "is_rate": True,
    }
    said |= {
        "direction": "maximize",
        "batches": 1,
        "proposals": COUNT,
        "rejected": 0,
        "runs": COUNT,
        "ended_by": "runs",
    }
    synthetic_campaign.metadata = {"search": {**said, "best": best, "confirmation": None}}
    directory = synthetic_campaign.write()
    objectives = [0.1, 0.5, 0.2, 1.0, 0.3, 0.4]
    evaluations = [{"configuration": f"point-{k}", "objective": objectives[k], "runs": 1} for k in range(COUNT)]
    pq.write_table(pa.Table.from_pylist(evaluations), directory / "evaluations.parquet")
    cells = [
        {**each, "cell": json.dumps([k, 0]), "measures": json.dumps({"x": k + 0.5, "y": 0.0})}
        for k, each in enumerate(evaluations)
    ]
    pq.write_table(pa.Table.from_pylist(cells), directory / "archive.parquet")
    section = search_section(facts_of(read_tables(directory)))
    assert [each.name for each in section.pictures] == [
        *("search-progress", "search-archive"),
        *("cell-point-3", "cell-point-1", "cell-point-5", "cell-point-4"),
    ]
    assert section.pictures[2].title == "point-3: failure rate 1"
    assert section.pictures[2].caption == "The best point at x 3.5, y 0."


def test_report_of_a_search_claims_no_factors_and_no_share_of_zero_configurations(synthetic_campaign, tmp_path, build):
    room = build.write_map(tmp_path / "room", build.walled_room(5.0, 4.0))
    for k in range(12):
        recordings = [build.a_recording(PATH, run_index=n) for n in range(6)]
        if k % 2:
            recordings[:5] = [replace(each, run=replace(each.run, outcome="timed_out")) for each in recordings[:5]]
        name, task = f"point-{k}", {**TASK, "goal_pose": {"x": 4.0, "y": 1.0 + 0.01 * k, "yaw": 0.0}}
        synthetic_campaign.add(name, "search", room, task, recordings=recordings, factors={"noise": k % 2})
    directory = synthetic_campaign.write()
    write_report(directory)
    assert "noise matters" in (directory / "report.html").read_text()
    metadata = json.loads((directory / "metadata.json").read_text())
    said = {"strategy": "random", "parameters": {}, "space": {}, "objective": "failure_rate", "direction": "maximize"}
    said |= {"batches": 1, "proposals": 12, "rejected": 0, "runs": 72, "ended_by": "runs", "best": None}
    (directory / "metadata.json").write_text(json.dumps({**metadata, "search": said}))
    pq.write_table(pa.table({"configuration": pa.array([], pa.string())}), directory / "evaluations.parquet")
    write_report(directory)
    page = (directory / "report.html").read_text()
    assert "noise matters" not in page and "account for" not in page
    assert json.loads((directory / "evidence.json").read_text())["factors"] == []


def test_worst_configuration_has_the_highest_lower_bound_of_its_failure_rate(synthetic_campaign, tmp_path, build):
    room = build.write_map(tmp_path / "room", build.walled_room(5.0, 4.0))
    for name, failed, runs in (("one-of-one", 1, 1), ("nine-of-ten", 9, 10)):
        recordings = [build.a_recording(PATH, run_index=n) for n in range(runs)]
        recordings[:failed] = [
            replace(each, run=replace(each.run, outcome="timed_out")) for each in recordings[:failed]
        ]
        task = {**TASK, "goal_pose": {"x": 4.0, "y": 1.0 + 0.1 * runs, "yaw": 0.0}}
        synthetic_campaign.add(name, "search", room, task, recordings=recordings)
    tables = read_tables(synthetic_campaign.write())
    assert [tables.configurations.names[k] for k in cases(tables, findings_of(tables))] == ["nine-of-ten", "one-of-one"]
