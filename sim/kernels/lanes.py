"""Sixteen float32 numbers at once: LLVM's vectors as a type of kernels.

The compiler vectorises a loop over samples by itself, but then it writes every sample's state to memory after each
step of time, which costs more than the steps do. With lanes, a loop over time keeps the samples' states in registers.
They fill one, two or four of the processor's registers, which LLVM sees to: two that do not wait for each other are faster
than one. A lane's result is that of the scalar operation, so the bits do not depend on the width of the registers.
"""

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
    """Let lanes be added, subtracted or multiplied lane by lane."""

    class Template(ConcreteTemplate):  # type: ignore[misc]
        cases = (signature(LANES, LANES, LANES),)

    infer_global(operation)(Template)

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return getattr(builder, instruction)(*values)

    lower_builtin(operation, LANES, LANES)(lowered)


_define(operator.add, "fadd")
_define(operator.sub, "fsub")
_define(operator.mul, "fmul")
_define(operator.truediv, "fdiv")


FLOATS: Final = types.CPointer(types.float32)
NUMBERS: Final = types.CPointer(types.uint16)
WORDS: Final = types.CPointer(types.uint32)


@intrinsic
def data_of(typing: Any, array: Any) -> Any:
    """Address of an array's first element.

    Lanes are loaded from and stored to addresses, since numba counts references to arrays at every call of a kernel, which
    takes longer than what the kernel does with sixteen samples.
    """

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return context.make_array(call.args[0])(context, builder, values[0]).data

    return types.CPointer(array.dtype)(array), lowered


@intrinsic
def splat(typing: Any, value: Any) -> Any:
    """The same number in all lanes."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return _spread(builder, builder.fptrunc(values[0], ir.FloatType()), _FLOATS)

    return LANES(types.float64), lowered


@intrinsic
def load(typing: Any, floats: Any, start: Any) -> Any:
    """Lanes from neighbors among float32 numbers."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return builder.load(_place(builder, values, _FLOATS), align=4)

    return LANES(FLOATS, types.intp), lowered


@intrinsic
def load_upper(typing: Any, words: Any, start: Any) -> Any:
    """Lanes from neighbors among uint32 words: the bits of each as a float32 number."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return builder.load(_place(builder, values, _FLOATS), align=4)

    return LANES(WORDS, types.intp), lowered


@intrinsic
def load_lower(typing: Any, words: Any, start: Any) -> Any:
    """The same of the lower 16 bits of each as the upper half of a float32 number."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        bits = builder.load(_place(builder, values, _INTS), align=4)
        return builder.bitcast(builder.shl(bits, ir.Constant(_INTS, [16] * WIDTH)), _FLOATS)

    return LANES(WORDS, types.intp), lowered


@intrinsic
def store(typing: Any, floats: Any, start: Any, lanes: Any) -> Any:
    """Write lanes to neighbors among float32 numbers."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        builder.store(values[2], _place(builder, values, _FLOATS), align=4)
        return context.get_dummy_value()

    return types.none(FLOATS, types.intp, LANES), lowered


@intrinsic
def lower(typing: Any, a: Any, b: Any) -> Any:
    """The lower of two numbers in each lane."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", *values), *values)

    return LANES(LANES, LANES), lowered


@intrinsic
def higher(typing: Any, a: Any, b: Any) -> Any:
    """The higher of two numbers in each lane."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", *values), *values)

    return LANES(LANES, LANES), lowered


@intrinsic
def either(typing: Any, a: Any, b: Any, less: Any, otherwise: Any) -> Any:
    """`less` in lanes where a < b, `otherwise` in the others."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", values[0], values[1]), values[2], values[3])

    return LANES(LANES, LANES, LANES, LANES), lowered


@intrinsic
def any_below(typing: Any, a: Any, b: Any) -> Any:
    """Whether a < b in any lane."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        flags = builder.bitcast(builder.fcmp_ordered("<", *values), ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", flags, ir.Constant(ir.IntType(WIDTH), 0))

    return types.boolean(LANES, LANES), lowered


@intrinsic
def size(typing: Any, a: Any) -> Any:
    """Absolute values."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return builder.call(_llvm(builder, "fabs"), values)

    return LANES(LANES), lowered


@intrinsic
def root(typing: Any, a: Any) -> Any:
    """Square roots."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return builder.call(_llvm(builder, "sqrt"), values)

    return LANES(LANES), lowered


@intrinsic
def whole(typing: Any, a: Any) -> Any:
    """Without what is behind the point."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return builder.sitofp(builder.fptosi(values[0], _INTS), _FLOATS)

    return LANES(LANES), lowered


@intrinsic
def store_whole(typing: Any, numbers: Any, start: Any, lanes: Any) -> Any:
    """Write lanes without what is behind the point to neighbors among uint16 numbers."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        words = builder.fptosi(values[2], _SHORTS)
        builder.store(words, _place(builder, values, _SHORTS), align=2)
        return context.get_dummy_value()

    return types.none(NUMBERS, types.intp, LANES), lowered


@intrinsic
def store_cells(typing: Any, numbers: Any, start: Any, x: Any, y: Any, columns: Any, rows: Any) -> Any:
    """Write the numbers of the cells that hold points to neighbors among uint16 numbers.

    Cell (0, 0) is number 0, a row has `columns` of them and there are `rows` of rows: no more than 65,536 cells in all.
    A point outside counts as in the nearest cell of the border.
    """

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        columns, rows = (builder.trunc(value, ir.IntType(16)) for value in values[4:])

        def inside(at: Any, count: Any) -> Any:
            zero, one = ir.Constant(_SHORTS, [0] * WIDTH), ir.Constant(ir.IntType(16), 1)
            last = _spread(builder, builder.sub(count, one), _SHORTS)
            at = builder.fptosi(at, _SHORTS)
            at = builder.select(builder.icmp_signed(">", at, zero), at, zero)
            return builder.select(builder.icmp_signed("<", at, last), at, last)

        row = builder.mul(inside(values[3], rows), _spread(builder, columns, _SHORTS))
        cells = builder.add(row, inside(values[2], columns))
        builder.store(cells, _place(builder, values, _SHORTS), align=2)
        return context.get_dummy_value()

    return types.none(NUMBERS, types.intp, LANES, LANES, types.int64, types.int64), lowered


@intrinsic
def gather(typing: Any, table: Any, numbers: Any, start: Any) -> Any:
    """Entries of a float32 table under the numbers of neighbors among uint16 numbers."""

    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        table, numbers, start = values
        if _GATHERS:
            places = builder.zext(builder.load(_place(builder, (numbers, start), _SHORTS), align=2), _INTS)
            kind = ir.FunctionType(_FLOATS, [_FLOATS, table.type, _INTS, _FLAGS, ir.IntType(32)])
            gathered = cgutils.get_or_insert_function(builder.module, kind, "llvm.x86.avx512.mask.gather.dps.512")
            none, every = ir.Constant(_FLOATS, ir.Undefined), ir.Constant(_FLAGS, [1] * WIDTH)
            return builder.call(gathered, (none, table, places, every, ir.Constant(ir.IntType(32), 4)))
        lanes = ir.Constant(_FLOATS, ir.Undefined)
        for lane in range(WIDTH):
            at = builder.add(start, ir.Constant(start.type, lane))
            number = builder.zext(builder.load(builder.gep(numbers, [at])), ir.IntType(64))
            entry = builder.load(builder.gep(table, [number]))
            lanes = builder.insert_element(lanes, entry, ir.Constant(ir.IntType(32), lane))
        return lanes

    return LANES(FLOATS, NUMBERS, types.intp), lowered


def _place(builder: Any, values: Any, kind: Any) -> Any:
    """Pointer to `kind` from an address and an index, the first two arguments of a call."""
    return builder.bitcast(builder.gep(values[0], [values[1]]), kind.as_pointer())


def _spread(builder: Any, value: Any, kind: Any) -> Any:
    empty = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, empty, ir.Constant(_INTS, [0] * WIDTH))


def _llvm(builder: Any, name: str) -> Any:
    kind = ir.FunctionType(_FLOATS, [_FLOATS])
    return cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f32")
