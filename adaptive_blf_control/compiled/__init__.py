# SPDX-License-Identifier: Apache-2.0
"""Pure array functions, compiled with numba where numba is installed.

The laws are written as functions over float64 arrays in the subset numba compiles. Without numba
(or with ``NUMBA_DISABLE_JIT=1``) the very same functions run as plain numpy.
"""

from adaptive_blf_control.compiled.decorators import (
    by_type,
    ByType,
    entry_for,
    jit,
    jit_apart,
    jit_without_gil,
    jitable,
    uncompiled,
)
from adaptive_blf_control.compiled.library import COMPILED
from adaptive_blf_control.compiled.local_arrays import local_zeros
from adaptive_blf_control.compiled.notices import (
    around_each_compilation,
    around_own_compilations,
    before_each_compilation,
)
from adaptive_blf_control.compiled.references import borrowed, Handle, handle
from adaptive_blf_control.compiled.scalars import (
    all_finite,
    assign_vector,
    both_finite,
    cos_sin,
    is_within,
)
from adaptive_blf_control.compiled.vectors import (
    add_four,
    add_multiple,
    combine_rows,
    dot,
    fold_row,
)

__all__ = ['ByType', 'COMPILED', 'Handle', 'add_four', 'add_multiple', 'all_finite',
           'assign_vector', 'both_finite',
           'around_each_compilation', 'around_own_compilations', 'before_each_compilation',
           'borrowed', 'by_type', 'combine_rows', 'cos_sin', 'dot', 'entry_for', 'fold_row',
           'handle', 'is_within', 'jit', 'jit_apart', 'jit_without_gil', 'jitable', 'local_zeros',
           'uncompiled']
