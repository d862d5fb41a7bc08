"""The content of a plug-in's kernel: all that its compiled form follows from, besides vastflow's own kernels."""

import hashlib
from collections.abc import Callable, Iterator
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any, Final

import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher

_VERSIONED: Final = frozenset({"builtins", "math", "numba", "numpy"})
"""Modules whose functions numba compiles in forms of its own."""


class _Unknown(Exception):
    """A kernel uses a value whose content can't be told."""


def content_of(function: Callable[..., Any]) -> str | None:
    """Digest of a function's code and of what it takes from its module, as numba freezes it.

    None if it takes something else, which could change without a trace.
    """
    try:
        return hashlib.sha256("\n".join(_function(function, set())).encode("utf-8", "surrogatepass")).hexdigest()
    except _Unknown:
        return None


def spelled(kind: Any) -> str:
    """A type of numba with the module and fields of its NamedTuples, which numba's own name leaves out."""
    if isinstance(kind, types.BaseTuple):
        fields = (*_class(kind.instance_class), *kind.fields) if isinstance(kind, types.BaseNamedTuple) else ()
        return f"{fields}({', '.join(map(spelled, kind))})"
    return str(kind)


def _function(function: Any, seen: set[Any]) -> Iterator[str]:
    if function in seen:
        return
    seen.add(function)
    if function.__closure__ is not None:
        raise _Unknown
    names = _names(function.__code__)
    yield from _code(function.__code__)
    yield from _value(function.__defaults__, names, seen)
    for name in names:
        if name in function.__globals__:
            yield name
            yield from _value(function.__globals__[name], names, seen)


def _value(value: Any, names: list[str], seen: set[Any]) -> Iterator[str]:
    if isinstance(value, Dispatcher):
        if not getattr(value, "is_own", False):  # vastflow's are in the name of the folder
            yield repr(sorted(value.targetoptions.items(), key=str))
            yield from _function(value.py_func, seen)
    elif isinstance(value, FunctionType):
        yield from _function(value, seen)
    elif isinstance(value, ModuleType):
        if value.__name__.partition(".")[0] not in _VERSIONED:
            for name in (name for name in names if hasattr(value, name)):
                yield f"{value.__name__}.{name}"
                yield from _value(getattr(value, name), names, seen)
    elif isinstance(value, bool | int | float | complex | str | bytes | None):
        yield f"{type(value).__name__} {value!r}"
    elif isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        yield f"{value.dtype} {np.shape(value)} {hashlib.sha256(value.tobytes()).hexdigest()}"
    elif isinstance(value, tuple):
        yield f"{_class(type(value))} {len(value)}"
        for each in value:
            yield from _value(each, names, seen)
    elif isinstance(value, type):
        yield f"{_class(value)} {getattr(value, '_fields', ())}"
    elif isinstance(value, BuiltinFunctionType | np.ufunc):
        yield repr(value.__name__)
    else:
        raise _Unknown


def _class(kind: type) -> tuple[str, str]:
    return kind.__module__, kind.__qualname__


def _names(code: CodeType) -> list[str]:
    inner = (name for constant in code.co_consts if isinstance(constant, CodeType) for name in _names(constant))
    return list(dict.fromkeys((*code.co_names, *inner)))


def _code(code: CodeType) -> Iterator[str]:
    yield repr((code.co_code, code.co_varnames, code.co_names, code.co_argcount, code.co_flags, list(code.co_lines())))
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant)
        else:
            yield repr(sorted(map(repr, constant)) if isinstance(constant, frozenset) else constant)
