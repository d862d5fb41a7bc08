"""Sixteen float32 numbers at once: LLVM's vectors as a type of kernels.

The compiler vectorises a loop over samples by itself, but then it writes every sample's state to memory after each
step of time, which costs more than the steps do. With lanes, a loop over time keeps the samples' states in registers.
They fill one, two or four of the processor's registers, which LLVM sees to: two that do not wait for each other are faster
than one. A lane's result is that of the scalar operation, so the bits do not depend on the width of the registers.
"""

import inspect
import operator
from collections.abc import Callable
from typing import Any, Final

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from vastflow.sim.kernels.numba_target import processor_features

WIDTH: Final = 16
"""Numbers in lanes."""
_GATHERS: Final = "avx512f" in processor_features()

_FLOATS: Final = ir.VectorType(ir.FloatType(), WIDTH)
_SHORTS: Final = ir.VectorType(ir.IntType(16), WIDTH)
_INTS: Final = ir.VectorType(ir.IntType(32), WIDTH)
_FLAGS: Final = ir.VectorType(ir.IntType(1), WIDTH)


class _Lanes(types.Type):  # type: ignore[misc]
    def __init__(self) -> None:
        super().__init__(name="Lanes")


LANES: Final = _Lanes()


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _FLOATS)


def _define(operation: Callable[..., Any], instruction: str) -> None:
    class Template(ConcreteTemplate):  # type: ignore[misc]
        cases = (signature(LANES, LANES, LANES),)

    infer_global(operation)(Template)
    lower_builtin(operation, LANES, LANES)(
        lambda context, builder, call, values: getattr(builder, instruction)(*values)
    )


_define(operator.add, "fadd")
_define(operator.sub, "fsub")
_define(operator.mul, "fmul")
_define(operator.truediv, "fdiv")


FLOATS: Final = types.CPointer(types.float32)
NUMBERS: Final = types.CPointer(types.uint16)
WORDS: Final = types.CPointer(types.uint32)


@intrinsic
def addresses_of(typing: Any, arrays: Any) -> Any:
    """A named tuple of arrays with the address of each one's first element in its place.

    Lanes are loaded from and stored to addresses, since numba counts references to arrays at every call of a kernel, which
    takes longer than what the kernel does with sixteen samples.
    """
    kind = types.NamedTuple([types.CPointer(each.dtype) for each in arrays.types], arrays.instance_class)

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        parts = zip(arrays.types, cgutils.unpack_tuple(builder, values[0]), strict=True)
        addresses = [context.make_array(each)(context, builder, part).data for each, part in parts]
        return context.make_tuple(builder, kind, addresses)

    return kind(arrays), lowered


def _operation(result: Any, *takes: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator for what emits an operation of kernels: a function of LLVM's builder and the values."""

    def decorate(emit: Callable[..., Any]) -> Any:
        def typed(typing: Any, *found: Any) -> Any:
            def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
                emitted = emit(builder, *values)
                return context.get_dummy_value() if result is types.none else emitted

            return result(*takes), lowered

        typed.__name__, typed.__doc__ = emit.__name__, emit.__doc__
        typed.__signature__ = inspect.signature(emit)  # type: ignore[attr-defined]  # numba can't pass `*found` on
        return intrinsic(typed)

    return decorate


@_operation(LANES, types.float64)
def splat(builder: Any, value: Any) -> Any:
    """The same number in all lanes."""
    return _spread(builder, builder.fptrunc(value, ir.FloatType()), _FLOATS)


@_operation(LANES, FLOATS, types.intp)
def load(builder: Any, floats: Any, start: Any) -> Any:
    """Lanes from neighbors among float32 numbers."""
    return builder.load(_place(builder, floats, start, _FLOATS), align=4)


@_operation(LANES, WORDS, types.intp)
def load_upper(builder: Any, words: Any, start: Any) -> Any:
    """Lanes from neighbors among uint32 words: the bits of each as a float32 number."""
    return builder.load(_place(builder, words, start, _FLOATS), align=4)


@_operation(LANES, WORDS, types.intp)
def load_lower(builder: Any, words: Any, start: Any) -> Any:
    """The same of the lower 16 bits of each as the upper half of a float32 number."""
    bits = builder.load(_place(builder, words, start, _INTS), align=4)
    return builder.bitcast(builder.shl(bits, ir.Constant(_INTS, [16] * WIDTH)), _FLOATS)


@_operation(types.none, FLOATS, types.intp, LANES)
def store(builder: Any, floats: Any, start: Any, lanes: Any) -> None:
    """Write lanes to neighbors among float32 numbers."""
    builder.store(lanes, _place(builder, floats, start, _FLOATS), align=4)


@_operation(LANES, LANES, LANES)
def lower(builder: Any, a: Any, b: Any) -> Any:
    """The lower of two numbers in each lane."""
    return builder.select(builder.fcmp_ordered("<", a, b), a, b)


@_operation(LANES, LANES, LANES)
def higher(builder: Any, a: Any, b: Any) -> Any:
    """The higher of two numbers in each lane."""
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)


@_operation(LANES, LANES, LANES, LANES, LANES)
def either(builder: Any, a: Any, b: Any, less: Any, otherwise: Any) -> Any:
    """`less` in lanes where a < b, `otherwise` in the others."""
    return builder.select(builder.fcmp_ordered("<", a, b), less, otherwise)


@_operation(types.boolean, LANES, LANES)
def any_below(builder: Any, a: Any, b: Any) -> Any:
    flags = builder.bitcast(builder.fcmp_ordered("<", a, b), ir.IntType(WIDTH))
    return builder.icmp_unsigned("!=", flags, ir.Constant(ir.IntType(WIDTH), 0))


@_operation(LANES, LANES)
def size(builder: Any, a: Any) -> Any:
    """Absolute values."""
    return _llvm(builder, "fabs", a)


@_operation(LANES, LANES)
def root(builder: Any, a: Any) -> Any:
    """Square roots."""
    return _llvm(builder, "sqrt", a)


@_operation(LANES, LANES)
def whole(builder: Any, a: Any) -> Any:
    """Truncate toward zero."""
    return builder.sitofp(builder.fptosi(a, _INTS), _FLOATS)


@_operation(types.none, NUMBERS, types.intp, LANES)
def store_whole(builder: Any, numbers: Any, start: Any, lanes: Any) -> None:
    """Truncate lanes and store them at neighboring uint16 elements."""
    builder.store(builder.fptosi(lanes, _SHORTS), _place(builder, numbers, start, _SHORTS), align=2)


@_operation(types.none, NUMBERS, types.intp, LANES, LANES, types.int64, types.int64)
def store_cells(builder: Any, numbers: Any, start: Any, x: Any, y: Any, columns: Any, rows: Any) -> None:
    """Write the numbers of the cells that hold points to neighbors among uint16 numbers.

    Cell (0, 0) is number 0, a row has `columns` of them and there are `rows` of rows: no more than 65,536 cells in all.
    A point outside counts as in the nearest cell of the border.
    """
    columns, rows = (builder.trunc(value, ir.IntType(16)) for value in (columns, rows))

    def inside(at: Any, count: Any) -> Any:
        zero, one = ir.Constant(_SHORTS, [0] * WIDTH), ir.Constant(ir.IntType(16), 1)
        last = _spread(builder, builder.sub(count, one), _SHORTS)
        at = builder.fptosi(at, _SHORTS)
        at = builder.select(builder.icmp_signed(">", at, zero), at, zero)
        return builder.select(builder.icmp_signed("<", at, last), at, last)

    row = builder.mul(inside(y, rows), _spread(builder, columns, _SHORTS))
    builder.store(builder.add(row, inside(x, columns)), _place(builder, numbers, start, _SHORTS), align=2)


@_operation(LANES, FLOATS, NUMBERS, types.intp)
def gather(builder: Any, table: Any, numbers: Any, start: Any) -> Any:
    """Entries of a float32 table under the numbers of neighbors among uint16 numbers."""
    lanes, word = ir.Constant(_FLOATS, ir.Undefined), ir.IntType(32)
    if _GATHERS:
        places = builder.zext(builder.load(_place(builder, numbers, start, _SHORTS), align=2), _INTS)
        kind = ir.FunctionType(_FLOATS, [_FLOATS, table.type, _INTS, _FLAGS, word])
        gathered = cgutils.get_or_insert_function(builder.module, kind, "llvm.x86.avx512.mask.gather.dps.512")
        every = ir.Constant(_FLAGS, [1] * WIDTH)
        return builder.call(gathered, (lanes, table, places, every, ir.Constant(word, 4)))
    for lane in range(WIDTH):
        at = builder.add(start, ir.Constant(start.type, lane))
        number = builder.zext(builder.load(builder.gep(numbers, [at])), ir.IntType(64))
        lanes = builder.insert_element(lanes, builder.load(builder.gep(table, [number])), ir.Constant(word, lane))
    return lanes


def _place(builder: Any, address: Any, index: Any, kind: Any) -> Any:
    """Pointer to `kind` from an address and an index."""
    return builder.bitcast(builder.gep(address, [index]), kind.as_pointer())


def _spread(builder: Any, value: Any, kind: Any) -> Any:
    empty = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, empty, ir.Constant(_INTS, [0] * WIDTH))


def _llvm(builder: Any, name: str, value: Any) -> Any:
    kind = ir.FunctionType(_FLOATS, [_FLOATS])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f32"), (value,))
