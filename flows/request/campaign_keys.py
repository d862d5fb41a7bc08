"""A campaign's keys, from the installed code or from a campaign directory."""

from collections.abc import Mapping, Sequence
from typing import Any

from vastflow.oracles.judgement.oracle import Oracle
from vastflow.sim.model.digest import FileContent, Value, digest
from vastflow.tasks.engine.evaluation import content_of
from vastflow.tasks.keys.keys import EXECUTE_SOURCE, JUDGE_SOURCE, OBSERVE_SOURCE, Keys, numeric_class
from vastflow.tasks.keys.source import SourceTree


def campaign_keys(tree: SourceTree, seed: int, oracles: Sequence[Oracle[Any]]) -> Keys:
    """Keys of the artifacts that this process would compute.

    Args:
        seed: `execution.seed`.
    """
    sources = tree.files()  # before they are read: what is edited in between is found out, too
    judge_source = [tree.digest(*JUDGE_SOURCE), *(tree.plug_in_digest(type(oracle)) for oracle in oracles)]
    return Keys(
        numeric=numeric_class(),
        execute_source=tree.digest(*EXECUTE_SOURCE),
        observe_source=tree.digest(*OBSERVE_SOURCE),
        judge_source=digest(judge_source),
        seed=seed,
        oracles=[[oracle.name, content_of(oracle.parameters)] for oracle in oracles],
        sources=sources,
    )


def recorded_keys(metadata: Mapping[str, Any]) -> Keys:
    """Keys of the artifacts that a campaign directory was made of.

    Args:
        metadata: Its `metadata.json`.

    Raises:
        KeyError: it does not say.
    """
    source = metadata["source"]
    return Keys(
        numeric=metadata["numeric_class"],
        execute_source=source["execute"],
        observe_source=source["observe"],
        judge_source=source["judge"],
        seed=metadata["seed"],
        oracles=[[oracle["name"], recorded_value(oracle["parameters"])] for oracle in metadata["oracles"]],
    )


def recorded_value(plain: Any) -> Value:
    """A value from JSON as a campaign directory has it: `{"file": digest}` is a file, wherever it lies now."""
    if isinstance(plain, Mapping):
        if plain.keys() == {"file"}:
            return FileContent("", str(plain["file"]))
        return {key: recorded_value(item) for key, item in plain.items()}
    if isinstance(plain, list):
        return [recorded_value(item) for item in plain]
    value: Value = plain
    return value
