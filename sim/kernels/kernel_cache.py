"""Compiled kernels in files that are checked before they are used: a damaged one is removed and compiled again.

numba takes its cache as it is: an emptied file, as a power cut leaves it, raises in every process, and changed machine code
would run. Its index of a kernel's files has a path in it, so that every clone and environment would compile its own, and loses
what two processes write at the same time. Here a file is found by its name alone, which follows from what is in it, and lies
where all installations of a user look.
"""

import functools
import hashlib
import inspect
import logging
import os
import pickle
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any, Final

from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    _CacheLocator,
    _SourceFileBackedLocatorMixin,
)
from numba.core.serialize import dumps

LOGGER: Final = logging.getLogger("vastflow.kernels")

_CHECKSUM_BYTES: Final = hashlib.sha256().digest_size
_OWN: Final = Path(__file__).parents[1]


class KernelCache(FunctionCache):  # type: ignore[misc]  # numba has no types
    """A kernel's compiled forms, each in a file with a checksum behind its content.

    Args:
        function: The kernel as Python has it.
        folder: Where compiled kernels lie; made when there is one to keep.
    """

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._impl_class = functools.partial(_Kernel, folder=folder)
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = _Files(Path(self._cache_path), self._impl.filename_base, locator.get_source_stamp())

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
    """Below the folder of kernels: a module of the simulator's by its package, wherever that lies, another by its path."""

    def __init__(self, file: str, line: int, folder: Path) -> None:
        self._py_file = file
        self._lineno = line
        own = Path(file).is_relative_to(_OWN)
        inner_folder = Path(file).parent.relative_to(_OWN) if own else self.get_suitable_cache_subpath(file)
        self._folder = folder / inner_folder

    def get_cache_path(self) -> str:
        return str(self._folder)


class _Files:
    """A kernel's files, one for each compiled form, named by the types and the processor that it is for.

    A file is two pickles, what it was compiled from and for, and what came of it; then the checksum of both.

    Args:
        stamp: Of the kernel's source.
    """

    def __init__(self, folder: Path, name: str, stamp: Any) -> None:
        self._folder = folder
        self._name = name
        self._stamp = stamp

    def load(self, key: Any) -> Any:
        """What was compiled for `key`; None where there is nothing, or it is damaged or of another source."""
        content = _sound(self._file(key))
        if content is None:
            return None
        pickles = BytesIO(content)
        return pickle.load(pickles) if pickle.load(pickles) == (self._stamp, key) else None

    def save(self, key: Any, data: Any) -> None:
        """Keep what was compiled for `key`."""
        content = dumps((self._stamp, key)) + dumps(data)
        with tempfile.NamedTemporaryFile(dir=self._folder, delete=False) as file:
            try:
                file.write(content + hashlib.sha256(content).digest())
                file.close()
                os.replace(file.name, self._file(key))
            except BaseException:
                os.unlink(file.name)
                raise

    def _file(self, key: Any) -> Path:
        return self._folder / f"{self._name}.{hashlib.sha256(str(key).encode()).hexdigest()[:16]}.nbc"


def _sound(file: Path) -> bytes | None:
    """A file's content before its checksum; one damaged file removes all that are damaged in its folder, with a line in the log."""
    content = _content(file)
    if content is None or _is_whole(content):
        return content and content[:-_CHECKSUM_BYTES]
    damaged = [each for each in sorted(file.parent.glob("*.nbc")) if not _is_whole(_content(each))]
    for each in damaged:
        each.unlink(missing_ok=True)
    LOGGER.warning("%s: compiled kernels are damaged (files: %d) and compiled again", file.parent, len(damaged))
    return None


def _content(file: Path) -> bytes | None:
    with suppress(FileNotFoundError, NotADirectoryError):
        return file.read_bytes()
    return None


def _is_whole(content: bytes | None) -> bool:
    """Whether a file's content ends with the checksum of what is before it; a file that another process removed does no harm."""
    return content is None or hashlib.sha256(content[:-_CHECKSUM_BYTES]).digest() == content[-_CHECKSUM_BYTES:]
