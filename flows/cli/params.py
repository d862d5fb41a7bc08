"""The command `params`: which parameters of a Nav2 file the simulator uses."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from vastflow.flows.terminal.options import AsJson
from vastflow.sim.model.faults import message_of

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
    from vastflow.sim.system.system import system_kind

    account = system_kind().account(file)
    if as_json:
        rows = [{**row, "value": _finite(row["value"])} for row in account["parameters"]]
        print(json.dumps({**account, "parameters": rows}))
    else:
        _print(account)


def _finite(value: Any) -> Any:
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _print(account: Mapping[str, Any]) -> None:
    from vastflow.flows.terminal.display import print_rows, terminal_table
    from vastflow.sim.system.facts import RobotFact, robot_words

    rows = [_row(row) for row in account["parameters"]]
    print_rows([terminal_table((), ("line",), ("parameter", "value", "simulator"), rows), ""])
    for status, meaning in MEANING.items():
        print(f"{account['counts'][status]:>4}  {status}: {meaning}")
    for fault in account["refused"]:
        print(f"Nav2 does not start: {fault}")
    for path, said in account["warnings"].items():
        print(f"warning: {_short(path)}: {message_of(*said)}")
    print(f"{len(account['left_out']):>4}  more are modeled, with the defaults of Nav2's code")
    if account["omitted"]:
        print("\nleft out, and not in Nav2's code as in Jazzy's file or as built in:")
        titles = "parameter", "Nav2's code", "in its place", "declared"
        print_rows([terminal_table((), (), titles, [*_omitted(account["omitted"])]), ""])
    for key, words in (
        ("nodes_of_jazzy", "not in the file, as in Nav2 Jazzy's file"),
        ("nodes_of_code", "not in the file, as in Nav2's code"),
        ("nodes_left_away", "not in the file and not simulated"),
    ):
        if account[key]:
            print(f"{words}: {', '.join(account[key])}")
    name = account["nav2_release_by"]
    why = f"the first with {name!r}" if name else "as nothing in it is newer"
    print(f"release: Nav2 {account['nav2_release'].title()}, {why}")
    for change in account["release_differences"]:
        print(
            f"differs: since {change['since'].title()} {change['words']} ({change['source']}), but {change['here']} here"
        )
    print(f"commands: {account['command_chain']}")
    for chain in account["filter_chains"]:
        print(f"filter: {chain}")
    print(*robot_words(RobotFact(**fact) for fact in account["robot_facts"]), sep="\n")


def _row(row: Mapping[str, Any]) -> Sequence[str]:
    from vastflow.producers.model.faults import shown

    status, value, used, why = row["status"], row["value"], row["used"], row["why"]
    said = f"{status}: {why}" if why else status
    if status == "differs" and not why:
        said = f"differs: {shown(used)} is built in"
    elif status == "modeled" and used != value:
        said = f"modeled: {shown(used)}"
    return str(row["line"]), _short(row["path"]), shown(value, 40), said


def _omitted(rows: Iterable[Mapping[str, Any]]) -> Iterator[Sequence[str]]:
    from vastflow.producers.model.faults import shown

    for row in rows:
        ((words, other),) = [(words, row[key]) for key, words in _IN_PLACE if key in row]
        yield _short(row["path"]), shown(row["value"], 40), f"{words}: {shown(other, 40)}", row["source"]


_IN_PLACE: Final = (("jazzy", "Jazzy"), ("built_in", "built in"))


def _short(path: str) -> str:
    """Return a parameter's path without `ros__parameters`, as campaign files may have it for a key."""
    return ".".join(name for name in path.split(".") if name != "ros__parameters")
