"""The passes that compile a kernel: numba's own, without those that no kernel here needs.

A kernel is plain: no closures, no comprehensions, no context managers, no loops over tuples of several types. One that is not does
not compile, and numba says so. What numba compiles of its own for a kernel, and what others write, goes through numba's own pipeline.
"""

from typing import Any, Final

from numba.core import ir, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, PassManager, register_pass
from numba.core.typed_passes import NopythonRewrites
from numba.core.types.containers import BaseTuple
from numba.core.types.misc import EllipsisType, NoneType, SliceType, StringLiteral

UNNEEDED: Final = frozenset(
    {
        "WithLifting",
        "InlineClosureLikes",
        "RewriteDynamicRaises",
        "MakeFunctionToJitFunction",
        "InlineInlinables",
        "FindLiterallyCalls",
        "LiteralUnroll",
        "LiteralPropagationSubPipelinePass",
        "NoPythonSupportedFeatureValidation",
        "AnnotateTypes",
    }
)
"""Names of passes that leave a plain kernel as it is."""

_ARRAY_OPERATIONS: Final = ("binop", "inplace_binop", "unary", "call")


@register_pass(mutates_CFG=True, analysis_only=False)
class _ArrayRewrites(NopythonRewrites):  # type: ignore[misc]  # numba has no types
    """numba's rewrites of array expressions, where there is one: to look for them takes every variable's lifetime."""

    _name = "vastflow_array_rewrites"

    def run_pass(self, state: Any) -> bool:
        arrays = (
            isinstance(signature.return_type, types.Array)
            for expression, signature in state.calltypes.items()
            if signature is not None and isinstance(expression, ir.Expr) and expression.op in _ARRAY_OPERATIONS
        )
        return any(arrays) and bool(super().run_pass(state))


@register_pass(mutates_CFG=False, analysis_only=False)
class _Borrowing(FunctionPass):  # type: ignore[misc]
    """No count of references in a part all of whose arrays are lent to it.

    They belong to its caller, which outlives it. numba counts at each assignment all the same, for each array of a tuple, and LLVM
    then takes most of it out again.
    """

    _name = "vastflow_borrowing"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        if state.flags.no_cpython_wrapper and _borrows(state):
            state.targetctx = state.targetctx.subtarget(enable_nrt=False)
        return False


def _borrows(state: Any) -> bool:
    """Whether a function makes, keeps, and returns nothing with a count: all such variables are arguments or parts of them."""
    counted = {each for each in set(state.typemap.values()) if _is_counted(each, state)}
    if not counted or _is_counted(state.return_type, state) or not all(_is_of_arrays(each, state) for each in counted):
        return False
    for block in state.func_ir.blocks.values():
        for statement in block.body:
            if isinstance(statement, ir.Assign):
                if state.typemap[statement.target.name] in counted and not _is_lent(statement.value, state.typemap):
                    return False
            elif (
                isinstance(statement, ir.SetItem | ir.StaticSetItem) and state.typemap[statement.value.name] in counted
            ):
                return False  # to copy one array into another numba may need memory of its own
    return True


def _is_counted(kind: Any, state: Any) -> bool:
    return bool(state.targetctx.data_model_manager[kind].contains_nrt_meminfo())


def _is_of_arrays(kind: Any, state: Any) -> bool:
    """Whether what is counted of a type is arrays, in tuples perhaps: nothing that another value can be put into and kept by."""
    if isinstance(kind, BaseTuple):
        return all(_is_of_arrays(each, state) for each in kind.types if _is_counted(each, state))
    return isinstance(kind, types.Array | StringLiteral)


def _is_lent(value: Any, typemap: dict[str, Any]) -> bool:
    """Whether what is assigned belongs to whom its parts belong to: a variable, a constant, a tuple, its items, an array's view."""
    if not isinstance(value, ir.Expr):
        return isinstance(value, ir.Arg | ir.Var | ir.Const | ir.Global | ir.FreeVar)
    if value.op == "build_tuple":
        return True
    if value.op not in ("getattr", "exhaust_iter", "static_getitem", "getitem"):
        return False
    whole = typemap[value.value.name]
    if isinstance(whole, BaseTuple):
        return True
    return value.op == "static_getitem" or (value.op == "getitem" and _is_view_at(typemap[value.index.name]))


def _is_view_at(index: Any) -> bool:
    """Whether an array's item at an index of this type is a view of it."""
    if isinstance(index, BaseTuple):
        return all(_is_view_at(each) for each in index.types)
    return isinstance(index, types.Integer | SliceType | EllipsisType | NoneType)


class _Arguments(tuple[Any, ...]):
    """Types of arguments. numba writes them out at each pass for its listeners, and a record's take hundreds of lines."""

    def __repr__(self) -> str:
        return f"({len(self)} types)"


class Pipeline(CompilerBase):  # type: ignore[misc]
    """How a kernel of vastflow's own is compiled."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.state.args = _Arguments(self.state.args)

    def define_pipelines(self) -> list[Any]:
        whole = DefaultPassBuilder.define_nopython_pipeline(self.state)
        lean = PassManager("kernel")
        for each, words in whole.passes:
            if each.__name__ == "IRLegalization":
                lean.add_pass(_Borrowing, "look for arrays of its own")
            if each.__name__ not in UNNEEDED:
                lean.add_pass(_ArrayRewrites if each is NopythonRewrites else each, words)
        lean.finalize()
        return [lean]
