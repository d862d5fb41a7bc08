"""Numba's undocumented names: a compilation target of vastflow's own, and a cache of compiled kernels that is checked.

Numba's tested minor versions are those that `pyproject.toml` allows; `tests/proofs/installed.py numba` runs the kernels' tests on each.

The target compiles for a generic processor, whose code gives the same bits on every host of an architecture (measured). Numba's
settings, its target "cpu", and what is compiled for that stay as they are: a process that has compiled functions of its own gets
the same recordings, and the same functions.

In kernels, those of plug-ins too, the names of `math` for elementary functions mean `vastflow.sim.model.elementary`: LLVM would
call the C library, whose last bits depend on its version and on the processor.

The cache removes a damaged file and compiles again; numba's own raises on an emptied file, as a power cut leaves it, and runs changed
machine code. Its index has a path in it, so that every clone and environment would compile its own. Here a file is found by a name
that follows from its content, in one folder for all installations of a user.
"""

import functools
import hashlib
import logging
import math
import os
import pickle
import sys
import uuid
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numba
from llvmlite import binding
from numba import _dynfunc
from numba.core import types
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.cpu import CPUContext
from numba.core.dispatcher import Dispatcher
from numba.core.environment import lookup_environment
from numba.core.imputils import Registry as Implementations
from numba.core.registry import CPUTarget, cpu_target
from numba.core.runtime import rtsys
from numba.core.serialize import dumps
from numba.core.target_extension import CPU, dispatcher_registry, jit_registry, target_override, target_registry
from numba.core.types.misc import unliteral
from numba.core.utils import threadsafe_cached_property
from numba.extending import register_jitable

from vastflow.sim.kernels.content import content_of, spelled
from vastflow.sim.model import elementary

TARGET: Final = "vastflow"
"""numba's name of the target: what is decorated with `jit(_target=TARGET)` is compiled for it."""

# LLVM's third level costs a fifth more compile time and gains nothing here (measured).
_OPTIMIZATION: Final = 2

AVX2: Final = "+avx2"
AVX512: Final = "+avx2,+avx512f,+avx512bw,+avx512dq,+avx512vl"


def processor_features() -> str:
    """Processor features beyond the architecture's minimum: the widest registers that are fast.

    Wider registers change no bit of a result, since nothing is reordered and nothing fused (FMA stays off). numba's own
    variable `NUMBA_CPU_FEATURES` takes precedence.
    """
    given = os.environ.get("NUMBA_CPU_FEATURES")
    return given if given is not None else widest(binding.get_host_cpu_features())


def widest(host: Mapping[str, bool]) -> str:
    """Return the features of a processor's widest registers.

    AVX-512 counts where bfloat16 came with it, from Sapphire Rapids and Zen 4 on: processors before them lower their clock
    for it, or load from tables slowly since they were mended against Downfall.
    """
    if all(host.get(name) for name in ("avx512f", "avx512bw", "avx512dq", "avx512vl", "avx512vbmi2", "avx512bf16")):
        return AVX512
    return AVX2 if host.get("avx2") else ""


class _Processor(CPU):  # type: ignore[misc]  # numba has no types
    """A CPU target, so that numba's definitions for CPUs and those of its extensions apply."""


class _Library(JITCodeLibrary):  # type: ignore[misc]
    """The code of a compiled function with all its callees; a part stays unoptimized for its callers.

    numba optimizes each function with all that it calls and makes machine code of it, and then does so again in each caller.
    Only what is called from without needs that.
    """

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self.is_part = codegen.compiles_part

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
    """Compile for the generic processor, independent of `numba.config`.

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

    def load_additional_registries(self) -> None:
        rtsys.initialize(cpu_target.target_context)  # whoever is first compiles numba's runtime for all targets
        super().load_additional_registries()
        self.install_registry(_ELEMENTARY)  # what is installed last is what counts

    def get_executable(self, library: Any, fndesc: Any, env: Any) -> Any:
        """Return the Python callable, None for a part; set the environments of the parts."""
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


class _Target(CPUTarget):  # type: ignore[misc]
    _toplevel_target_context = threadsafe_cached_property(_context_of)


class _Dispatcher(Dispatcher):
    """A kernel as Python has it.

    Attributes:
        is_part: Whether it is compiled for its callers alone: Python can't call it, and it has no address.
        is_own: Whether it is the simulator's own, and compiled once for all whole numbers that are written in calls of it.
    """

    targetdescr = _Target(TARGET)
    is_part = False
    is_own = False

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Resolve a call by a compiled function."""
        if self.is_own:
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
                with target_override(TARGET):
                    return super().compile(sig)
            finally:
                codegen.compiles_part = outer


def _jit_of_overload(**options: Any) -> Any:
    def compile_part(function: Callable[..., Any]) -> Any:
        dispatcher = numba.jit(**options, _target=TARGET, no_cfunc_wrapper=True)(function)
        dispatcher.is_part = True
        return dispatcher

    return compile_part


target_registry[TARGET] = _Processor
dispatcher_registry[_Processor] = _Dispatcher
jit_registry[_Processor] = _jit_of_overload


_SHORT: Final = (elementary.sin, elementary.cos, elementary.hypot)
_ELEMENTARY: Final = Implementations("vastflow.elementary")

register_jitable(error_model="numpy", forceinline=True)(
    elementary.cos_sin
)  # sine and cosine of one angle share most of it
register_jitable(error_model="numpy")(elementary.atan2)


def _replace(function: Callable[..., float], ours: Callable[..., float]) -> None:
    """Let kernels call `ours` by the name of `function`, for all types that numba's own is defined for."""
    compiled = numba.njit(_target=TARGET, error_model="numpy", no_cfunc_wrapper=True, forceinline=ours in _SHORT)(ours)

    def call(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        dispatcher = types.Dispatcher(compiled)
        called: Any = dispatcher.get_call_type(context.typing_context, signature.args, {})
        result = context.get_function(dispatcher, called)(builder, arguments)
        return context.cast(builder, result, called.return_type, signature.return_type)

    for kind in (types.float64, types.float32, types.int64, types.uint64):
        _ELEMENTARY.lower(function, *[kind] * ours.__code__.co_argcount)(call)


for _ours in (
    *(elementary.sin, elementary.cos, elementary.tan, elementary.atan2, elementary.asin, elementary.acos),
    *(elementary.exp, elementary.log, elementary.hypot),
):
    _replace(getattr(math, _ours.__name__), _ours)


LOGGER: Final = logging.getLogger("vastflow.kernels")

_CHECKSUM_BYTES: Final = hashlib.sha256().digest_size
_OWN: Final = Path(__file__).parents[1]


class KernelCache(NullCache):  # type: ignore[misc]  # numba has no types
    """A kernel's compiled forms, each in a file with a checksum behind its content.

    A file's name tells the kernel, the types, and the processor. Of the kernel's source it tells the code alone: what else may
    change a form of the simulator's own kernels is in the folder's name. A plug-in's is told by its content.

    Args:
        function: The kernel as Python has it, from a file.
        folder: Folder of compiled kernels; made when there is one to keep.
    """

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        code = function.__code__
        self._folder, self._name = folder, f"{function.__module__}.{function.__qualname__}".replace(".<locals>", "")
        self._function = None if Path(code.co_filename).is_relative_to(_OWN) else function
        self._source = (sys.implementation.cache_tag, code.co_firstlineno, code.co_code)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel of a signature, or None if it is missing or damaged."""
        target_context.refresh()
        file = self._file(sig, target_context.codegen())
        content = None if file is None else _sound(file)
        return None if content is None else CompileResult._rebuild(target_context, *pickle.loads(content))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save the compiled kernel of a signature; if that is impossible, every process compiles its own."""
        file = self._file(sig, data.codegen)
        if data.lifted or data.library.has_dynamic_globals or file is None:
            return
        content, part = dumps(data._reduce()), self._folder / uuid.uuid4().hex
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            part.write_bytes(content + hashlib.sha256(content).digest())
            part.replace(file)
        except OSError as error:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            _log_that_nothing_is_kept(str(self._folder), str(error.strerror))

    def _file(self, sig: Any, codegen: Any) -> Path | None:
        """Return the file of a signature's compiled kernel; None if nothing tells when it is out of date."""
        # Now, as numba takes values of a plug-in's module when it compiles.
        content = content_of(self._function) if self._function else ""
        if content is None:
            return None
        key = hashlib.sha256(str((*map(spelled, sig), codegen.magic_tuple(), self._source, content)).encode())
        return self._folder / f"{self._name}.{key.hexdigest()[:16]}.nbc"


@functools.cache
def _log_that_nothing_is_kept(folder: str, reason: str) -> None:
    """Once for a folder, not for each of its hundreds of kernels."""
    LOGGER.warning("can't write to %r (%s): every process compiles the kernels again", folder, reason)


def _sound(file: Path) -> bytes | None:
    """Return a file's content without its checksum; remove all damaged files of its folder."""
    content = _content(file)
    if content is None or _is_whole(content):
        return content and content[:-_CHECKSUM_BYTES]
    damaged = [each for each in sorted(file.parent.glob("*.nbc")) if not _is_whole(_content(each))]
    for each in damaged:
        each.unlink(missing_ok=True)
    LOGGER.warning("%s: compiled kernels are damaged (files: %d) and compiled again", file.parent, len(damaged))
    return None


def _content(file: Path) -> bytes | None:
    with suppress(FileNotFoundError, NotADirectoryError):
        return file.read_bytes()
    return None


def _is_whole(content: bytes | None) -> bool:
    """True if a file's content ends with its checksum; a file removed by another process counts as sound."""
    return content is None or hashlib.sha256(content[:-_CHECKSUM_BYTES]).digest() == content[-_CHECKSUM_BYTES:]
