"""Compiled kernels in files that are checked before they are used: a damaged one is removed and compiled again.

numba takes its cache as it is: an emptied file, as a power cut leaves it, raises in every process, and changed machine code
would run. It also keeps all caches in one folder, that of `numba.config.CACHE_DIR`, which is the user's to choose.
"""

import functools
import hashlib
import inspect
import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import Any, Final

from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    _CacheLocator,
    _SourceFileBackedLocatorMixin,
)

LOGGER: Final = logging.getLogger("vastflow.kernels")

_CHECKSUM_BYTES: Final = hashlib.sha256().digest_size


class KernelCache(FunctionCache):  # type: ignore[misc]  # numba has no types
    """A kernel's compiled forms, each file with a checksum behind its content.

    Args:
        function: The kernel as Python has it.
        folder: Where compiled kernels lie; made when there is one to keep.
    """

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._impl_class = functools.partial(_Kernel, folder=folder)
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = _CheckedFile(self._cache_path, self._impl.filename_base, locator.get_source_stamp())

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled for a signature; where that is impossible, every process compiles its own."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _log_that_nothing_is_kept(self._cache_path, error.strerror)


@functools.cache
def _log_that_nothing_is_kept(folder: str, reason: str) -> None:
    """Once for a folder, not for each of its hundreds of kernels."""
    LOGGER.warning("can't write to %r (%s): every process compiles the kernels again", folder, reason)


class _Kernel(CompileResultCacheImpl):  # type: ignore[misc]
    """What numba asks of a cached function, its place given instead of looked for."""

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        file = inspect.getfile(function)
        self._lineno = function.__code__.co_firstlineno
        self._locator = _Place(file, self._lineno, folder)
        self._filename_base = self.get_filename_base(f"{Path(file).stem}.{function.__qualname__}", sys.abiflags)


class _Place(_SourceFileBackedLocatorMixin, _CacheLocator):  # type: ignore[misc]
    """Below the folder of kernels, by the folder and line of the source, which must be the same as when it was compiled."""

    def __init__(self, file: str, line: int, folder: Path) -> None:
        self._py_file = file
        self._lineno = line
        self._folder = folder / self.get_suitable_cache_subpath(file)

    def get_cache_path(self) -> str:
        return str(self._folder)


class _CheckedFile(IndexDataCacheFile):  # type: ignore[misc]
    """numba's index and data files. Both are read as pickles, which end before the checksum."""

    def load(self, key: Any) -> Any:
        """What was compiled for `key`; None where there is nothing or it is damaged."""
        if not _is_sound(Path(self._index_path)):
            return None
        name = self._load_index().get(key)
        if name is None or not _is_sound(Path(self._data_path(name))):
            return None
        return super().load(key)

    def save(self, key: Any, data: Any) -> None:
        """Keep what was compiled for `key`."""
        _is_sound(Path(self._index_path))  # else it is gone, and a new one is begun
        super().save(key, data)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BytesIO]:
        content = BytesIO()
        yield content
        with super()._open_for_write(filepath) as file:
            file.write(content.getvalue() + hashlib.sha256(content.getvalue()).digest())


def _is_sound(file: Path) -> bool:
    """Whether a file is there and whole; one damaged file removes all that are damaged in its folder, with a line in the log."""
    if not file.exists() or _is_whole(file):
        return file.exists()
    damaged = [each for each in sorted(file.parent.glob("*.nb[ic]")) if not _is_whole(each)]
    for each in damaged:
        each.unlink(missing_ok=True)
    LOGGER.warning("%s: compiled kernels are damaged (files: %d) and compiled again", file.parent, len(damaged))
    return False


def _is_whole(file: Path) -> bool:
    """Whether a file ends with the checksum of what is before it; one that another process removed does no harm."""
    with suppress(FileNotFoundError):
        content = file.read_bytes()
        return hashlib.sha256(content[:-_CHECKSUM_BYTES]).digest() == content[-_CHECKSUM_BYTES:]
    return True
