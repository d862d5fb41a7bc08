"""The files that a campaign directory has of each configuration, copied from the store as they are where that is right."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Final

from vastflow.flows.request.members import Runs, runs_of
from vastflow.flows.results.found import Found, one_block
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.archive import one_archive

FOLDERS: Final = ("recordings", "traces")

_AHEAD: Final = 4
"""How many configurations a thread may be ahead: so many are in memory at a time."""


def written(
    place: Path,
    configurations: Iterable[Configuration],
    found: Callable[[Configuration], Found],
    runs: Runs,
    threads: int,
) -> Iterator[tuple[Configuration, Found]]:
    """Write the files of configurations into a campaign directory; gives each, in order, once its files are there.

    Args:
        found: What was found of a configuration; called from any thread.
        runs: Of each.
        threads: How many read at a time.
    """
    for folder in FOLDERS:
        (place / folder).mkdir()

    def write(configuration: Configuration) -> tuple[Configuration, Found]:
        result = found(configuration)
        _write(place, configuration.name, result, runs_of(runs, configuration.name))
        return configuration, result

    if threads == 1:
        yield from map(write, configurations)
        return
    waiting: deque[Future[tuple[Configuration, Found]]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        try:
            for configuration in configurations:
                waiting.append(pool.submit(write, configuration))
                if len(waiting) > threads * _AHEAD:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for each in waiting:
                each.cancel()


def _write(place: Path, name: str, found: Found, runs: int) -> None:
    _write_file(f"{place}/recordings/{name}.parquet", _one(found, found.recordings, one_block, runs))
    _write_file(f"{place}/traces/{name}.parquet", _one(found, found.traces, one_block, runs))
    if outputs := _one(found, found.outputs, one_archive, runs):
        (place / "outputs").mkdir(exist_ok=True)
        _write_file(f"{place}/outputs/{name}.zip", outputs)


def _one(found: Found, blocks: Sequence[bytes], join: Callable[[Sequence[bytes], int], bytes], runs: int) -> bytes:
    return blocks[0] if found.exact and len(blocks) == 1 else join(blocks, runs)


def _write_file(path: str, content: bytes) -> None:
    if content:
        with open(path, "wb", buffering=0) as file:  # pathlib and a buffer take as long as the file system
            file.write(content)
