"""The behaviors of a block's runs in one file: the table of each under the other, behind a column with the run's index.

It is a stream of Arrow's, compressed as a whole. A campaign reads one of these small files for each of its configurations, and one
in parquet's format takes five times as long and twice the room.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vastflow.sim.process.tables import Columns
from vastflow.sim.recordings.archive import arrow_table

RUN_INDEX = "run_index"


def write_behaviors(runs: Mapping[int, Columns]) -> bytes:
    """Tables of equal columns, by run index, as one file; equal tables give equal bytes."""
    table = arrow_table(_stacked(runs))
    stream = pa.BufferOutputStream()
    with pa.ipc.new_stream(stream, table.schema) as writer:
        writer.write_table(table)
    content = stream.getvalue()
    packed: bytes = pa.Codec("zstd").compress(content, asbytes=True)
    return b"%d %b" % (content.size, packed)


def read_behaviors(block: bytes) -> pa.Table:
    """What `write_behaviors` wrote.

    Raises:
        ValueError: it is damaged.
    """
    size, _, content = block.partition(b" ")
    if not size.isdigit():
        raise ValueError("no behaviors as vastflow writes them")
    return pa.ipc.open_stream(pa.Codec("zstd").decompress(content, decompressed_size=int(size))).read_all()


def behaviors_below(blocks: Sequence[bytes], runs: int) -> pa.Table | None:
    """The behaviors of all runs below `runs`, run by run, each once: campaigns may have cut the same runs differently.

    None where no block has any of them.
    """
    parts = []
    seen: set[int] = set()
    for table in map(read_behaviors, blocks):
        index = _index(table)
        parts.append(table.take(_numbers(np.flatnonzero((index < runs) & ~np.isin(index, sorted(seen))))))
        seen.update(index.tolist())
    if not any(part.num_rows for part in parts):
        return None
    whole = pa.concat_tables(parts).combine_chunks()
    return whole.take(_numbers(np.argsort(_index(whole), kind="stable")))


def _stacked(runs: Mapping[int, Columns]) -> Columns:
    names = list(next(iter(runs.values()), {}))
    lengths = [len(next(iter(table.values()), ())) for table in runs.values()]
    index = np.repeat(np.array(list(runs), dtype=np.int64), lengths)
    return {RUN_INDEX: index, **{name: np.concatenate([table[name] for table in runs.values()]) for name in names}}


def _index(table: pa.Table) -> NDArray[np.int64]:
    """The runs of rows; pyarrow's `to_numpy` would import pandas."""
    return np.array(np.from_dlpack(table.column(RUN_INDEX).combine_chunks()), dtype=np.int64)


def _numbers(rows: NDArray[np.int64]) -> pa.Array:
    """Numbers of rows; `pyarrow.array` would import pandas."""
    numbers = np.ascontiguousarray(rows, dtype=np.int64)
    return pa.Array.from_buffers(pa.int64(), len(numbers), [None, pa.py_buffer(numbers)])
