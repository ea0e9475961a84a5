# SPDX-License-Identifier: Apache-2.0
"""numba with what of it this room builds on, or that it is not there."""

from __future__ import annotations

from importlib.util import find_spec
import warnings

__all__ = ['AbstractTemplate', 'AttributeTemplate', 'binding', 'cgutils', 'compile_extra',
           'COMPILED', 'CompileResultCacheImpl', 'CPUDispatcher', 'environment', 'Flags',
           'FunctionCache', 'global_compiler_lock', 'impl_ret_borrowed', 'infer_getattr',
           'infer_global', 'ir', 'JITCodeLibrary', 'lookup_environment', 'lower_builtin',
           'lower_getattr', 'lower_getattr_generic', 'models', 'NativeValue', 'numba',
           'numba_event', 'register_model', 'rtsys', 'signature', 'sigutils', 'typeof_impl',
           'unbox']

try:
    import numba
    if find_spec('scipy') is None:  # numba's np.linalg is scipy's LAPACK
        raise ImportError('scipy')
    COMPILED: bool = not numba.config.DISABLE_JIT
except ImportError:  # plain numpy is the documented fallback
    numba = None
    COMPILED = False

if numba is not None:
    try:
        from llvmlite import binding, ir
        from numba.core import cgutils, environment, event as numba_event, sigutils
        from numba.core.caching import CompileResultCacheImpl, FunctionCache
        from numba.core.codegen import JITCodeLibrary
        from numba.core.compiler import compile_extra, Flags
        from numba.core.compiler_lock import global_compiler_lock
        from numba.core.environment import lookup_environment
        from numba.core.imputils import impl_ret_borrowed, lower_builtin, lower_getattr_generic
        from numba.core.registry import CPUDispatcher
        from numba.core.runtime import rtsys
        from numba.core.typing.templates import (
            AbstractTemplate,
            AttributeTemplate,
            infer_getattr,
            infer_global,
            signature,
        )
        from numba.extending import (
            lower_getattr,
            models,
            NativeValue,
            register_model,
            typeof_impl,
            unbox,
        )
    except ImportError as error:  # a version that has it elsewhere
        numba = None
        COMPILED = False
        warnings.warn(f'numba is installed but cannot be used ({error}): the laws run as plain '
                      'numpy, much slower', RuntimeWarning, stacklevel=2)
