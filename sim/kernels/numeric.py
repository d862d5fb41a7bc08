"""How kernels are compiled: one portable target, no fast-math, and a cache that can't serve stale code.

numba caches a compiled function by its own source alone, so an edited callee would leave its callers stale.
The cache folder is therefore named by the content of every module that has kernels and of all that these import.
"""

import hashlib
import importlib
import os
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, TypeVar

import numba
import platformdirs
from llvmlite import binding
from numba.core import config

from vastflow.sim.kernels.kernel_cache import KernelCache


def _import_without_blas() -> None:
    """Import Numba's array functions, which look for SciPy's BLAS: 0.3 s of a worker's start that no kernel here needs."""
    if "scipy.linalg" in sys.modules:
        return
    sys.modules["scipy.linalg"] = None  # type: ignore[assignment]  # what is None there can't be imported
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        del sys.modules["scipy.linalg"]


_import_without_blas()

Function = TypeVar("Function", bound=Callable[..., Any])


_IMPORT: Final = re.compile(r"^from (vastflow\.sim[\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)


def kernel_sources() -> list[Path]:
    """Modules with kernels, and those of `sim` that they import, directly or not: all that compiled code can follow from."""
    root = Path(__file__).parents[1]
    text = {module: module.read_text("utf-8") for module in sorted(root.rglob("*.py"))}
    waiting = [module for module in text if "vastflow.sim.kernels.numeric import" in text[module]] + [Path(__file__)]
    found: set[Path] = set()
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += [file for file in _imported(root, text[module]) if file in text]
    return sorted(found)


def _imported(root: Path, text: str) -> Iterator[Path]:
    """Files that the imports of a module may mean: a module, a package, and what is imported from one."""
    for package, names in _IMPORT.findall(text):
        place = root.joinpath(*package.split(".")[2:])
        for name in ("", *re.findall(r"\w+", names)):
            inner_place = place / name
            yield inner_place.with_suffix(".py")
            yield inner_place / "__init__.py"


def kernel_cache_dir() -> Path:
    """Folder of compiled kernels for exactly this source of theirs and this numba."""
    content = hashlib.sha256(numba.__version__.encode())
    root = Path(__file__).parents[1]
    for module in kernel_sources():
        content.update(module.relative_to(root).as_posix().encode() + b"\0" + module.read_bytes() + b"\0")
    return Path(platformdirs.user_cache_dir("vastflow")) / "kernels" / content.hexdigest()[:16]


def processor_features() -> str:
    """What kernels use of the processor beyond its architecture's minimum: AVX2 where there is one.

    Wider registers change no bit of a result, since nothing is reordered and nothing fused (FMA stays off). numba's own
    variable `NUMBA_CPU_FEATURES` takes precedence.
    """
    given = os.environ.get("NUMBA_CPU_FEATURES")
    if given is not None:
        return given
    return "+avx2" if binding.get_host_cpu_features().get("avx2") else ""


# Code for a generic processor gives the same bits on every host of an architecture (measured).
config.CPU_NAME = "generic"
config.CPU_FEATURES = processor_features()
config.CACHE_DIR = str(kernel_cache_dir())
# LLVM's third level costs a fifth more compile time and gains nothing here (measured).
config.OPT = config._OptLevel("2")

OPTIONS: Final = {"error_model": "numpy", "fastmath": False}
_compile = numba.njit(**OPTIONS)
_compile_inner = numba.njit(**OPTIONS, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def njit(function: Function) -> Function:
    """Compile a kernel that Python calls, or kernels and Python both."""
    return _cached(_compile(function), function)


def inner(function: Function) -> Function:
    """Compile a kernel that only kernels call; without Python's entry it compiles in about half the time."""
    return _cached(_compile_inner(function), function)


def _cached(compiled: Any, function: Function) -> Function:
    """A dispatcher whose compiled forms are kept, as numba's option `cache` would have it."""
    compiled._cache = KernelCache(function)
    dispatcher: Function = compiled
    return dispatcher
