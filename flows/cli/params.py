"""The command `params`: which parameters of a Nav2 file the simulator uses."""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from vastflow.flows.terminal.options import AsJson
from vastflow.sim.model.faults import message_of

if TYPE_CHECKING:
    from vastflow.sim.nav2.parameter_files.findings import Finding
    from vastflow.sim.nav2.parameter_files.interpretation import Interpretation

MEANING: Final[Mapping[str, str]] = {
    "modeled": "used",
    "built in": "always so in the simulator",
    "no effect": "without effect on missions in the simulator",
    "differs": "another value is built in",
    "not modeled": "ignored",
}


def params(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Nav2 parameter file.")],
    as_json: AsJson = False,
) -> None:
    """Show which Nav2 parameters are modeled.

    Each parameter of the file with the value that the simulator uses, or with what it does instead.
    """
    from vastflow.sim.nav2.parameter_files.findings import findings
    from vastflow.sim.nav2.parameter_files.interpretation import interpretation
    from vastflow.sim.nav2.parameter_files.parameter_file import read_nav2_document

    found = interpretation(read_nav2_document(file))
    rows = findings(found)
    counted = Counter[str](row.status for row in rows)
    counts = {status: counted[status] for status in MEANING}
    if as_json:
        print(json.dumps(_as_json(found, rows, counts)))
    else:
        _print(found, rows, counts)


def _as_json(found: "Interpretation", rows: Sequence["Finding"], counts: Mapping[str, int]) -> Mapping[str, Any]:
    from vastflow.sim.nav2.parameter_files.command_chain import command_chain, filter_chains
    from vastflow.sim.nav2.parameter_files.document import dotted
    from vastflow.sim.nav2.parameter_files.findings import left_out, omitted
    from vastflow.sim.nav2.parameter_files.refusals import refusals
    from vastflow.sim.nav2.parameter_files.releases import changes_since_jazzy, release_of
    from vastflow.sim.nav2.parameter_files.robots import namespace_text
    from vastflow.sim.reading.robot import lidar_of, robot_facts, robot_of

    parameters, kinds = [], {*found.reader.kinds.values()}
    for row in rows:
        place = {"path": dotted(row.path), "line": row.place[0], "column": row.place[1]}
        # JSON has no infinity, which a parameter that is not modeled may be
        value = str(row.value) if isinstance(row.value, float) and not math.isfinite(row.value) else row.value
        parameters.append({**place, "value": value, "status": row.status, "used": row.used, "why": row.why})
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
        "release_differences": [change._asdict() for change in changes_since_jazzy(found.document, kinds)],
        "command_chain": command_chain(found.document, found.left_away),
        "filter_chains": [*filter_chains(found.reader)],
        "nodes_of_jazzy": found.replaced,
        "nodes_of_code": found.absent,
        "nodes_left_away": found.left_away,
    }


def _print(found: "Interpretation", rows: Sequence["Finding"], counts: Mapping[str, int]) -> None:
    from vastflow.flows.terminal.display import printed, terminal_table
    from vastflow.producers.campaign_file.nav2_parameters import short
    from vastflow.producers.model.faults import shown
    from vastflow.sim.nav2.parameter_files.command_chain import command_chain, filter_chains
    from vastflow.sim.nav2.parameter_files.findings import left_out, omitted
    from vastflow.sim.nav2.parameter_files.refusals import refusals
    from vastflow.sim.nav2.parameter_files.releases import changes_since_jazzy, guessed_release
    from vastflow.sim.reading.robot import robot_facts, robot_words

    lines = []
    for row in rows:
        said = f"{row.status}: {row.why}" if row.why else row.status
        if row.status == "differs" and not row.why:
            said = f"differs: {shown(row.used)} is built in"
        elif row.status == "modeled" and row.used != row.value:
            said = f"modeled: {shown(row.used)}"
        lines.append((str(row.place[0]), short(row.path), shown(row.value, 40), said))
    printed([terminal_table((), ("line",), ("parameter", "value", "simulator"), lines), ""])
    for status, count in counts.items():
        print(f"{count:>4}  {status}: {MEANING[status]}")
    for fault in refusals(found):
        print(f"Nav2 does not start: {fault}")
    for path, (what, consequence) in found.reader.warnings.items():
        print(f"warning: {short(path)}: {message_of(what, consequence)}")
    print(f"{len(left_out(found)):>4}  more are modeled, with the defaults of Nav2's code")
    if rows_left_out := omitted(found):
        print("\nleft out, and not in Nav2's code as in Jazzy's file or as built in:")
        printed(
            [
                terminal_table(
                    (),
                    (),
                    ("parameter", "Nav2's code", "in its place", "declared"),
                    [
                        (
                            short(path),
                            shown(declared.default, 40),
                            f"{'Jazzy' if is_used else 'built in'}: {shown(other, 40)}",
                            declared.source,
                        )
                        for path, declared, other, is_used in rows_left_out
                    ],
                ),
                "",
            ]
        )
    if found.replaced:
        print(f"not in the file, as in Nav2 Jazzy's file: {', '.join(found.replaced)}")
    if found.absent:
        print(f"not in the file, as in Nav2's code: {', '.join(found.absent)}")
    if found.left_away:
        print(f"not in the file and not simulated: {', '.join(found.left_away)}")
    release, name = guessed_release(found.document)
    print(f"release: Nav2 {release.title()}, {f'the first with {name!r}' if name else 'as nothing in it is newer'}")
    for change in changes_since_jazzy(found.document, {*found.reader.kinds.values()}):
        print(f"differs: since {change.since.title()} {change.words} ({change.source}), but {change.here} here")
    print(f"commands: {command_chain(found.document, found.left_away)}")
    for chain in filter_chains(found.reader):
        print(f"filter: {chain}")
    print(*robot_words(robot_facts(found.parameters)), sep="\n")
