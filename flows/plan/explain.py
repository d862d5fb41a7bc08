"""Explanation of one configuration: its origin, and its due work."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from rich.console import RenderableType
from rich.text import Text

from vastflow.flows.plan.plan import Plan, plan_of, whys
from vastflow.flows.plan.text import UNITS, stages_json, why_json
from vastflow.flows.request.campaign_file import recorded_keys
from vastflow.flows.request.run_request import RunRequest, asked_of
from vastflow.flows.results.inputs import replica
from vastflow.flows.results.past import PARTS, Past, newest_past, past_of, writers, written_scenario
from vastflow.flows.results.provenance import campaign_changes, change_text, value_changes
from vastflow.flows.terminal.display import terminal_table
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.results.executed import KeptFiles, scenario_of_row
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.producers.model.faults import shown
from vastflow.sim.model.faults import FileError
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.reading.checked import checked_digest
from vastflow.tasks.engine.index import ConfigurationRuns, Index, run_blocks
from vastflow.tasks.store.artifact import Stored
from vastflow.tasks.store.store import open_store

FILE: Final = "campaign file"
"""Origin of values that no producer wrote."""


@dataclass(frozen=True)
class Explanation:
    """The full explanation of a configuration.

    Attributes:
        row: Of `configurations.parquet`.
        dimensions: Dimension, or `provenance`, to the `key`, plain `value`, and writer (`by`) of each parameter in it.
        then: Stage to the keys under which the campaign kept its artifacts and the runs that are there now, as `0–4`.
        today: The plan of it from the directory's own inputs; None where that is not possible.
        obstacle: Why it is not.
        earlier: The campaign before, if there is one.
        differences: What is other in its namesake there, a sentence each.
    """

    past: Past
    row: Mapping[str, Any] = field(repr=False)
    dimensions: Mapping[str, Sequence[Mapping[str, Any]]]
    then: Mapping[str, Mapping[str, str]]
    today: Plan | None
    obstacle: str
    earlier: Past | None
    differences: Sequence[str]


def explained(directory: Path, name: str, *, store: str | None = None, since: Path | None = None) -> Explanation:
    """Explain the configuration `name` of a campaign directory.

    Args:
        since: An earlier directory to compare with, else the newest one beside it that is older.

    Raises:
        UnusableDirectory: there is no such configuration, or a directory is damaged.
    """
    past = past_of(directory)
    if name not in past.by_name:
        hint = did_you_mean(name, tuple(past.by_name))
        raise UnusableDirectory(f"{directory}: expected the name of a configuration, got {name!r}; {hint}")
    row, metadata = past.by_name[name], past.metadata
    earlier = newest_past(directory.parent, metadata["name"], metadata["created"]) if since is None else past_of(since)
    with reading(directory):
        scenario = scenario_of_row(row, KeptFiles(directory))
    index = Index(open_store(store, read_only=True), recorded_keys(metadata))
    then = ConfigurationRuns(name, "", 1, scenario, past.runs, row["checked_digest"])
    blocks = index.stored(then)
    today, obstacle = _today(past, row["duplicate_of"] or name, store)
    who, parts = writers(row), written_scenario(row)
    parts = {part: parts[part] for part in PARTS} | {"provenance": json.loads(row["provenance"])}
    return Explanation(
        past=past,
        row=row,
        dimensions={
            part: [{"key": key, "value": value, "by": who.get(key, FILE)} for key, value in values.items()]
            for part, values in parts.items()
        },
        then={
            "execute": {index.keys.recordings(then.checked): _runs(blocks)},
            "observe": {each.trace.key: _runs([each]) for each in blocks if each.trace},
            "judge": {each.verdicts.key: _runs([each]) for each in blocks if each.verdicts},
        },
        today=today,
        obstacle=obstacle,
        earlier=earlier,
        differences=[] if earlier is None else _differences(earlier, past, row),
    )


def _runs(blocks: Sequence[Stored]) -> str:
    """`0–4, 7` for the run indices of blocks."""
    runs = sorted({run for each in blocks for run in range(each.block.start, each.block.stop)})
    spans = run_blocks(runs, len(runs))
    return ", ".join(f"{start}" if stop == start + 1 else f"{start}–{stop - 1}" for start, stop in spans)


def _today(past: Past, name: str, store: str | None) -> tuple[Plan | None, str]:
    """Return the plan of one configuration, or None and a reason."""
    asked = asked_of(past.metadata)
    try:
        with replica(past.directory, asked) as laid_out, TemporaryDirectory(prefix="vastflow-") as environments:
            request = RunRequest(
                campaign=str(laid_out.file),
                runs=asked.fixed_runs,
                store=store,
                only=(name,),
                map_dir=laid_out.map_dir and str(laid_out.map_dir),
                as_v1=asked.as_v1,
            )
            return plan_of(request, Path(environments), past.directory), ""
    except UnusableDirectory as error:
        return None, str(error)
    except FileError as error:
        return None, f"today's producers make no such configuration of the inputs: {error.faults[0].problem}"


def _differences(earlier: Past, past: Past, row: Mapping[str, Any]) -> list[str]:
    """Describe differences from the earlier configuration of the same name and its ingredients."""
    found = []
    namesake = earlier.by_name.get(row["name"])
    if namesake is None:
        same = earlier.by_digest.get(row["scenario_digest"])
        found.append("there is no such configuration" + (f"; {same['name']} has the same scenario" if same else ""))
    else:
        found += [change_text(*change) for change in value_changes(written_scenario(namesake), written_scenario(row))]
    return [*found, *campaign_changes(earlier.metadata, past.metadata)]


def explanation_json(found: Explanation) -> dict[str, Any]:
    """Everything, values as `configurations.parquet` has them."""
    row, today = found.row, None
    if (plan := found.today) is not None:
        (scenario,) = {each.scenario.digest: each.scenario for each in plan.configurations}.values()
        today = {
            "scenario_digest": scenario.digest,
            "execute_key": plan.keys.recordings(checked_digest(scenario)),
            "stages": stages_json(plan),
            "why": why_json(plan),
        }
    return {
        "campaign": found.past.metadata["name"],
        "created": found.past.metadata["created"],
        "configuration": row["name"],
        **{name: row[name] for name in ("family", "duplicate_of", "abstract", "timeout_s", "scenario_digest")},
        "dimensions": found.dimensions,
        "kept": found.then,
        "today": today,
        "obstacle": found.obstacle or None,
        "compared_with": None if found.earlier is None else str(found.earlier.directory),
        "differences": list(found.differences),
    }


def explanation_text(found: Explanation) -> Iterator[RenderableType]:
    """Format an explanation: content, stored artifacts, plan, and comparison."""
    row, metadata = found.row, found.past.metadata
    yield Text(f"{row['name']} of family {row['family']}, {metadata['name']} of {metadata['created']}", "bold")
    if row["duplicate_of"]:
        yield Text(f"has the content of {row['duplicate_of']}, which was run in its stead")
    scenario = terminal_table()
    for part, written in found.dimensions.items():
        for k, each in enumerate(written):
            value = each["value"]
            is_file = isinstance(value, dict) and value.keys() == {"file"}
            said = f"file {value['file']}" if is_file else shown(value, 80)
            scenario.add_row("" if k else part, each["key"], said, each["by"])
    scenario.add_row("scenario", "abstract", row["abstract"], "")
    scenario.add_row("", "timeout", f"{row['timeout_s']:g} s", "")
    scenario.add_row("", "digest", row["scenario_digest"], "")
    yield scenario
    kept = terminal_table()
    for stage, artifacts in found.then.items():
        for key, runs in (artifacts or {"–": ""}).items():
            kept.add_row(stage, f"runs {runs} in the store" if runs else "nothing in the store", key)
    yield from ("", Text("as the campaign computed it:"), kept, "")
    if found.today is None:
        yield Text(f"what a run of it would do today can't be told: {found.obstacle}", "yellow")
    elif due := whys(found.today.steps):
        yield Text("a run of it today, from the inputs in its directory, would compute:")
        for why in due:
            yield Text(f"  {why.stage} {count_text(why.amount, UNITS[why.stage])}: {why}")
    else:
        yield Text("a run of it today would find everything in the store")
    yield ""
    if found.earlier is None:
        yield Text("no earlier campaign of this name beside it", "dim")
        return
    yield Text(f"compared with {found.earlier.directory}:")
    for words in found.differences or ["the same scenario, and computed with the same code on the same numeric class"]:
        yield Text(f"  {words}")
