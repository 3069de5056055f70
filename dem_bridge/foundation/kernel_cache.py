"""Keep compiled kernels on disk: one file for each content, of which nothing is loaded that is not as it was written.

A file is named after the digest of everything that determines its machine code: the closure of the kernel
(:mod:`.kernel_content`), the types of its arguments, the versions of Python, numba, llvmlite, numpy and this package,
the processor, and the settings of numba. A changed kernel therefore has another file, whatever the times of its sources
say. The file begins with a checksum over its name and content. A file that does not fit is set aside, and its kernel is
compiled anew. Files are written under another name and renamed, so that processes may compile a kernel at once.
"""

from __future__ import annotations

import hashlib
import importlib
import io
import os
import pickle
import re
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, cast

import llvmlite
import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core import environment as environments
from numba.core import types
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.environment import Environment
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from dem_bridge.errors import OF_DAMAGED_DATA
from dem_bridge.foundation.kernel_content import Unidentified, closure_digest
from dem_bridge.foundation.kernel_folders import (
    DAMAGED,
    SUFFIX,
    folder_to_write,
    folders_to_read,
    kept_content,
    say,
    write_kept,
)
from dem_bridge.version import __version__

_SETTING = (bool, int, float, str, tuple, list, type(None))
#: settings of numba that change no code: where it keeps files, what it prints, threads, other processors
_NOT_CODE = re.compile(
    r"(_|CACHE|CHROME_TRACE|COLOR|CUDA|DEBUG_CACHE|DEVELOPER|DISABLE_CUDA|DISABLE_PERF|DISABLE_TYPEINFER|DUMP|ENABLE_CUDA"
    r"|FORCE_CUDA|FULL_TRACE|FUNCTION_CACHE|GDB|HIGHLIGHT|HTML|LLVM_PASS_TIMINGS|NUMBA_DEFAULT_NUM|NUMBA_NUM|SHOW_HELP"
    r"|THREADING|TRACE)"
)

#: part of the name of the numbers by which machine code hashes texts
_HASH_SECRET = b"_numba_hashsecret"
#: numba's own, which have no types
_rebuild, _dumps = cast(Any, CompileResult)._rebuild, cast(Any, dumps)
_rebuild_environment = cast(Any, environments)._rebuild_env


#: number of the form of a file
FORMAT = 2


@cache
def _prepare_compiler() -> None:
    """Prepare numba for compiling, with what other packages add to it.

    It looks for the routines of scipy.linalg when a function needs them, and not at once, for 0.2 s.
    """
    from numba.core import entrypoints
    from numba.np import linalg

    ensure, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    try:
        importlib.import_module("numba.np.arraymath")  # where numba asks whether they are there
    finally:
        linalg.ensure_blas = ensure
    cast(Any, entrypoints).init_all()


def compile_function(function: Callable[..., Any], *, nogil: bool) -> Any:
    """Return a function as numba compiles it when it is called, or as it is loaded from disk."""
    dispatcher: Any = numba.njit(nogil=nogil)(function)
    if hasattr(dispatcher, "targetctx"):  # else the compiler is switched off
        dispatcher._cache = KernelCache(dispatcher)
        # the search among all installed packages for extensions of numba is left until something is compiled
        dispatcher._compilation_chain_init_hook = lambda: None
    return dispatcher


class _Unpickler(pickle.Unpickler):
    """Load a compiled form without the modules of numba that its compiler has functions from."""

    def find_class(self, module: str, name: str) -> Any:
        return _environment if name == _rebuild_environment.__name__ else super().find_class(module, name)


def _environment(module: str, constants: list[Any], name: str) -> Any:
    """Return what a compiled function reads from its module: nothing of a module of numba, which is not imported."""
    if constants or not module.startswith("numba."):
        return _rebuild_environment(module, constants, name)
    found = Environment._memo.get(name)
    if found is None:
        found = Environment({"__name__": module})
        found.env_name = name
        Environment._memo[name] = found
    return found


class KernelCache(NullCache):
    """The compiled forms of one function on disk, in the interface that numba asks for."""

    def __init__(self, dispatcher: Any) -> None:
        self._function, self._options = dispatcher.py_func, dispatcher.targetoptions

    @property
    def cache_path(self) -> str | None:
        """Folder to which kernels are written; None: there is none."""
        folder = folder_to_write()
        return None if folder is None else str(folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled form for a signature; None if it is not there.

        A compiled form needs numba's memory management, and not the rules of its compiler, which take 0.1 s to import:
        the compiler asks for them itself.
        """
        rtsys.initialize(target_context)
        name = self._name(sig, target_context.codegen())
        for path in [] if name is None else [folder / name for folder in folders_to_read()]:
            try:
                content = kept_content(path)
                if _HASH_SECRET in content:
                    importlib.import_module("numba.cpython.hashing")  # which defines it
                (library, symbols), *parts = _Unpickler(io.BytesIO(content)).load()
                result = _rebuild(_Context(target_context, symbols), library, *parts)
                result = result._replace(target_context=target_context)
            except FileNotFoundError:
                continue
            except OSError as error:
                _set_aside(path, error.strerror or type(error).__name__)
            except (*OF_DAMAGED_DATA, ImportError, EOFError, pickle.UnpicklingError) as error:
                _set_aside(path, str(error) or type(error).__name__)
            else:
                with suppress(OSError):  # in a folder that may only be read, files have no last use
                    os.utime(path)
                return result
        _prepare_compiler()
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the compiled form of a signature, unless it holds addresses of this process."""
        folder, name = folder_to_write(), self._name(sig, data.codegen)
        local = data.library.has_dynamic_globals or any(not loop.can_cache for loop in data.lifted)
        if folder is None or name is None or local:
            return
        try:
            library, *parts = data._reduce()
            write_kept(folder / name, _dumps(((library, _symbols(data.library)), *parts)))
        except OSError as error:
            _say_once(
                f"the compiled kernel {name} cannot be kept ({error.strerror}); the next session compiles it again"
            )

    def _name(self, sig: Any, codegen: Any) -> str | None:
        """Return the name of the file of a signature; None for a kernel that cannot be identified."""
        function = self._function
        try:
            parts = closure_digest(function), _text_of_types(sig), sorted(self._options.items()), codegen.magic_tuple()
        except Unidentified:
            return None
        digest = hashlib.sha256(repr((FORMAT, parts, environment())).encode()).hexdigest()
        readable = re.sub(r"[^\w.]", "", f"{function.__module__}.{function.__qualname__}")[-80:]
        return f"{readable}-{digest[:40]}{SUFFIX}"


class _Context:
    """A target in whose libraries a kept kernel is loaded without the code that others may take in.

    Only a kernel that is compiled needs that code of one that it calls: it is read when it is asked for, which takes as
    long as the rest. The names of the symbols are kept beside it.
    """

    def __init__(self, context: Any, symbols: frozenset[str]) -> None:
        self._context, self._symbols = context, symbols

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def codegen(self) -> Any:
        """Return the generator of code, whose only use here is to load a library."""
        return self

    def unserialize_library(self, state: tuple[str, str, tuple[bytes, bytes]]) -> Any:
        """Return a library with its machine code."""
        name, _, (machine_code, bitcode) = state
        codegen = self._context.codegen()
        library = codegen.create_library(name)
        library.enable_object_caching()
        library._set_compiled_object(machine_code)
        library._finalize_final_module()
        codegen._engine._defined_symbols |= self._symbols
        of_library = library._get_module_for_linking

        def module_for_linking() -> Any:
            if library._shared_module is None:
                library._shared_module = llvm.parse_bitcode(bitcode)
            return of_library()

        library._get_module_for_linking = module_for_linking
        return library


def _symbols(library: Any) -> frozenset[str]:
    """Return the names that a library defines."""
    module = library._get_module_for_linking()
    parts = (*module.functions, *module.global_variables)
    return frozenset(part.name for part in parts if not part.is_declaration)


def environment() -> Mapping[str, object]:
    """Return what determines all machine code beside kernels and processor: versions and the settings of numba."""
    settings = {
        name: repr(value)
        for name, value in vars(numba.config).items()
        if name.isupper() and isinstance(value, _SETTING) and not _NOT_CODE.match(name)
    }
    return {**_versions(), "settings": sorted(settings.items())}


@cache
def _versions() -> Mapping[str, str]:
    python = f"{sys.implementation.cache_tag} {'.'.join(map(str, sys.version_info))} {sys.abiflags}"
    packages = {"numba": numba.__version__, "llvmlite": llvmlite.__version__, "numpy": np.__version__}
    return {"python": python, **packages, "dem_bridge": __version__}


def _text_of_types(kind: Any) -> str:
    """Return a type, or a tuple of types, as a text; with the fields of named tuples and the content of functions."""
    if isinstance(kind, tuple):
        return f"({', '.join(map(_text_of_types, kind))})"
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        name = getattr(parts, "instance_class", tuple).__qualname__
        return f"{name} {getattr(parts, 'fields', ())} {_text_of_types(tuple(parts.types))}"
    if isinstance(kind, types.Dispatcher):
        return f"function {closure_digest(kind.dispatcher.py_func)} {sorted(kind.dispatcher.targetoptions.items())}"
    if isinstance(kind, types.Callable | types.FunctionType | types.ClassType | types.ClassInstanceType):
        raise Unidentified(f"the type {kind} has no content")
    return f"{type(kind).__name__} {kind}"


def _set_aside(path: Path, reason: str) -> None:
    aside = path.with_name(f"{path.name}-{os.urandom(2).hex()}{DAMAGED}")
    with suppress(OSError):  # a folder that may only be read
        path.replace(aside)
    _say_once(f"the compiled kernel {path} is damaged ({reason}); it is set aside as {DAMAGED} and compiled anew")


@cache
def _say_once(text: str) -> None:
    say(text)
