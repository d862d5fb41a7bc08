"""The seam between the loop and a controller: machine code that is called by its address.

The loop is compiled once for all controllers. A controller's kernels are compiled for its own parameters and memory, which
the loop knows nothing of: it passes the address of a table that says where they lie, and an entry, compiled for the same types,
reads the table and calls the kernel. A call costs some nanoseconds more than one that the compiler could see through.
"""

import functools
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic, models, register_model
from numpy.typing import NDArray

from vastflow.sim.kernels.calls import address_of, called, compiled_for
from vastflow.sim.kernels.numeric import addressed, inner, unkept
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.controllers.controller import Controller, ControllerError, ControllerInput, Setting, line_of
from vastflow.sim.nav2.costmaps.window import Window

_COMPUTE, _RESET, _SET_PLAN, _PARAMETERS, _MEMORY = range(5)
"""Places in a table: addresses of the kernels and of the parameters, and from `_MEMORY` on each array's address and shape."""


class Bound(NamedTuple):
    """A controller as the loop has it.

    Attributes:
        entries: (3,) int64, addresses of the entries of `compute_velocity`, `reset` and `set_plan`.
        table: (T,) int64, what the entries find the controller's kernels, parameters and memory by.
    """

    entries: Any
    table: Any


@dataclass(frozen=True, eq=False)
class RunningController:
    """A controller for one run. It owns what `bound` has the addresses of, and must outlive the kernels that are given those.

    Attributes:
        parameters: (1,) record of its parameters.
        memory: What its `memory` made.
    """

    controller: Controller
    parameters: NDArray[np.void]
    memory: Any
    bound: Bound


def running(controller: Controller, setting: Setting) -> RunningController:
    """A controller with the memory of one run, its kernels compiled.

    Raises:
        ControllerError: the memory holds something else than arrays, or a kernel can't be compiled or does not return what
            it should.
    """
    kind = type(controller)
    parameters, memory = record_of(controller), controller.memory(setting)
    arrays = list(_arrays(kind, memory, "memory"))
    types_of_arrays = tuple((array.dtype, array.ndim, array.flags.writeable) for array in arrays)
    held = _Held((kind, parameters.dtype, _structure(memory), types_of_arrays), parameters, memory)
    kernels, entries = _machine_code(held)
    places = [number for array in arrays for number in (array.ctypes.data, *array.shape)]
    table = np.array([*kernels, parameters.ctypes.data, *places], dtype=np.int64)
    return RunningController(controller, parameters, memory, Bound(np.array(entries, dtype=np.int64), table))


@dataclass(frozen=True, slots=True)
class _Held:
    """Parameters and memory that have the same types as others of an equal key."""

    key: tuple[Any, ...]
    parameters: NDArray[np.void] = field(compare=False)
    memory: Any = field(compare=False)


@functools.lru_cache(maxsize=64)
def _machine_code(held: _Held) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Addresses of a controller's kernels, and of the entries for its types: numba takes milliseconds to find them."""
    kind = held.key[0]
    parameters, memory = numba.typeof(held.parameters).dtype, numba.typeof(held.memory)
    computing = _kernel(kind, "compute_velocity", (parameters, memory, _GIVEN))
    kernels = (computing, *(_kernel(kind, name, (memory,)) for name in ("reset", "set_plan")))
    layout = _Layout(parameters, memory, computing.signature.return_type)
    compute, *others = _ENTRIES if kind.__module__.startswith("vastflow.") else _ENTRIES_OF_OTHERS
    entries = (compiled_for(compute, (layout, _GIVEN)), *(compiled_for(entry, (layout,)) for entry in others))
    return tuple(map(address_of, kernels)), tuple(map(address_of, entries))


def _structure(memory: Any) -> Any:
    """Classes of the tuples in a memory, as they are nested."""
    return (type(memory), *map(_structure, memory)) if isinstance(memory, tuple) else None


@inner
def compute_velocity(bound: Bound, given: ControllerInput) -> Any:
    """The controller's (valid, v, ω, vy); the loop calls it."""
    return _call_compute(bound.entries[_COMPUTE], bound.table, given)


@inner
def reset(bound: Bound) -> None:
    """Tell the controller that a FollowPath action is over."""
    _call_memory(bound.entries[_RESET], bound.table)


@inner
def set_plan(bound: Bound) -> None:
    """Tell the controller that the path is a new one."""
    _call_memory(bound.entries[_SET_PLAN], bound.table)


def _example() -> ControllerInput:
    window = Window(np.zeros((1, 1), dtype=np.uint8), np.zeros(3))
    pose = (0.0, 0.0, 0.0)
    return ControllerInput(window, np.zeros((1, 2)), 0.0, pose, (0.0, 0.0), np.zeros((1, 2)), 0.0, pose, 0.0, 0.0)


_GIVEN: Final = numba.typeof(_example())
_COMMAND: Final = types.Tuple((types.boolean, types.float64, types.float64, types.float64))
_WORD: Final = ir.IntType(64)


class _Layout(types.Type):  # type: ignore[misc]  # numba has no types
    """Address of a table of a controller with parameters, a memory and a command of these types."""

    def __init__(self, parameters: Any, memory: Any, command: Any) -> None:
        self.parameters = parameters
        self.memory = memory
        self.command = command
        super().__init__(name=f"Layout({parameters}, {memory}, {command})")

    @property
    def key(self) -> Any:
        return self.parameters, self.memory, self.command


_ANY: Final = _Layout(types.none, types.none, types.none)


@register_model(_Layout)
class _LayoutModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _WORD.as_pointer())


@intrinsic
def _call_compute(typing: Any, entry: Any, table: Any, given: Any) -> Any:
    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        layout = context.make_array(call.args[1])(context, builder, values[1]).data
        return called(context, builder, _COMMAND, (_ANY, _GIVEN), values[0], (layout, values[2]))

    return _COMMAND(types.int64, table, _GIVEN), lowered


@intrinsic
def _call_memory(typing: Any, entry: Any, table: Any) -> Any:
    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        layout = context.make_array(call.args[1])(context, builder, values[1]).data
        return called(context, builder, types.none, (_ANY,), values[0], (layout,))

    return types.none(types.int64, table), lowered


@intrinsic
def _forward_compute(typing: Any, layout: Any, given: Any) -> Any:
    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        table = values[0]
        kernel, parameters = (_word(builder, table, place) for place in (_COMPUTE, _PARAMETERS))
        record = builder.inttoptr(parameters, context.get_value_type(layout.parameters))
        memory = _view(context, builder, layout.memory, table, iter(range(_MEMORY, 1 << 16)))
        arguments = (layout.parameters, layout.memory, _GIVEN)
        found = called(context, builder, layout.command, arguments, kernel, (record, memory, values[1]))
        return _whole_command(context, builder, layout.command, found)

    return _COMMAND(layout, _GIVEN), lowered


def _whole_command(context: Any, builder: Any, kind: Any, found: Any) -> Any:
    """A command of three or four numbers as one of four: without a speed to the left there is none."""
    given = cgutils.unpack_tuple(builder, found, len(kind))
    parts = [context.cast(builder, *each) for each in zip(given, kind, _COMMAND, strict=False)]
    missing = [context.get_constant(types.float64, 0.0)] * (len(_COMMAND) - len(kind))
    return context.make_tuple(builder, _COMMAND, [*parts, *missing])


def _forward_memory(place: int) -> Any:
    @intrinsic
    def forward(typing: Any, layout: Any) -> Any:
        def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
            kernel = _word(builder, values[0], place)
            memory = _view(context, builder, layout.memory, values[0], iter(range(_MEMORY, 1 << 16)))
            return called(context, builder, types.none, (layout.memory,), kernel, (memory,))

        return types.none(layout), lowered

    return forward


_forward_reset: Final = _forward_memory(_RESET)
_forward_set_plan: Final = _forward_memory(_SET_PLAN)


def _compute_entry(layout: Any, given: Any) -> Any:
    return _forward_compute(layout, given)


def _reset_entry(layout: Any) -> None:
    _forward_reset(layout)


def _set_plan_entry(layout: Any) -> None:
    _forward_set_plan(layout)


_ENTRY_FUNCTIONS: Final[tuple[Any, ...]] = (_compute_entry, _reset_entry, _set_plan_entry)
_ENTRIES: Final = tuple(addressed(entry) for entry in _ENTRY_FUNCTIONS)
_ENTRIES_OF_OTHERS: Final = tuple(unkept(entry) for entry in _ENTRY_FUNCTIONS)
"""The same for types that another process may not know, and could then read no compiled forms at all."""


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


def _arrays(kind: type[Controller], part: Any, where: str) -> Iterator[NDArray[Any]]:
    """The arrays of a memory, in their order."""
    if isinstance(part, tuple):
        for name, item in zip(getattr(part, "_fields", range(len(part))), part, strict=True):
            yield from _arrays(kind, item, f"{where}.{name}")
    elif isinstance(part, np.ndarray) and part.flags.c_contiguous and part.ndim > 0:
        yield part
    else:
        found = "an array that is not contiguous" if isinstance(part, np.ndarray) else type(part).__name__
        right = "numpy arrays, (1,) for a number, in a NamedTuple"
        raise ControllerError(f"{line_of(kind)}: {where} of {kind.__name__} is {found}; {right}")


def _kernel(kind: type[Controller], name: str, arguments: tuple[Any, ...]) -> Any:
    """A kernel of a controller, compiled.

    Raises:
        ControllerError: it can't be, or returns another type.
    """
    kernel = getattr(kind, name, None)
    if kernel is None and name != "compute_velocity":
        kernel = _change_nothing
    where = f"{line_of(getattr(kernel, 'py_func', kind))}: {kind.__name__}.{name}"
    if not isinstance(kernel, Dispatcher):
        raise ControllerError(f"{where} is no compiled function; put @kernel above it")
    if getattr(kernel, "is_part", False):
        raise ControllerError(f"{where} is compiled for its callers alone and has no address; put @kernel above it")
    try:
        compiled = compiled_for(kernel, arguments)
    except Exception as error:  # noqa: BLE001 - numba raises more than its own errors, KeyError for an unknown parameter
        words = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise ControllerError(f"{where} can't be compiled: {words}") from None
    found = compiled.signature.return_type
    if name != "compute_velocity" and found != types.none:
        raise ControllerError(f"{where} returns {found}; nothing")
    if name == "compute_velocity" and not _is_command(found):
        raise ControllerError(f"{where} returns {found}; (valid, v, ω): a flag and two numbers")
    return compiled


@unkept
def _change_nothing(memory: Any) -> None:
    pass


def _is_command(found: Any) -> bool:
    """Whether numbers of these types can become a command."""
    if not isinstance(found, types.BaseTuple) or len(found) not in (3, 4):
        return False
    valid, *speeds = (types.unliteral(each) for each in found)
    return valid == types.boolean and all(isinstance(each, types.Integer | types.Float) for each in speeds)
