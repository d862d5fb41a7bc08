"""Compilation of kernels: one portable target, no fast-math, and a cache that can't serve stale code.

numba caches a compiled function by its own source alone, so an edited callee would leave its callers stale.
The cache folder is therefore named by the content of every module that has kernels and of all that these import.
"""

import hashlib
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import llvmlite
import numba
import platformdirs

from vastflow.sim.kernels.numba_target import TARGET, KernelCache

Function = TypeVar("Function", bound=Callable[..., Any])

_HAS_KERNELS: Final = re.compile(
    r"vastflow\.(sim\.kernels\.numeric import|(sim\.kernels\.plug_in|plugins) import (\([^)]*|.*)\bkernel\b)"
)
_IMPORT: Final = re.compile(r"^from (vastflow\.sim[\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)


def kernel_sources() -> list[Path]:
    """Modules with kernels and the modules of `sim` that they import: all sources of compiled code."""
    root = Path(__file__).parents[1]
    text = {module: module.read_text("utf-8") for module in sorted(root.rglob("*.py"))}
    waiting = [module for module in text if _HAS_KERNELS.search(text[module])] + [Path(__file__)]
    found: set[Path] = set()
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += [file for file in _imported(root, text[module]) if file in text]
    return sorted(found)


def _imported(root: Path, text: str) -> Iterator[Path]:
    """Files that a module's imports may refer to: modules, packages, and names in packages."""
    for package, names in _IMPORT.findall(text):
        place = root.joinpath(*package.split(".")[2:])
        for name in ("", *re.findall(r"\w+", names)):
            inner_place = place / name
            yield inner_place.with_suffix(".py")
            yield inner_place / "__init__.py"


def kernel_cache_dir() -> Path:
    """Folder of kernels compiled from this source by this numba and LLVM, wherever the source is.

    Those that check indices (`NUMBA_BOUNDSCHECK=1`) have one of their own: numba does not tell them from others.
    """
    checks = " with checked indices" if numba.config.BOUNDSCHECK else ""
    content = hashlib.sha256(f"{numba.__version__} {llvmlite.__version__}{checks}".encode())
    root = Path(__file__).parents[1]
    for module in kernel_sources():
        content.update(module.relative_to(root).as_posix().encode() + b"\0" + module.read_bytes() + b"\0")
    return Path(platformdirs.user_cache_dir("vastflow")) / "kernels" / content.hexdigest()[:16]


_FOLDER: Final = kernel_cache_dir()

OPTIONS: Final = {"error_model": "numpy", "fastmath": False}
_compile = numba.njit(**OPTIONS, _target=TARGET, no_cfunc_wrapper=True)
_compile_inner = numba.njit(**OPTIONS, _target=TARGET, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def njit(function: Function) -> Function:
    """Compile a kernel that Python calls, or kernels and Python both."""
    return _kept(_compile(function), function)


def inner(function: Function) -> Function:
    """Compile a kernel that is called by kernels only, as part of its callers."""
    dispatcher: Any = _compile_inner(function)
    dispatcher.is_own = dispatcher.is_part = True
    return cast("Function", dispatcher)


def addressed(function: Function) -> Function:
    """Compile a kernel that is called by its address, of vastflow or of a plug-in."""
    return _kept(_compile_inner(function), function)


def _kept(dispatcher: Any, function: Function) -> Function:
    dispatcher.is_own = Path(function.__code__.co_filename).is_relative_to(Path(__file__).parents[1])
    if Path(function.__code__.co_filename).is_file() and function.__closure__ is None:
        dispatcher._cache = KernelCache(function, _FOLDER)
    return cast("Function", dispatcher)
