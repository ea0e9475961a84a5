# SPDX-License-Identifier: Apache-2.0
"""Arrays of a run in a file of NumPy."""

from __future__ import annotations

from collections.abc import Mapping
import os
from pathlib import Path

import numpy as np

from adaptive_blf_control.errors import ParameterError

__all__ = ['save_arrays']


def save_arrays(path: str | os.PathLike[str], arrays: Mapping[str, np.ndarray]) -> Path:
    """Write arrays by name; a file that exists is replaced once all of it is written.

    Args:
        path: A file that ends in ``.npz``.
        arrays: What is written.

    Raises:
        ParameterError: the path ends otherwise or cannot be written.
    """
    target = Path(path) if isinstance(path, (str, os.PathLike)) else Path()
    if target.suffix.lower() != '.npz':
        raise ParameterError('path', path, "a file that ends in .npz, such as 'run.npz'")
    part = target.with_name(f'.{target.name}.{os.getpid()}.npz')
    try:
        with part.open('wb') as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        part.replace(target)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise ParameterError('path', str(target),
                             f'a file that can be written ({error.strerror})') from None
    return target
