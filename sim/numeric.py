"""How kernels are compiled: one portable target, no fast-math, and a cache that can't serve stale code.

numba caches a compiled function by its own source alone, so an edited callee would leave its callers stale.
The cache folder is therefore named by the content of every module of `sim`.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs
from numba.core import config

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel_cache_dir() -> Path:
    """Folder of compiled kernels for exactly this source of `sim` and this numba."""
    content = hashlib.sha256(numba.__version__.encode())
    root = Path(__file__).parent
    for module in sorted(root.rglob("*.py")):
        content.update(module.relative_to(root).as_posix().encode() + b"\0" + module.read_bytes() + b"\0")
    return Path(platformdirs.user_cache_dir("vastflow")) / "kernels" / content.hexdigest()[:16]


# Generic code gives the same bits on every host of an architecture, at the same speed (measured).
config.CPU_NAME = "generic"
config.CPU_FEATURES = ""
config.CACHE_DIR = str(kernel_cache_dir())
# LLVM's third level costs a fifth more compile time and gains nothing here (measured).
config.OPT = config._OptLevel("2")

_options = {"cache": True, "error_model": "numpy", "fastmath": False}
_compile = numba.njit(**_options)
_compile_inner = numba.njit(**_options, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def njit(function: Function) -> Function:
    """Compile a kernel that Python calls, or kernels and Python both."""
    compiled: Function = _compile(function)
    return compiled


def inner(function: Function) -> Function:
    """Compile a kernel that only kernels call; without Python's entry it compiles in about half the time."""
    compiled: Function = _compile_inner(function)
    return compiled
