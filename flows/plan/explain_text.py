"""An explanation in JSON and for people."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from vastflow.flows.plan.dry_run import STAGES
from vastflow.flows.plan.dry_run_text import UNITS, whys
from vastflow.flows.plan.explain import Explanation
from vastflow.flows.terminal.table import terminal_table
from vastflow.flows.terminal.words import count_text
from vastflow.producers.model.faults import shown
from vastflow.sim.reading.checked import checked_digest


def explanation_json(found: Explanation) -> dict[str, Any]:
    """Everything, values as `configurations.parquet` has them."""
    row = found.row
    return {
        "campaign": found.past.metadata["name"],
        "created": found.past.metadata["created"],
        "configuration": row["name"],
        "family": row["family"],
        "duplicate_of": row["duplicate_of"],
        "abstract": row["abstract"],
        "timeout_s": row["timeout_s"],
        "scenario_digest": row["scenario_digest"],
        "dimensions": {part: [asdict(each) for each in written] for part, written in found.dimensions.items()},
        "kept": found.then,
        "today": found.today and _today_json(found),
        "obstacle": found.obstacle or None,
        "compared_with": None if found.earlier is None else str(found.earlier.directory),
        "differences": list(found.differences),
    }


def _today_json(found: Explanation) -> dict[str, Any]:
    today = found.today
    assert today is not None
    (configuration,) = {each.scenario.digest for each in today.configurations}
    (checked,) = {checked_digest(each.scenario) for each in today.configurations}
    return {
        "scenario_digest": configuration,
        "execute_key": today.keys.recordings(checked),
        "stages": {stage: {"reused": today.found(stage), "computed": today.computed(stage)} for stage in STAGES},
        "why": [{"stage": why.stage, "kind": why.kind, "reason": str(why)} for why in whys(today.due)],
    }


def explanation_text(found: Explanation) -> Iterator[RenderableType]:
    """The same in the order in which one asks: what it is, where it is, what would happen, what was before."""
    row, metadata = found.row, found.past.metadata
    yield Text(f"{row['name']} of family {row['family']}, {metadata['name']} of {metadata['created']}", "bold")
    if row["duplicate_of"]:
        yield Text(f"has the content of {row['duplicate_of']}, which was run in its stead")
    yield from _scenario(found)
    yield ""
    yield from _kept(found)
    yield ""
    yield from _today(found)
    yield ""
    if found.earlier is None:
        yield Text("no earlier campaign of this name beside it", "dim")
        return
    yield Text(f"compared with {found.earlier.directory}:")
    for words in found.differences or ["the same scenario, and computed with the same code on the same numeric class"]:
        yield Text(f"  {words}")


def _scenario(found: Explanation) -> Iterator[RenderableType]:
    table = terminal_table()
    for part, written in found.dimensions.items():
        for k, each in enumerate(written):
            table.add_row("" if k else part, each.key, _short(each.value), each.by)
    table.add_row("scenario", "abstract", found.row["abstract"], "")
    table.add_row("", "timeout", f"{found.row['timeout_s']:g} s", "")
    table.add_row("", "digest", found.row["scenario_digest"], "")
    yield table


def _kept(found: Explanation) -> Iterator[RenderableType]:
    if found.then is None:
        yield Text(
            "an earlier version wrote the directory: it does not say under which keys the results were kept", "dim"
        )
        return
    table = terminal_table()
    for stage, kept in found.then.items():
        for key, runs in (kept or {"–": ""}).items():
            table.add_row(stage, f"runs {runs} in the store" if runs else "nothing in the store", key)
    yield Text("as the campaign computed it:")
    yield table


def _today(found: Explanation) -> Iterator[RenderableType]:
    if found.today is None:
        yield Text(f"what a run of it would do today can't be told: {found.obstacle}", "yellow")
        return
    due = whys(found.today.due)
    if not due:
        yield Text("a run of it today would find everything in the store")
        return
    yield Text("a run of it today, from the inputs in its directory, would compute:")
    for why in due:
        yield Text(f"  {why.stage} {count_text(why.amount, UNITS[why.stage])}: {why}")


def _short(value: Any) -> str:
    if isinstance(value, dict) and value.keys() == {"file"}:
        return f"file {value['file']}"
    return shown(value, 80)
