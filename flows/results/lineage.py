"""The lineage of a run's verdicts: all that they follow from, back to the campaign file."""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from vastflow.flows.request.campaign_file import recorded_keys, recorded_value
from vastflow.flows.request.run_request import SEARCH
from vastflow.flows.results.past import values_of
from vastflow.flows.results.provenance import few, short_text
from vastflow.oracles.results.executed import configuration_row
from vastflow.oracles.results.schema import rows_of
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.digest import file_digest
from vastflow.sim.model.files import read_json
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.store import Artifact, Store

_DIGITS: Final = 12
_MOST_KEYS: Final = 6
_RUN: Final = ("seed", "outcome", "simulated_s")


@dataclass(frozen=True, slots=True)
class LineageStep:
    """A step of a lineage.

    Attributes:
        step: `judge`, `observe`, `execute`, `scenario`, `instantiate`, or `campaign`.
        key: Key of its artifact; for a scenario or the campaign file its digest. None where it is not known, as it follows from an
            artifact that the store lacks, or the directory does not say it.
        is_stored: Whether the store has the artifact; None for a step without one, or without a known key.
        facts: JSON values.
    """

    step: str
    key: str | None
    is_stored: bool | None
    facts: Mapping[str, Any]

    def as_json(self) -> dict[str, Any]:
        """Return the step as JSON values."""
        return {"step": self.step, "key": self.key, "in_store": self.is_stored, **self.facts}


def lineage_of(directory: Path, configuration: str, run_index: int, store: Store) -> list[LineageStep]:
    """Return the steps from the verdicts on a run back to the campaign file.

    Raises:
        UnusableDirectory: there is no such configuration or run, or the directory is damaged.
        StoreError: the store can't be read.
    """
    with reading(directory):
        metadata, row = read_json(directory / "metadata.json"), configuration_row(directory, configuration)
        name, checked, family = row["duplicate_of"] or configuration, row["checked_digest"], row["family"]
        judged = rows_of(directory / "verdicts.parquet", "configuration", name).to_pylist()
        verdicts = [each for each in judged if each["run_index"] == run_index]
        if not verdicts:
            known = dict.fromkeys(str(each["run_index"]) for each in judged)
            raise UnusableDirectory(f"{directory}: no run {run_index} of {configuration}. It has {few([*known], 8)}")
        keys = recorded_keys(metadata)
        recording = _recording(store, keys, checked, run_index)
        trace_key = keys.trace(checked, recording.content) if recording else None
        trace = store.find(trace_key) if trace_key else None
        source, verdicts_key = metadata["source"], None
        if recording and trace and "oracles" in source:  # else all oracles had one key, which nothing here makes
            verdicts_key = keys.verdicts(checked, recording.content, trace.content)
        oracles = {each["name"]: each for each in metadata["oracles"]}
        said = [
            {key: verdict[key] for key in ("oracle", "judgment", "reason")} | _plug_in(oracles[verdict["oracle"]])
            for verdict in verdicts
        ]
        runs = rows_of(directory / "runs.parquet", "configuration", name).to_pylist()
        run = {key: each[key] for each in runs if each["run_index"] == run_index for key in _RUN}
        robots = [each["summary"] for each in metadata["robots"] if family in each["families"]]
        recorded = {"configuration": name, "run_index": run_index, **run, "robot": robots[0] if robots else None}
        recorded |= {"world": row["environment"], "numeric_class": metadata["numeric_class"]}
        campaign = directory / "campaign.vast"
        asked = {"file": metadata["asked"]["file"], "name": metadata["name"], "created": metadata["created"]}
        return [
            _step("judge", verdicts_key, store, {"source": source["judge"], "oracles": said}),
            _step("observe", trace_key, store, {"source": source["observe"]}),
            _step(
                "execute",
                recording.key if recording else keys.recordings(checked),
                store,
                {"source": source["execute"], **recorded},
            ),
            LineageStep("scenario", row["scenario_digest"], None, {"family": family, "checked": checked}),
            *_producers(metadata, row, keys, store),
            LineageStep("campaign", file_digest(campaign), None, {**asked, "seed": metadata["seed"]}),
        ]


def _recording(store: Store, keys: Keys, checked: str, run_index: int) -> Artifact | None:
    home = keys.recordings(checked)
    spans = ((name, *name.partition("-")) for name in store.under(home))
    there = (
        store.find(f"{home}/{name}")
        for name, start, _, stop in spans
        if start.isdigit() and stop.isdigit() and int(start) <= run_index < int(stop)
    )
    return next(filter(None, there), None)


def _step(step: str, key: str | None, store: Store, facts: Mapping[str, Any]) -> LineageStep:
    return LineageStep(step, key, None if key is None else store.find(key) is not None, facts)


def _plug_in(row: Mapping[str, Any]) -> dict[str, Any]:
    return {"parameters": row["parameters"], "source": row["source"]}


def _producers(metadata: Mapping[str, Any], row: Mapping[str, Any], keys: Keys, store: Store) -> Iterator[LineageStep]:
    """Yield a step for each producer, the last first; the values that later ones wrote over are left out."""
    values, steps = values_of(row), json.loads(row["steps"])
    last = {key: k for k, step in enumerate(steps) for key in step["keys"]}
    # A search's producers are those of its file: a point has other parameters.
    producers = [{}] * len(steps) if SEARCH in metadata else metadata["producers"][row["family"]]
    for k, (step, producer) in reversed([*enumerate(zip(steps, producers, strict=True))]):
        wrote = {key: values.get(key) for key in step["keys"] if last[key] == k}
        facts = {"producer": step["producer"], "choice": step["choice"], "wrote": wrote}
        key = None
        if "evaluation_source" in producer and step.get("inputs"):
            content = recorded_value(producer["parameters"])
            key = keys.evaluation(producer["evaluation_source"], producer["name"], content, step["inputs"])
        yield _step("instantiate", key, store, facts | (_plug_in(producer) if producer else {}))


def lineage_text(steps: Iterable[LineageStep]) -> Iterator[tuple[str, str, str]]:
    """Yield step, whether it is in the store, and its key or a fact, for a terminal."""
    there = {True: "in the store", False: "not in the store", None: ""}
    steps = [*steps]
    is_traced = any(each.step == "observe" and each.is_stored for each in steps)
    for each in steps:
        is_untold = each.step == "instantiate" or (each.step == "judge" and is_traced)
        unknown = f"key unknown{'' if is_untold else ', as it follows from what the store lacks'}"
        yield each.step, there[each.is_stored], each.key or unknown
        for words in _words(each):
            yield "", "", words


def _words(step: LineageStep) -> Iterator[str]:
    facts = step.facts
    if step.step == "judge":
        for each in facts["oracles"]:
            said = f"{each['oracle']}: {each['judgment']}"
            yield f"{said}{', ' + each['reason'] if each['reason'] else ''} ({_of(each)})"
    if step.step == "execute":
        ended = f"{facts['outcome']} after {facts['simulated_s']:g} s" if "outcome" in facts else "not recorded"
        yield f"run {facts['run_index']} of {facts['configuration']}, seed {facts.get('seed', 'unknown')}: {ended}"
        yield from (f"{name}: {facts[name]}" for name in ("robot", "world") if facts[name])
    if step.step == "instantiate":
        made_by = f" ({_of(facts)})" if "source" in facts else ""
        yield f"{facts['producer']}, choice {facts['choice']}{made_by}"
        yield few([f"{key} = {short_text(value)}" for key, value in facts["wrote"].items()], _MOST_KEYS)
    if step.step == "campaign":
        yield f"{facts['file']}, {facts['name']} of {facts['created']}, execution.seed {facts['seed']}"
    if "source" in facts and step.step != "instantiate":
        yield f"source of {step.step} {facts['source'][:_DIGITS]}"


def _of(plug_in: Mapping[str, Any]) -> str:
    words = [f"{key}: {short_text(value)}" for key, value in plug_in["parameters"].items()]
    return "; ".join([*words, f"source {plug_in['source'][:_DIGITS]}"])
