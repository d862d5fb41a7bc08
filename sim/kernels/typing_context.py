"""What numba knows of types while it compiles kernels, with a memory: it asks for the same call many times over.

Types of a function's variables are inferred in rounds, and each round asks again what `float64 + float64` gives.
"""

from types import BuiltinFunctionType
from typing import Any

from numba.core import types, typing
from numba.core.targetconfig import ConfigStack
from numba.extending import models, register_model


class _Function(types.Function):
    """One of Python's own functions as numba knows it by now, which remembers what calls of it gave.

    Once an extension adds to it (`numba.extending.overload`), numba makes another of it, which remembers nothing.
    """

    _impl_keys: dict[Any, Any]

    def __init__(self, template: Any) -> None:
        super().__init__(template)
        self._signatures: dict[Any, Any] = {}

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """The signature of a call. An error is not remembered."""
        if kws:
            return super().get_call_type(context, args, kws)
        # What numba compiles for a call may follow from how its caller is compiled.
        key = tuple(args), context.flags(), context
        if key not in self._signatures:
            found = super().get_call_type(context, args, kws)
            self._signatures[key] = found, self.get_impl_key(found)
        found, implementation = self._signatures[key]
        self._impl_keys[found.args] = implementation
        return found


register_model(_Function)(models.OpaqueModel)


class TypingContext(typing.Context):  # type: ignore[misc]  # numba has no types
    """numba's typing context, with a memory for Python's operators and the like, which numba knows under their names."""

    def __init__(self) -> None:
        self._remembering: dict[Any, _Function] = {}
        self._flags: Any = None
        self._summary = ""
        super().__init__()

    def resolve_value_type(self, val: Any) -> Any:
        """The type of a constant; of one of Python's functions without asking first whether it is a number or an array."""
        found = self._remembering_type(val)
        return super().resolve_value_type(val) if found is None else found

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """The signature of a call. numba names operators by Python's functions."""
        found = self._remembering_type(func)
        plain = found is None or func in self._functions
        return super().resolve_function_type(func if plain else found, args, kws)

    def _remembering_type(self, function: Any) -> _Function | None:
        """Of what numba knows a function of Python's own to be by now; nothing of what it doesn't know, and of all else."""
        known = self._lookup_global(function) if isinstance(function, BuiltinFunctionType) else None
        if type(known) is not types.Function:
            return None
        if known not in self._remembering:
            self._remembering[known] = _Function(known.templates)
        return self._remembering[known]

    def flags(self) -> str:
        """Options of the function that is compiled at the moment, those that are not numba's defaults."""
        flags = ConfigStack.top_or_none()
        if flags is not self._flags:
            self._flags, self._summary = flags, flags.summary() if flags else ""
        return self._summary
