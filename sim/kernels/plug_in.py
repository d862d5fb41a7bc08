"""Decorator of plug-ins in the loop, and errors of a broken contract.

It needs no numba, so that parameters can be read without it.
"""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from vastflow.sim.plug_ins.loading import snapshot_behind

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile a function as the simulator's own kernels are: for the same processor, with IEEE arithmetic, once for all processes."""
    from vastflow.sim.kernels.numeric import addressed  # who only reads parameters does without numba

    return addressed(function)


class ContractError(ValueError):
    """A plug-in broke its contract; the message gives the place, the behavior, and the expected one."""


def line_of(code: Any) -> str:
    """Return `file:line` of a class or function; of a plug-in, where its author has it."""
    try:
        file, line = str(inspect.getsourcefile(code)), inspect.getsourcelines(code)[1]
    except (OSError, TypeError):
        return str(getattr(code, "__module__", code))
    return f"{written_file(code, file)}:{line}"


def written_file(code: Any, file: str) -> str:
    """Return the author's path of an executed file: a plug-in runs from a copy."""
    snapshot = snapshot_behind(code)
    if snapshot is not None and Path(file).is_relative_to(snapshot.folder):
        return str(snapshot.origin / Path(file).relative_to(snapshot.folder))
    return file
