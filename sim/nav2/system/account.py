"""Accounts of Nav2 parameter files, one row for each parameter."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

from vastflow.sim.nav2.parameter_files.command_chain import command_chain, filter_chains
from vastflow.sim.nav2.parameter_files.document import dotted
from vastflow.sim.nav2.parameter_files.findings import Status, findings, left_out, omitted
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import read_nav2_document
from vastflow.sim.nav2.parameter_files.refusals import refusals
from vastflow.sim.nav2.parameter_files.releases import changes_since_jazzy, guessed_release, release_of
from vastflow.sim.nav2.parameter_files.robots import namespace_text
from vastflow.sim.nav2.system.robot import lidar_of, robot_facts, robot_of


def account(path: Path) -> Mapping[str, Any]:
    """Return the account of a file as `vastflow params` prints it.

    Raises:
        FileError: the file can't be read.
    """
    found = interpretation(read_nav2_document(path))
    rows = findings(found)
    counted = Counter[str](row.status for row in rows)
    counts = {status: counted[status] for status in get_args(Status)}
    parameters, kinds = [], {*found.reader.kinds.values()}
    for row in rows:
        place = {"path": dotted(row.path), "line": row.place[0], "column": row.place[1]}
        parameters.append({**place, "value": row.value, "status": row.status, "used": row.used, "why": row.why})
    return {
        "file": found.document.file,
        "robot_namespace": namespace_text(found.document.robot),
        "other_robots": [*dict.fromkeys(map(namespace_text, found.document.others.values()))],
        "counts": counts,
        "parameters": parameters,
        "robot": asdict(robot_of(found.parameters)),
        "lidar": asdict(lidar_of(found.parameters)),
        "robot_facts": [asdict(fact) for fact in robot_facts(found.parameters)],
        "left_out": {dotted(path): value for path, value in left_out(found).items()},
        "omitted": [
            {"path": dotted(path), "value": declared.default, "source": declared.source, key: other}
            for path, declared, other, is_used in omitted(found)
            for key in ["jazzy" if is_used else "built_in"]
        ],
        "refused": [str(fault) for fault in refusals(found)],
        "warnings": {dotted(path): list(said) for path, said in found.reader.warnings.items()},
        "nav2_release": release_of(found.document),
        "nav2_release_by": guessed_release(found.document)[1],
        "release_differences": [change._asdict() for change in changes_since_jazzy(found.document, kinds)],
        "command_chain": command_chain(found.document, found.left_away),
        "filter_chains": [*filter_chains(found.reader)],
        "nodes_of_jazzy": found.replaced,
        "nodes_of_code": found.absent,
        "nodes_left_away": found.left_away,
    }
