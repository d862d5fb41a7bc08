"""Campaign directories of verdicts alone, which a comparison and a terminal read."""

import json

import pyarrow as pa
import pyarrow.parquet as pq

from vastflow.flows.results.provenance import STAGES
from vastflow.oracles.results.schema import CONFIGURATIONS, REJECTIONS, RUNS, VERDICTS
from vastflow.sim.model.nodes import NodeProcess, Nodes
from vastflow.sim.model.scenario import ProcessSetup

INGREDIENTS = {
    "vastflow": "0.1.0",
    "numeric_class": "x86_64; glibc",
    "seed": 1,
    "oracles": [],
    "code": {stage: {"files": {"sim.run": "a"}, "libraries": {"numpy": "1.0"}} for stage in STAGES},
}
"""Ingredients of the results in `metadata.json`."""


def write(
    folder,
    configurations,
    *,
    oracles=("success",),
    seed="",
    created="2026-11-22T06:00:00",
    system_key="noise",
    differ="goal",
    time_s=None,
    programs=None,
):
    """A campaign directory without recordings: task, system, and a letter for each run: p, f, or n for not judged.

    Tasks are goals that `differ`, on one map or on none, or one goal on maps that do. A system is the value of `system_key`, or without it values by key;
    `time_s` gives the time of a configuration's run by name and index, and `programs` is the setup of all."""
    folder.mkdir(parents=True)
    rows, runs, verdicts = [], [], []
    for name, (task, system, said) in configurations.items():
        place = {} if differ == "goal" else {"map_file": {"file": f"{task if differ == 'map' else 0}"}}
        content = {
            "environment": place,
            "task": {"goal": task * (differ != "map")},
            "system": {system_key: system} if system_key else system,
        }
        content |= {"programs": programs} if programs else {}
        row = {"name": name, "family": "f", "provenance": "{}"}
        row |= dict.fromkeys(("scenario_digest", "checked_digest"), f"{task} {system}{programs or ''}")
        row |= {"abstract": "builtin:navigate_to_pose", "scenario": json.dumps(content)}
        rows.append({**row, "factors": json.dumps({"noise": system} if system_key else system)})
        for k, letter in enumerate(said):
            runs.append({"configuration": name, "run_index": k, "seed": f"{seed}{task}-{k}"})
            for oracle in oracles:
                judgment = {"p": "pass", "f": "fail", "n": "not judged"}[letter]
                verdict = {"configuration": name, "family": "f", "run_index": k, "oracle": oracle}
                metrics = {} if time_s is None else {"time": {"value": time_s(name, k), "unit": "s"}}
                verdict["metrics"] = json.dumps(metrics)
                verdicts.append({**verdict, "judgment": judgment, "reason": ""})
    tables = {"configurations": (rows, CONFIGURATIONS), "runs": (runs, RUNS)}
    tables |= {"verdicts": (verdicts, VERDICTS), "rejections": ([], REJECTIONS)}
    for table, (content, schema) in tables.items():
        pq.write_table(pa.Table.from_pylist(content, schema), folder / f"{table}.parquet")
    (folder / "campaign.vast").write_text("version: 1\n")
    source = dict.fromkeys(("execute", "observe", "judge"), folder.name)
    metadata = {"name": folder.name, "created": created, "source": source, **INGREDIENTS}
    (folder / "metadata.json").write_text(json.dumps(metadata))
    return folder


def same(said, system=0, configurations=12):
    return {f"c{k}": (k, system, said) for k in range(configurations)}


def driven_by_nodes(directory):
    """The directory, its runs driven by nodes of ROS 2."""
    file = directory / "configurations.parquet"
    rows = pq.read_table(file).to_pylist()
    programs = ProcessSetup(nodes=Nodes((NodeProcess("follower", ("python3", "follower.py")),))).content
    for row in rows:
        row["scenario"] = json.dumps({**json.loads(row["scenario"]), "programs": programs})
    pq.write_table(pa.Table.from_pylist(rows, CONFIGURATIONS), file)
    return directory
