"""Damages of campaign directories that somebody hands in: files of another kind, and content that no campaign writes."""

import copy
import json
import os
import random
import shutil
import socket
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, TypeAlias

import pyarrow as pa
import pyarrow.parquet as pq

Damage: TypeAlias = Callable[[Path], None]
"""Changes a file, or what is in its place."""

DEEP: Final = 100_000
_HUGE: Final = 10**400


def of_another_kind(file: Path, kind: str) -> None:
    """Put something else than a regular file in its place."""
    if file.is_dir() and not file.is_symlink():
        shutil.rmtree(file)
    else:
        file.unlink(missing_ok=True)
    match kind:
        case "pipe":
            os.mkfifo(file)
        case "folder":
            file.mkdir()
        case "socket":
            with socket.socket(socket.AF_UNIX) as made:
                here = os.getcwd()
                os.chdir(file.parent)  # a socket's path has a hundred characters at most
                try:
                    made.bind(file.name)
                finally:
                    os.chdir(here)
        case "loop":
            file.symlink_to(file.name)
        case _:
            file.symlink_to(kind)


KINDS: Final = ("pipe", "folder", "socket", "loop", "/dev/zero", "/proc/kmsg", "/proc/kcore", "/etc/passwd", "nowhere")

DEEP_TEXTS: Final = ("[" * DEEP, '{"a":' * DEEP, "[" * 900 + "]" * 900, '{"a":' * 900 + "1" + "}" * 900)
TEXTS: Final = (
    *DEEP_TEXTS,
    *("", "\0", "null", "[]", "{}", "[1, 2]", '"x"', "NaN", "Infinity", '{"a": NaN}', '{"a": 1, "a": {"b": [1]}}', '"\\ud800"'),
    *("9" * 5000, '{"name": 1e400}', "[" + "1," * 1000 + "1]", '{"x": {"value": NaN, "unit": "m"}}', '{"x": 1}', "[[[]]]", "}], [{"),
    *('{"x": {"value": "a", "unit": 3}}', '{"x": {"value": 1e999, "unit": "\\ud800"}}', '{"x": {"value": 1, "unit": "m", "y": 2}}'),
    *('{"x": [1]}', '{"environment": 1, "task": [], "system": null}', '{"\\ud800": {"value": 1.0, "unit": ""}}', "x" * 200_000),
    *('{"passed": {"value": 1, "unit": "m"}}', '{"x": {"value": ' + "9" * 400 + ', "unit": "m"}}', '{"x": {"value": true, "unit": null}}'),
    *('{"environment": {}, "task": {}, "system": {}}', '{"environment": {"map_file": "/etc/passwd"}, "task": {}, "system": {}}'),
)  # fmt: skip
"""Texts in place of those that a table has."""

VALUES: Final[tuple[Any, ...]] = (
    *(None, True, -1, _HUGE, 1e308, float("nan"), float("inf"), "", "\ud800", "\0", "x" * 10_000, [], {}, [[]], {"a": {"b": [None]}}),
    *(["\ud800"], {"passed": _HUGE, "failed": _HUGE, "not_judged": 0}, {"\ud800": 1}, "2026-11-20T06:00:00", 9**99, -(2**63), 2**31),
)  # fmt: skip
"""Values in place of those that `metadata.json` or an event has."""


def with_values(file: Path, rng: random.Random) -> None:
    """Put strange values into a JSON file's mapping, at any depth."""
    whole = {"": json.loads(file.read_text())}
    for _ in range(rng.choice((1, 1, 2, 5))):
        holder: Any = whole
        key: Any = ""
        while isinstance(holder[key], dict | list) and holder[key] and (holder is whole or rng.random() < 0.7):
            holder = holder[key]
            key = rng.choice([*holder]) if isinstance(holder, dict) else rng.randrange(len(holder))
        if holder is not whole or rng.random() < 0.1:
            holder[key] = copy.deepcopy(rng.choice(VALUES))
    file.write_text(json.dumps(whole[""]))


ROWS: Final[Mapping[str, Callable[[], pa.Array]]] = {
    "numbers": lambda: pa.array([-1.5]),
    "nan": lambda: pa.array([float("nan")]),
    "negative": lambda: pa.array([-1], pa.int32()),
    "least": lambda: pa.array([-(2**63)]),
    "greatest": lambda: pa.array([2**63 - 1]),
    "many": lambda: pa.array([2**31 - 1], pa.int32()),
    "nothing": lambda: pa.nulls(1),
    "bytes": lambda: pa.array([b"\xff\xfe"]),
    "truth": lambda: pa.array([True]),
    "mappings": lambda: pa.array([{"a": {"b": [1]}}]),
    "lists": lambda: pa.array([[["x"]]]),
    "times": lambda: pa.array([datetime(2026, 11, 20, tzinfo=UTC)]),
    "decimals": lambda: pa.array([1]).cast(pa.decimal128(38, 2)),
    "dictionaries": lambda: pa.array(["x"]).dictionary_encode(),
    "nested dictionaries": lambda: pa.StructArray.from_arrays([pa.array(["x"]).dictionary_encode()], ["a"]),
    "pairs": lambda: pa.array([[("a", 1)]], pa.map_(pa.string(), pa.int64())),
    "long texts": lambda: pa.array(["x" * 1_000_000]),
    "no UTF-8": lambda: pa.Array.from_buffers(
        pa.string(), 1, [None, pa.py_buffer(b"\0\0\0\0\2\0\0\0"), pa.py_buffer(b"\xff\xfe")]
    ),
}
"""A value in place of those that a column has, by its type."""


def column_changed(file: Path, rng: random.Random) -> None:
    """Change, leave out, double, or rename a column of a table, or change its rows."""
    table = pq.ParquetFile(file).read()
    k = rng.randrange(table.num_columns)
    name, column = table.column_names[k], table.column(k)
    match rng.randrange(8):
        case 0:
            table = table.remove_column(k)
        case 1:
            table = table.append_column(name, column)
        case 2:
            table = table.rename_columns([rng.choice(("\0", "", "é", "x.y", "passed")), *table.column_names[1:]])
        case 3 | 4 if pa.types.is_string(column.type) and len(table):
            texts = column.to_pylist()
            some = range(len(texts)) if rng.random() < 0.3 else [rng.randrange(len(texts))]
            text = rng.choice(TEXTS)
            table = table.set_column(
                k, name, pa.array([text if row in some else each for row, each in enumerate(texts)])
            )
        case 5:
            table = pa.concat_tables([table, table] if rng.random() < 0.5 else [table.slice(1), table.slice(0, 1)])
        case 6:
            table = table.slice(0, rng.choice((0, 1)))
        case _:
            value = rng.choice([*ROWS.values()])()
            table = table.set_column(k, name, value.take(pa.array([0] * len(table), pa.int64())))
    pq.write_table(table, file)


def many_rows(file: Path, rows: int) -> None:
    """Write a small file of as many rows, all alike."""
    table = pq.ParquetFile(file).read()
    few = min(rows, 1_000_000)
    first = table.slice(0, 1).take(pa.array([0] * few, pa.int64()))
    with pq.ParquetWriter(file, table.schema, compression="zstd") as writer:
        for _ in range(rows // few):
            writer.write_table(first)


def lines_of(rows: Iterable[Mapping[str, Any]]) -> bytes:
    """The events of rows, at one time if they have none."""
    return b"".join(json.dumps({"at": "2026-11-21T06:00:00+00:00", **row}).encode() + b"\n" for row in rows)


BEGAN: Final = {"event": "began", "name": "office"}
FAMILY: Final = {"family": "room", "configurations": 1, "runs": 8, "passed": 3, "failed": 1, "not_judged": 0}
PROGRESS: Final = {"event": "progress", "phase": "running", "runs_done": 4, "runs_total": 8, "families": [FAMILY]}
EVENTS: Final[Sequence[bytes]] = (
    *(text.encode() + b"\n" for text in DEEP_TEXTS),
    *(lines_of([BEGAN]) + text.encode() + b"\n" for text in DEEP_TEXTS),
    lines_of([{**BEGAN, "at": _HUGE}]),
    lines_of([{**BEGAN, "name": {"a": []}}, {"event": "ended", "reason": _HUGE}]),
    lines_of([BEGAN, {**PROGRESS, "families": [{**FAMILY, "passed": _HUGE}]}, {"event": "stopped", "reason": "x"}]),
    lines_of([BEGAN, {**PROGRESS, "families": [{**FAMILY, "passed": -1, "failed": 1}]}, {"event": "stopped"}]),
    lines_of([BEGAN, {**PROGRESS, "families": [{**FAMILY, "runs": "x", "configurations": [1]}]}, {"event": "ended"}]),
    lines_of([BEGAN, {**PROGRESS, "runs_total": float("nan"), "runs_done": _HUGE}, {"event": "stopped", "reason": "\ud800"}]),
    lines_of([BEGAN, {**PROGRESS, "runs_total": "8", "at_most": []}, {"event": "stopped", "reason": []}]),
    lines_of([BEGAN, {"event": "verdicts", "configuration": "x", "judgment": "fail", "reason": None, "runs": [1e999, "a", None]}]),
    lines_of([BEGAN, {"event": "fault", "run_index": [], "configuration": {}, "stage": _HUGE, "error": "\ud800"}]),
    lines_of([{**BEGAN, "at": "9999-12-31T23:59:59+00:00"}, {**PROGRESS, "at": "0001-01-01T00:00:00+23:59"}]),
    b"\0" * 1_000_000,
    b"\xff\xfe\n" * 1000,
    b'"' + b"x" * 20_000_000,
    lines_of([BEGAN]) * 20_000,
)  # fmt: skip
"""Contents of `events.jsonl`, some without an end."""
