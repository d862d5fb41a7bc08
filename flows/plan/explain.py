"""An explanation: one configuration of a campaign directory, where it came from and what a run of it would do today."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from vastflow.flows.plan.dry_run import STAGES, DryRun, dry_run
from vastflow.flows.request.asked import asked_of
from vastflow.flows.request.campaign_keys import recorded_keys
from vastflow.flows.results.differences import change_text, value_changes
from vastflow.flows.results.ingredients import changes, has_ingredients, stage_ingredients
from vastflow.flows.results.past import PARTS, Past, newest_past, past_of, recorded_as, writers, written_scenario
from vastflow.flows.results.replica import replica
from vastflow.oracles.directory.executed import KeptFiles, executed_scenario
from vastflow.oracles.directory.unusable import UnusableDirectory, reading
from vastflow.producers.model.faults import CampaignError
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.index import Index, Member
from vastflow.tasks.store import open_store
from vastflow.tasks.stored import Stored

FILE: Final = "campaign file"
"""Who wrote what no producer did."""


@dataclass(frozen=True, slots=True)
class Written:
    """A key of a configuration: its plain value, and who wrote it."""

    key: str
    value: Any
    by: str


@dataclass(frozen=True)
class Explanation:
    """All there is to say of a configuration.

    Attributes:
        row: Of `configurations.parquet`.
        dimensions: Dimension, or `provenance`, to what was written in it.
        then: Stage to the keys under which the campaign kept its artifacts and the runs that are there now; None where
            an earlier version wrote the directory.
        today: A dry run of it from the directory's own inputs; None where that is not possible.
        obstacle: Why it is not.
        earlier: The campaign before, if there is one.
        differences: What is other in its namesake there, a sentence each.
    """

    past: Past
    row: Mapping[str, Any] = field(repr=False)
    dimensions: Mapping[str, Sequence[Written]]
    then: Mapping[str, Mapping[str, str]] | None
    today: DryRun | None
    obstacle: str
    earlier: Past | None
    differences: Sequence[str]


def explained(directory: Path, name: str, *, store: str | None = None, since: Path | None = None) -> Explanation:
    """Explain the configuration `name` of a campaign directory.

    Args:
        since: An earlier directory to compare with, else the newest one beside it that is older.

    Raises:
        UnusableDirectory: there is no such configuration, or a directory is damaged.
        StoreError: the store can't be used.
    """
    past = past_of(directory)
    if name not in past.by_name:
        names = tuple(past.by_name)
        raise UnusableDirectory(f"{directory}: no configuration {name!r}; {did_you_mean(name, names)}")
    row = past.by_name[name]
    metadata = past.metadata
    earlier = newest_past(directory.parent, metadata["name"], metadata["created"]) if since is None else past_of(since)
    scenario = _scenario(directory, row)
    keys = recorded_keys(metadata)
    today, obstacle = _today(past, row["duplicate_of"] or name, store)
    return Explanation(
        past=past,
        row=row,
        dimensions=_dimensions(row),
        then=None
        if keys is None
        else kept(
            Index(open_store(store, read_only=True), keys), Member(name, "", 1, scenario, past.runs, recorded_as(row))
        ),
        today=today,
        obstacle=obstacle,
        earlier=earlier,
        differences=[] if earlier is None else _differences(earlier, past, row),
    )


def kept(index: Index, member: Member) -> dict[str, dict[str, str]]:
    """Stage to the key of each artifact of a member that is in the store and its runs, as `0–4`."""
    blocks = index.stored(member)
    return {"execute": {index.keys.recordings(member.checked): _runs(blocks)}, **_later(blocks)}


def _later(blocks: Sequence[Stored]) -> dict[str, dict[str, str]]:
    return {
        "observe": {each.trace.key: _runs([each]) for each in blocks if each.trace},
        "judge": {each.verdicts.key: _runs([each]) for each in blocks if each.verdicts},
    }


def _runs(blocks: Sequence[Stored]) -> str:
    """`0–4, 7` for run indices of blocks in order."""
    spans: list[tuple[int, int]] = []
    for each in blocks:
        first, last = each.block.start, each.block.stop - 1
        if spans and spans[-1][1] >= first - 1:
            first, _ = spans.pop()
        spans.append((first, last))
    return ", ".join(str(first) if first == last else f"{first}–{last}" for first, last in spans)


def _scenario(directory: Path, row: Mapping[str, Any]) -> Scenario:
    with reading(directory):
        abstract = json.loads(row["abstract"]) if row["abstract"].startswith("{") else row["abstract"]
        return executed_scenario(abstract, row["timeout_s"], json.loads(row["scenario"]), KeptFiles(directory))


def _dimensions(row: Mapping[str, Any]) -> dict[str, list[Written]]:
    who, parts = writers(row), written_scenario(row)
    parts = {part: parts[part] for part in PARTS} | {"provenance": json.loads(row["provenance"])}
    return {
        part: [Written(key, value, who.get(key, FILE)) for key, value in values.items()]
        for part, values in parts.items()
    }


def _today(past: Past, name: str, store: str | None) -> tuple[DryRun | None, str]:
    """What a run of one configuration would do, and why that can't be told."""
    asked = asked_of(past.metadata)
    try:
        with replica(past.directory, asked) as laid_out:
            found = dry_run(
                laid_out.file,
                runs=asked.fixed_runs,
                store=store,
                only=[name],
                map_dir=laid_out.map_dir,
                as_v1=asked.as_v1,
                since=past.directory,
            )
            return found, ""
    except UnusableDirectory as error:
        return None, str(error)
    except CampaignError as error:
        return None, f"today's producers make no such configuration of the inputs: {error.faults[0].what}"


def _differences(earlier: Past, past: Past, row: Mapping[str, Any]) -> list[str]:
    """What is other in the earlier campaign's configuration of the same name, and in what it was computed with."""
    found = []
    namesake = earlier.by_name.get(row["name"])
    if namesake is None:
        same = earlier.by_digest.get(row["scenario_digest"])
        found.append("there is no such configuration" + (f"; {same['name']} has the same scenario" if same else ""))
    else:
        found += [change_text(*change) for change in value_changes(written_scenario(namesake), written_scenario(row))]
    if not has_ingredients(earlier.metadata) or not has_ingredients(past.metadata):
        return [*found, "an earlier version wrote one of both: what else they follow from is not known"]
    reasons = (
        changes(stage_ingredients(earlier.metadata, stage), stage_ingredients(past.metadata, stage)) for stage in STAGES
    )
    return [*found, *dict.fromkeys(str(reason) for some in reasons for reason in some)]
