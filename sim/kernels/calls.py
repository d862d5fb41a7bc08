"""Machine code that kernels call by its address."""

from collections.abc import Sequence
from typing import Any

from numba.core import cgutils


def called(
    context: Any, builder: Any, result: Any, arguments: Sequence[Any], address: Any, values: Sequence[Any]
) -> Any:
    """Call machine code of numba's calling convention; what it raises is raised on."""
    convention = context.call_conv
    kind = convention.get_function_type(result, arguments)
    function = builder.inttoptr(address, kind.as_pointer())
    status, out = convention.call_function(builder, function, result, arguments, values)
    with cgutils.if_unlikely(builder, status.is_error):
        convention.return_status_propagate(builder, status)
    return out


def compiled_for(kernel: Any, arguments: tuple[Any, ...]) -> Any:
    kernel.compile(arguments)
    return kernel.overloads[arguments]


def machine_code_of(kernel: Any, arguments: tuple[Any, ...]) -> int:
    """Where the machine code of one of vastflow's own kernels begins, compiled for these types."""
    return address_of(compiled_for(kernel, arguments))


def address_of(compiled: Any) -> int:
    """Where the machine code of a compiled kernel begins."""
    found: int = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
    return found
