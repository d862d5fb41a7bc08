"""The seam between the loop and plug-ins: machine code that is called by its address.

The loop is compiled once for all plug-ins. A plug-in's kernels are compiled for its own parameters and memory, which
the loop knows nothing of: it passes the address of a table that says where they lie, and an entry, compiled for the same types,
reads the table and calls the kernel. A call costs some nanoseconds more than one that the compiler could see through.
"""

import functools
import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, Generic, NamedTuple, TypeVar

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic, models, register_model
from numpy.typing import NDArray

from vastflow.sim.kernels.content import spelled
from vastflow.sim.kernels.numeric import addressed
from vastflow.sim.kernels.plug_in import ContractError, line_of
from vastflow.sim.kernels.record import record_of
from vastflow.sim.model.parameter import ParameterGroup

_PARAMETERS, _MAIN, _MEMORY = 0, 1, 4
"""Places in a table: addresses of the parameters and of up to three kernels, and from `_MEMORY` on each array's address and shape."""

PlugIn = TypeVar("PlugIn", bound=ParameterGroup)


class Bound(NamedTuple):
    """A plug-in as the loop has it."""

    entries: Any  # (K,) int64, addresses of the entries of its kernels.
    table: Any  # (T,) int64, what the entries find the plug-in's kernels, parameters and memory by.


@dataclass(frozen=True, eq=False)
class Running(Generic[PlugIn]):
    """A plug-in for one run. It owns the memory that `bound` points to and must outlive its kernels."""

    plug_in: PlugIn
    parameters: NDArray[np.void]  # (1,) record of its parameters.
    memory: Any  # What its `memory` made.
    bound: Bound


class Seam:
    """The kernels of a kind of plug-in: the main one (parameters, memory, given), and optional others (memory).

    Args:
        main: Name of the main kernel.
        given: Type of its last argument.
        returns: Whether it may return a type; `wanted` says in words what it must return.
        entries: Functions by kernel name that call `forwarding(...)`: the main one with (layout, given), the others with (layout).
    """

    def __init__(
        self, main: str, given: Any, returns: Callable[[Any], bool], wanted: str, **entries: Callable[..., Any]
    ) -> None:
        self._main, self._given, self._returns, self._wanted, self._entries = main, given, returns, wanted, entries
        self._compiled: dict[Any, tuple[list[int], list[int]]] = {}

    def running(self, plug_in: PlugIn, memory: Any) -> Running[PlugIn]:
        """Return a plug-in with the memory of one run, its kernels compiled.

        Raises:
            ContractError: the memory holds something else than arrays, or a kernel can't be compiled or does not return what
                it should.
        """
        kind, parameters = type(plug_in), record_of(plug_in)
        arrays = list(_arrays(kind, memory, "memory"))
        # Numba takes a millisecond to type a memory, and more to find what it has compiled.
        types_of_arrays = tuple((array.dtype, array.ndim, array.flags.writeable) for array in arrays)
        key = kind, parameters.dtype, _structure(memory), types_of_arrays
        if key not in self._compiled:
            self._compiled[key] = self._machine_code(kind, numba.typeof(parameters).dtype, numba.typeof(memory))
        kernels, entries = self._compiled[key]
        places = [number for array in arrays for number in (array.ctypes.data, *array.shape)]
        unused = [0] * (_MEMORY - _MAIN - len(kernels))
        table = np.array([parameters.ctypes.data, *kernels, *unused, *places], dtype=np.int64)
        return Running(plug_in, parameters, memory, Bound(np.array(entries, dtype=np.int64), table))

    def _machine_code(self, kind: type[ParameterGroup], parameters: Any, memory: Any) -> tuple[list[int], list[int]]:
        """Return addresses of a plug-in's kernels, and of the entries for its types."""
        arguments = {name: (memory,) for name in self._entries} | {self._main: (parameters, memory, self._given)}
        kernels = [self._kernel(kind, name, arguments[name]) for name in self._entries]
        layout = Layout(parameters, memory, kernels[0].signature.return_type)
        given = {self._main: (self._given,)}
        entries = [
            _compiled_for(_compiler(entry), (layout, *given.get(name, ()))) for name, entry in self._entries.items()
        ]
        return list(map(_address_of, kernels)), list(map(_address_of, entries))

    def _kernel(self, kind: type[ParameterGroup], name: str, arguments: tuple[Any, ...]) -> Any:
        """Return a kernel of a plug-in, compiled; raises `ContractError` if it can't be, or returns another type."""
        kernel, is_main = getattr(kind, name, None), name == self._main
        if kernel is None and not is_main:
            kernel = _change_nothing
        where = f"{line_of(getattr(kernel, 'py_func', kind))}: {kind.__name__}.{name}"
        if not isinstance(kernel, Dispatcher):
            raise ContractError(f"{where} is not compiled. Decorate it with @kernel.")
        if getattr(kernel, "is_part", False):
            raise ContractError(f"{where} is compiled for its callers alone. Decorate it with @kernel.")
        try:
            compiled = _compiled_for(kernel, arguments)
        except Exception as error:  # noqa: BLE001 - numba raises more than its own errors, KeyError for an unknown parameter
            words = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise ContractError(f"{where} can't be compiled: {words}") from None
        found = compiled.signature.return_type
        if not (self._returns(found) if is_main else found == types.none):
            raise ContractError(f"{where} must return {self._wanted if is_main else 'nothing'}, got {found}")
        return compiled


_compiler = functools.cache(addressed)


def _structure(memory: Any) -> Any:
    return (type(memory), *map(_structure, memory)) if isinstance(memory, tuple) else None


_WORD: Final = ir.IntType(64)


class Layout(types.Type):  # type: ignore[misc]  # numba has no types
    """Address of a table of a plug-in, typed by its parameters, memory, and main kernel's result."""

    def __init__(self, parameters: Any, memory: Any, result: Any) -> None:
        self.parameters = parameters
        self.memory = memory
        self.result = result
        super().__init__(name=f"Layout({parameters}, {spelled(memory)}, {result})")

    @property
    def key(self) -> Any:
        return self.parameters, self.memory, self.result


_ANY: Final = Layout(types.none, types.none, types.none)


@register_model(Layout)
class _LayoutModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _WORD.as_pointer())


def calling(result: Any, *given: Any) -> Any:
    """Return a function (address of an entry, table, *given) for kernels: it calls a plug-in's kernel."""

    def call(typing: Any, entry: Any, table: Any, *found: Any) -> Any:
        def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
            address, table, *rest = values
            layout = context.make_array(call.args[1])(context, builder, table).data
            return _called(context, builder, result, (_ANY, *given), address, (layout, *rest))

        return result(types.int64, table, *given), lowered

    return _intrinsic(call, "entry", "table", *(f"given{k}" for k in range(len(given))))


def _cast(context: Any, builder: Any, found: Any, value: Any, result: Any) -> Any:
    return context.cast(builder, value, found, result)


def forwarding(number: int, result: Any, *given: Any, convert: Callable[..., Any] = _cast) -> Any:
    """Return the Python function of an entry: it reads the record with `layout` and calls the kernel with `given`.

    Args:
        number: Number of the kernel in its seam; 0 is the main one, which gets the parameters.
        convert: (context, builder, type, value, `result`) to what the main kernel returned as the type `result`.
    """

    def forward(typing: Any, layout: Any, *found: Any) -> Any:
        def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
            table, *rest = values
            kernel = _word(builder, table, _MAIN + number)
            memory = _view(context, builder, layout.memory, table, iter(range(_MEMORY, 1 << 16)))
            if number > 0:
                return _called(context, builder, result, (layout.memory,), kernel, (memory,))
            record = builder.inttoptr(_word(builder, table, _PARAMETERS), context.get_value_type(layout.parameters))
            arguments = (layout.parameters, layout.memory, *given)
            value = _called(context, builder, layout.result, arguments, kernel, (record, memory, *rest))
            return convert(context, builder, layout.result, value, result)

        return result(layout, *given), lowered

    return _intrinsic(forward, "layout", *(f"given{k}" for k in range(len(given))))


def _intrinsic(function: Callable[..., Any], *names: str) -> Any:
    """Numba's intrinsic with named arguments, since it can't pass `*found` on."""
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    signature = inspect.Signature([inspect.Parameter(name, kind) for name in ("typing", *names)])
    function.__signature__ = signature  # type: ignore[attr-defined]
    return intrinsic(function)


def _word(builder: Any, table: Any, place: int) -> Any:
    return builder.load(builder.gep(table, [ir.Constant(ir.IntType(32), place)]))


def _view(context: Any, builder: Any, kind: Any, table: Any, places: Iterator[int]) -> Any:
    """A memory of the type `kind` from the addresses and shapes in a table, in the order of `_arrays`."""
    if isinstance(kind, types.BaseTuple):
        return context.make_tuple(builder, kind, [_view(context, builder, item, table, places) for item in kind])
    from numba.np.arrayobj import populate_array  # numba imports it when it compiles

    array = context.make_array(kind)(context, builder)
    data = builder.inttoptr(_word(builder, table, next(places)), array.data.type)
    shape = [_word(builder, table, next(places)) for _ in range(kind.ndim)]
    size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    strides = [ir.Constant(_WORD, size)]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    populate_array(array, data, shape, strides, size, meminfo=None)
    return array._getvalue()


def _arrays(kind: type[ParameterGroup], part: Any, where: str) -> Iterator[NDArray[Any]]:
    if isinstance(part, tuple):
        for name, item in zip(getattr(part, "_fields", range(len(part))), part, strict=True):
            yield from _arrays(kind, item, f"{where}.{name}")
    elif isinstance(part, np.ndarray) and part.flags.c_contiguous and part.ndim > 0:
        yield part
    else:
        found = "an array that is not contiguous" if isinstance(part, np.ndarray) else type(part).__name__
        right = "Expected numpy arrays, (1,) for a number, in a NamedTuple."
        raise ContractError(f"{line_of(kind)}: {where} of {kind.__name__} is {found}. {right}")


def _called(
    context: Any, builder: Any, result: Any, arguments: Sequence[Any], address: Any, values: Sequence[Any]
) -> Any:
    """Call machine code by numba's calling convention, and pass on its errors."""
    convention = context.call_conv
    kind = convention.get_function_type(result, arguments)
    function = builder.inttoptr(address, kind.as_pointer())
    status, out = convention.call_function(builder, function, result, arguments, values)
    with cgutils.if_unlikely(builder, status.is_error):
        convention.return_status_propagate(builder, status)
    return out


def _compiled_for(kernel: Any, arguments: tuple[Any, ...]) -> Any:
    kernel.compile(arguments)
    return kernel.overloads[arguments]


def _address_of(compiled: Any) -> int:
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


@addressed
def _change_nothing(memory: Any) -> None:
    pass
