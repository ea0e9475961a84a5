# SPDX-License-Identifier: Apache-2.0
"""Facts about arrays in tuples that a compiled function borrows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, jit


class Box(NamedTuple):
    """An array in a tuple, as the steps take them."""

    values: np.ndarray


@jit
def _sum_and_count_up(box: Box) -> float:
    box = borrowed(box)
    total = 0.0
    for _ in range(3):
        total += box.values[0]
        box.values[0] += 1.0
    return total


def test_borrowed_arrays_are_the_same_arrays():
    box = Box(np.zeros(2))
    assert _sum_and_count_up(box) == 3.0
    assert box.values.tolist() == [3.0, 0.0]
    assert borrowed(box) is box  # in Python it is what is given
