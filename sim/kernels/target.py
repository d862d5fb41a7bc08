"""The processor that kernels are compiled for: a target of vastflow's own in numba, beside the one of the user's functions.

Code for a generic processor gives the same bits on every host of an architecture (measured). numba's settings, its target
"cpu" and what is compiled for that stay as they are: a process that has compiled functions of its own, before or after, gets
the same recordings, and the same functions.
"""

import importlib
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import BuiltinFunctionType
from typing import Any, Final

import numba
from llvmlite import binding
from numba import _dynfunc
from numba.core import types, typing
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler_lock import global_compiler_lock
from numba.core.cpu import CPUContext
from numba.core.dispatcher import Dispatcher
from numba.core.environment import lookup_environment
from numba.core.registry import CPUTarget, cpu_target
from numba.core.runtime import rtsys
from numba.core.target_extension import CPU, dispatcher_registry, jit_registry, target_override, target_registry
from numba.core.targetconfig import ConfigStack
from numba.core.types.misc import unliteral
from numba.core.utils import threadsafe_cached_property
from numba.extending import models, register_model

from vastflow.sim.kernels.pipeline import Pipeline


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


TARGET: Final = "vastflow"
"""numba's name of the target: what is decorated with `jit(_target=TARGET)` is compiled for it."""

# LLVM's third level costs a fifth more compile time and gains nothing here (measured).
_OPTIMIZATION: Final = 2


AVX2: Final = "+avx2"
AVX512: Final = "+avx2,+avx512f,+avx512bw,+avx512dq,+avx512vl"


def processor_features() -> str:
    """What kernels use of the processor beyond its architecture's minimum: the widest registers that are fast.

    Wider registers change no bit of a result, since nothing is reordered and nothing fused (FMA stays off). numba's own
    variable `NUMBA_CPU_FEATURES` takes precedence.
    """
    given = os.environ.get("NUMBA_CPU_FEATURES")
    return given if given is not None else widest(binding.get_host_cpu_features())


def widest(host: Mapping[str, bool]) -> str:
    """Of a processor's features those of its widest registers.

    AVX-512 counts where bfloat16 came with it, from Sapphire Rapids and Zen 4 on: processors before them lower their clock
    for it, or load from tables slowly since they were mended against Downfall.
    """
    if all(host.get(name) for name in ("avx512f", "avx512bw", "avx512dq", "avx512vl", "avx512vbmi2", "avx512bf16")):
        return AVX512
    return AVX2 if host.get("avx2") else ""


class _NoColors:
    """What numba asks how its errors are to be colored."""

    def code(self, message: str) -> str:
        return message

    errmsg = filename = indicate = highlight = reset = code


_NO_COLORS: Final = _NoColors()


class _Processor(CPU):  # type: ignore[misc]  # numba has no types
    """A CPU, so that what numba and its extensions define for CPUs counts here as well."""


class _Library(JITCodeLibrary):  # type: ignore[misc]
    """The code of a compiled function with all that it calls; of a part it is kept as it is, for those that call it.

    numba optimizes each function with all that it calls and makes machine code of it, and then does so again in each caller.
    Only what is called from without needs that.
    """

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self.is_part = codegen.compiles_part

    def _optimize_functions(self, ll_module: Any) -> None:
        """numba makes a pass manager for each function, and for those that are only declared as well."""
        ll_module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager()
        for function in ll_module.functions:
            if not function.is_declaration:
                passes.run(function, builder)

    def _optimize_final_module(self) -> None:
        if not self.is_part:
            super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        if self.is_part:
            self._finalize_dynamic_globals()
            self._finalized = True
        else:
            super()._finalize_final_module()


class _Codegen(JITCPUCodegen):  # type: ignore[misc]
    """Machine code for the generic processor, whatever `numba.config` says of processor and optimization.

    Attributes:
        compiles_part: Whether the function that is compiled at the moment is only called by others that are compiled.
    """

    _library_class = _Library
    compiles_part = False

    def _init(self, llvm_module: Any) -> None:
        super()._init(llvm_module)
        self._loopvect, self._opt_level = False, 0  # numba's own, but for `NUMBA_OPT=max`

    def _customize_tm_options(self, options: dict[str, Any]) -> None:
        super()._customize_tm_options(options)
        options["opt"] = _OPTIMIZATION

    def _pass_builder(self, **options: Any) -> Any:
        return super()._pass_builder(
            **{"opt": _OPTIMIZATION, "loop_vectorize": True, "slp_vectorize": False, **options}
        )

    def set_env(self, env_name: str, env: Any) -> None:
        """Give code its environment, unless the optimizer found that it needs none."""
        if self._engine.is_symbol_defined(env_name):
            super().set_env(env_name, env)

    def _get_host_cpu_name(self) -> str:
        return "generic"

    def _get_host_cpu_features(self) -> str:
        return processor_features()


class _Context(CPUContext):  # type: ignore[misc]
    def init(self) -> None:
        super().init()
        self._internal_codegen = _Codegen("vastflow.kernels")
        self._sizes: dict[str, int] = {}

    def load_additional_registries(self) -> None:
        rtsys.initialize(cpu_target.target_context)  # whoever is first compiles numba's runtime for all targets
        _import_array_functions()
        super().load_additional_registries()

    def get_abi_sizeof(self, ty: Any) -> int:
        """Bytes of an LLVM type, for which it parses a module each time."""
        name = str(ty)
        if name not in self._sizes:
            self._sizes[name] = super().get_abi_sizeof(ty)
        return self._sizes[name]

    def get_executable(self, library: Any, fndesc: Any, env: Any) -> Any:
        """What Python calls: nothing of a part; what else is compiled is given the environments of its parts."""
        if library.is_part:
            return _dynfunc.make_function(fndesc.lookup_module(), fndesc.qualname, "", 0, env, (library,))
        if library._final_module is not None:
            for variable in library._final_module.global_variables:
                part = lookup_environment(variable.name)
                if part is not None:
                    library.codegen.set_env(variable.name, part)
        return super().get_executable(library, fndesc, env)


def _context_of(target: CPUTarget) -> _Context:
    return _Context(target.typing_context, TARGET)


def _typing_context_of(_target: CPUTarget) -> TypingContext:
    return TypingContext()


class _Target(CPUTarget):  # type: ignore[misc]
    _toplevel_target_context = threadsafe_cached_property(_context_of)
    _toplevel_typing_context = threadsafe_cached_property(_typing_context_of)


class _Dispatcher(Dispatcher):
    """A kernel as Python has it.

    Attributes:
        is_part: Whether only compiled functions call it.
    """

    targetdescr = _Target(TARGET)
    is_part = False
    _compiler: Any

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """A call by a function that is compiled: of a kernel for whole numbers, not for each number that is written in a call."""
        if self._compiler.pipeline_class is Pipeline:
            args = [unliteral(each) if isinstance(each, types.IntegerLiteral) else each for each in args]
        return super().get_call_template(args, kws)

    def compile(self, sig: Any) -> Any:
        """Compile for these types; what numba defines with `overload` and first meets while it lowers is so ours as well."""
        if isinstance(sig, tuple) and (known := self.overloads.get(sig)) is not None:
            return known.entry_point
        codegen = self.targetdescr.target_context.codegen()
        # numba's own lock, taken before what is compiled is noted: another thread notes something else.
        with global_compiler_lock:
            outer, codegen.compiles_part = codegen.compiles_part, self.is_part
            try:
                with target_override(TARGET), _plain_errors():
                    return super().compile(sig)
            finally:
                codegen.compiles_part = outer


@contextmanager
def _plain_errors() -> Iterator[None]:
    """numba's errors without colors: it raises hundreds that it catches itself, and asks the terminal for its colors at each."""
    errors: Any = importlib.import_module("numba.core.errors")
    before, errors._termcolor_inst = errors._termcolor_inst, _NO_COLORS
    try:
        yield
    finally:
        errors._termcolor_inst = before


def part(dispatcher: Any) -> Any:
    """Have a function compiled for its callers alone: Python can't call it, and it has no address."""
    dispatcher.is_part = True
    return dispatcher


def _jit_of_overload(**options: Any) -> Any:
    decorate = numba.jit(**options, _target=TARGET, no_cfunc_wrapper=True)
    return lambda function: part(decorate(function))


def _import_array_functions() -> None:
    """Import numba's functions of arrays without SciPy's BLAS, half of a worker's start, which no kernel here needs.

    numba looks for BLAS once while they are imported, and again where a function needs it. The first look is left out.
    """
    if "numba.np.arraymath" in sys.modules:
        return
    linear_algebra: Any = importlib.import_module("numba.np.linalg")
    look = linear_algebra.ensure_blas
    linear_algebra.ensure_blas = lambda: None
    try:
        array_functions: Any = importlib.import_module("numba.np.arraymath")
        array_functions.ensure_blas = look
    finally:
        linear_algebra.ensure_blas = look


target_registry[TARGET] = _Processor
dispatcher_registry[_Processor] = _Dispatcher
jit_registry[_Processor] = _jit_of_overload
