"""The report's section on a search: of an archive the runs of its worst cells."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vastflow.oracles.directory.tables import read_tables
from vastflow.oracles.page.search_section import CELLS_DRAWN, search_section

TASK = {"start_pose": {"x": 1.0, "y": 1.0, "yaw": 0.0}, "goal_pose": {"x": 4.0, "y": 1.0, "yaw": 0.0}}
PATH = np.array([[1.0, 1.0], [2.0, 1.0], [4.0, 1.0]])
COUNT = CELLS_DRAWN + 2


def test_the_runs_of_the_worst_cells_are_drawn_worst_first(synthetic_campaign, tmp_path, build):
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
    section = search_section(read_tables(directory))
    assert [each.name for each in section.pictures] == [
        *("search-progress", "search-archive"),
        *("cell-point-3", "cell-point-1", "cell-point-5", "cell-point-4"),
    ]
    assert section.pictures[2].title == "point-3: failure rate 1"
    assert section.pictures[2].caption == "The best point at x 3.5, y 0."
