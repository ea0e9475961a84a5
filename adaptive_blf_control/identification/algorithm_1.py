# SPDX-License-Identifier: Apache-2.0
"""What compiled functions ask of a history, answered by the stack of Algorithm 1."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import borrowed, jit
from adaptive_blf_control.identification import history, history_step
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.stack_arrays import (
    clear_pairs,
    COUNT,
    Pairs,
    RANK,
    REVISION,
    SIZE,
)

__all__ = ['arrays_of_stack']


@jit
def _facts(pairs: Pairs) -> tuple[int, int, int, int]:
    pairs = borrowed(pairs)
    counters = pairs.counters
    return counters[COUNT], counters[SIZE], counters[RANK], counters[REVISION]


@jit
def _pairs(pairs: Pairs) -> tuple[np.ndarray, np.ndarray]:
    count = pairs.counters[COUNT]
    return pairs.regressors[:count], pairs.torques[:count]


@jit
def _sums(pairs: Pairs) -> tuple[np.ndarray, np.ndarray]:
    return pairs.gram, pairs.moment


history.offer.register(Pairs, history_step.offer)
history.forget_pairs.register(Pairs, clear_pairs)
history.facts.register(Pairs, _facts)
history.pairs.register(Pairs, _pairs)
history.sums.register(Pairs, _sums)


def arrays_of_stack(stack: HistoryStack) -> Pairs:
    """Return a stack as compiled functions take it; :meth:`HistoryStack.resize` replaces it."""
    return stack.pairs
