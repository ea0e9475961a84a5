# SPDX-License-Identifier: Apache-2.0
"""Arrays as callers give them: lists, scalars, float32 become what the compiled laws take."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.errors import ParameterError

__all__ = ['checked_array']

_DOUBLE = np.dtype(np.float64)


def checked_array(name: str, value: Any, shape: tuple[int, ...], what: str = '') -> np.ndarray:
    """Return ``value`` as a contiguous float64 array of ``shape``; as it is where it is one.

    Args:
        name: What the caller calls it, for the message.
        value: A list, a scalar where one element is asked, or an array of any number type.
        shape: The shape that is needed; -1 stands for any length.
        what: What one element stands for, e.g. ``one for each of joint1, joint2``.

    Raises:
        ParameterError: the value holds no numbers, or has another shape.
    """
    if (type(value) is np.ndarray and value.dtype is _DOUBLE and value.shape == shape
            and value.flags.c_contiguous):
        return value
    try:
        if value is None:  # numpy would take it for NaN
            raise TypeError
        array = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ParameterError(name, value, f'numbers of shape {_text(shape)}') from None
    if np.ndim(value) == 0 and shape != (1,):
        array = array.reshape(())
    if array.ndim != len(shape) or any(
            wanted not in (-1, given) for wanted, given in zip(shape, array.shape)):
        suffix = f' ({what})' if what else ''
        raise ParameterError(name, f'of shape {array.shape}', f'shape {_text(shape)}{suffix}')
    return array


def _text(shape: tuple[int, ...]) -> str:
    return str(tuple('N' if length == -1 else length for length in shape)).replace("'", '')
