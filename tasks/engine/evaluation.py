"""Evaluations of producers as artifacts: their keys, and fragments and rejections as bytes."""

import dataclasses
import json
import math
import pickle
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel
from pydantic_core import to_jsonable_python

from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.producer import Producer
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.plug_ins.loading import module_of, snapshot_behind
from vastflow.sim.plug_ins.snapshot import Snapshot
from vastflow.tasks.keys.keys import EVALUATE_SOURCE, Keys
from vastflow.tasks.keys.source import SourceTree
from vastflow.tasks.store.store import Lost

FRAGMENTS: Final = "fragments.json"


@dataclass(frozen=True, slots=True)
class PackedProducer:
    """A producer on its way to a worker, where the snapshots of plug-ins are opened first."""

    plug_ins: tuple[Snapshot, ...]
    pickled: bytes

    def unpacked(self) -> Producer[Any]:
        for snapshot in self.plug_ins:
            module_of(snapshot)
        producer: Producer[Any] = pickle.loads(self.pickled)
        return producer


def packed(producer: Producer[Any]) -> PackedProducer:
    """Pack a producer for a worker."""
    snapshots = (snapshot_behind(type(each)) for each in (producer, *producers_in(producer.parameters)))
    plug_ins = {snapshot.digest: snapshot for snapshot in filter(None, snapshots)}
    return PackedProducer(tuple(plug_ins.values()), pickle.dumps(producer))


def evaluation_keys(
    keys: Keys, tree: SourceTree, producer: Producer[Any], inputs: Mapping[str, Mapping[str, Value]]
) -> dict[str, str]:
    """Return the key of the evaluation for each digest of a restricted input."""
    source, parameters = evaluation_source(tree, producer), content_of(producer.parameters)
    return {digest: keys.evaluation(source, type(producer).__name__, parameters, digest) for digest in inputs}


def evaluation_source(tree: SourceTree, producer: Producer[Any]) -> str:
    """Return the source digests of a producer and those in its parameters, as they are in keys of evaluations."""
    kinds = dict.fromkeys(type(each) for each in (producer, *producers_in(producer.parameters)))
    return "".join([tree.digest(*EVALUATE_SOURCE), *map(tree.plug_in_digest, kinds)])


def content_of(value: object) -> Value:
    """Return a parameter model or any value in it by content: files by digest, producers by name and parameters.

    A mapping whose keys are not sorted is a list of its items, as the order may count for a plug-in.
    """
    if value is None or isinstance(value, bool | int | float | str | FileContent):
        return value
    if isinstance(value, Producer):
        return {type(value).__name__: content_of(value.parameters)}
    if isinstance(value, BaseModel):
        return {name: content_of(getattr(value, name)) for name in type(value).model_fields}
    if dataclasses.is_dataclass(value):
        return {field.name: content_of(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        items = {str(key): content_of(item) for key, item in value.items()}
        return items if list(items) == sorted(items) else [{key: item} for key, item in items.items()]
    if isinstance(value, Sequence):
        return [content_of(item) for item in value]
    return content_of(to_jsonable_python(value))


def parts_of(value: object) -> Iterator[object]:
    """Yield a parameter model or any value, and all that is in it at any depth."""
    yield value
    parts: Iterable[object] = ()
    if value is None or isinstance(value, bool | int | float | str | bytes | FileContent):
        return
    if isinstance(value, Mapping):
        parts = value.values()
    elif isinstance(value, Sequence):
        parts = value
    elif isinstance(value, Producer):
        parts = (value.parameters,)
    elif isinstance(value, BaseModel):
        parts = (getattr(value, name) for name in type(value).model_fields)
    elif dataclasses.is_dataclass(value):
        parts = (getattr(value, field.name) for field in dataclasses.fields(value))
    for part in parts:
        yield from parts_of(part)


def producers_in(value: object) -> Iterator[Producer[Any]]:
    """Yield every producer in a parameter model, at any depth."""
    return (part for part in parts_of(value) if isinstance(part, Producer))


def write_evaluation(results: Sequence[Fragment | Rejection]) -> bytes:
    """Write fragments and rejections in order; numbers come back bit for bit."""
    rows = [
        {"values": _written(result.values)}
        if isinstance(result, Fragment)
        else {"reason": result.reason, "requested": _written(result.requested)}
        for result in results
    ]
    return json.dumps(rows, separators=(",", ":")).encode()


def read_evaluation(content: bytes, files: Mapping[str, str]) -> list[Fragment | Rejection]:
    """Read fragments and rejections.

    Args:
        files: Digest to the path of this campaign's file, as the evaluation may be another campaign's.

    Raises:
        Lost: a file is neither in `files` nor in its old place.
    """
    return [
        Fragment(_read(row["values"], files))
        if "values" in row
        else Rejection(row["reason"], _read(row["requested"], files))
        for row in json.loads(content)
    ]


def files_in(*values: object) -> dict[str, str]:
    """Return digest to path of every file in values or parameter models."""
    return {part.digest: part.path for part in parts_of(values) if isinstance(part, FileContent)}


def _written(value: Value) -> Any:
    if isinstance(value, FileContent):
        return {"file": [value.path, value.digest]}
    if isinstance(value, Mapping):
        return {"map": {key: _written(item) for key, item in value.items()}}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_written(item) for item in value]
    if isinstance(value, float) and math.isnan(value):
        raise ValueError("expected a number, got NaN")
    return value


def _read(written: Any, files: Mapping[str, str]) -> Any:
    if isinstance(written, list):
        return [_read(item, files) for item in written]
    if isinstance(written, dict) and "map" in written:
        return {key: _read(item, files) for key, item in written["map"].items()}
    if isinstance(written, dict):
        path, digest = written["file"]
        path = files.get(digest, path)
        if not Path(path).exists():
            raise Lost(f"file {path} of an evaluation is gone")
        return FileContent(path, digest)
    return written
