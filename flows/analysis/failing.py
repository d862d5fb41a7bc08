"""The failing configuration of a campaign directory that is minimized."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow.compute as pc

from vastflow.flows.results.rows import FAULT
from vastflow.oracles.results.executed import KeptFiles, scenario_of_row
from vastflow.oracles.results.schema import read_columns, table_rows
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.producers.minimization.circumstance import Subject
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.faults import UserError, message_of
from vastflow.sim.model.files import read_bytes, read_json, yaml_value
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.plug_ins.loading import check_permitted
from vastflow.sim.system.keys import FILE_KEY, MASK_KEYS
from vastflow.sim.system.system import system_of
from vastflow.sim.world.environment import GROUND_KEYS, MAP_KEY

MESH_KEY = "mesh_file"
"""Ignored by runs, see `vastflow.producers.instantiation.family`."""


class NotMinimized(UserError, ValueError):
    """A configuration that can't be minimized, since it does not fail."""


@dataclass(frozen=True)
class Failing:
    """A failing configuration.

    Attributes:
        name: Its name, or that of its original if it is a duplicate.
        oracle: The oracle whose failures count.
        subject: The scenario, with files in the campaign directory.
        campaign: The data of the campaign file.
        places: See `vastflow.flows.request.run_request.Asked`.
        assumed: Keys of the subject that neither the campaign nor its parameter file contains.
    """

    directory: Path
    name: str
    oracle: str
    subject: Subject = field(repr=False)
    campaign: Mapping[str, Any] = field(repr=False)
    places: Mapping[str, str] = field(repr=False)
    start_check: str
    assumed: frozenset[str] = frozenset()


def failing_configuration(directory: Path, name: str, oracle: str | None, rate: float) -> Failing:
    """Read a configuration that `oracle`, or else its most frequent failing oracle, fails at `rate` or more.

    Raises:
        NotMinimized: it does not exist, was rejected or excluded, broke, or passes.
        UnusableDirectory: the directory is damaged.
    """
    with reading(directory):
        rows = {row["name"]: row for row in table_rows(directory / "configurations.parquet")}
        if name not in rows:
            raise _missing(directory, name, list(rows))
        row = rows[rows[name]["duplicate_of"] or name]
        chosen = _failing_oracle(directory, row["name"], oracle, rate)
        content = read_bytes(directory / "campaign.vast")
        check_permitted(directory / "campaign.vast", hashlib.sha256(content).hexdigest())
        campaign = yaml_value(content.decode("utf-8-sig"))
        families = {str(each.get("name")): each for each in campaign.get("configuration") or ()}
        metadata = read_json(directory / "metadata.json")
        scenario = scenario_of_row(row, KeptFiles(directory, plug_ins=True))
        return Failing(
            directory,
            row["name"],
            chosen,
            _subject(f"{directory}: {row['name']}", scenario),
            campaign,
            metadata.get("asked", {}).get("places", {}),
            str(families.get(row["family"], {}).get("start_check", "footprint")),
            system_of(scenario.system).assumed_keys(),
        )


def _missing(directory: Path, name: str, known: list[str]) -> NotMinimized:
    gone = {
        row["parent"]: f"which was rejected: {row['reason']}" for row in table_rows(directory / "rejections.parquet")
    }
    for row in table_rows(directory / "exclusions.parquet"):
        gone.setdefault(row["name"], f"which the constraint {row['constraint']} excludes")
    if name in gone:
        return NotMinimized(f"{directory}: expected a configuration that fails, got {name}, {gone[name]}")
    hint = did_you_mean(name, known, "it has none")
    return NotMinimized(f"{directory}: {message_of(f'unknown configuration {name!r}', hint)}")


def _failing_oracle(directory: Path, name: str, oracle: str | None, rate: float) -> str:
    table = read_columns(directory / "verdicts.parquet")
    rows = table.filter(pc.equal(table.column("configuration"), name)).to_pylist()
    said: dict[str, list[str]] = {}
    for row in rows:
        said.setdefault(row["oracle"], []).append(row["judgment"])
    if oracle is not None and oracle not in said:
        hint = did_you_mean(oracle, list(said))
        raise NotMinimized(f"--oracle: {message_of(f'no oracle {oracle!r} judged {name}', hint)}")
    judged = {each: [what for what in of if what != "not judged"] for each, of in said.items()}
    rates = {each: of.count("fail") / len(of) for each, of in judged.items() if of and oracle in (None, each)}
    worst = max(rates, key=lambda each: rates[each], default="")
    if rates.get(worst, -1.0) >= rate:
        return worst
    lacking = [row["reason"] for row in rows if row["judgment"] == "not judged" and oracle in (None, row["oracle"])]
    if not rates or any(why.startswith(FAULT) for why in lacking):
        why = next((why for why in lacking if why.startswith(FAULT)), "")
        broke = f"runs of {name} broke: {why}" if why else f"no run of {name} is judged: {(*lacking, 'it has none')[0]}"
        raise NotMinimized(f"{directory}: expected a configuration that fails, but {broke}")
    by = f" by {worst}" if oracle or len(rates) > 1 else ""
    failed, runs = judged[worst].count("fail"), len(judged[worst])
    what = f"expected a failure rate of {rate:g} or more, got {failed} of {runs} runs{by}"
    raise NotMinimized(f"{directory}: {name}: {what}. Give --rate or another configuration.")


def _subject(place: str, scenario: Scenario) -> Subject:
    parts = {
        "environment": scenario.environment,
        "task": scenario.task,
        "system": system_of(scenario.system).spelled_out(),
    }
    values = {key: value for part in parts.values() for key, value in part.items() if key != MESH_KEY}
    kept = (*GROUND_KEYS, FILE_KEY, *MASK_KEYS)
    files = [key for key, value in values.items() if isinstance(value, FileContent) and key not in kept]
    if files or MAP_KEY not in values:
        what = f"its value of {files[0]} is a file" if files else "it has no map and thus no robot"
        raise UnusableDirectory(f"{place} can't be minimized: {what}")
    return Subject(values, {key: part for part, of in parts.items() for key in of})  # type: ignore[misc]
