# SPDX-License-Identifier: Apache-2.0
"""Where a run stopped making sense: a part of the loop answered with what is no number."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

__all__ = ['Failure', 'failure_at', 'first_failure']


class Failure(NamedTuple):
    """The first value of a run that is not finite.

    Attributes:
        t: Time of the sample [s].
        joint: Name of the joint.
        what: What is not finite, in words.
    """

    t: float
    joint: str
    what: str

    def __str__(self) -> str:
        """Say it in a clause."""
        return f'the {self.what} of joint {self.joint!r} is not finite at {self.t:.6g} s'


def failure_at(t: float, values: np.ndarray, joints: Sequence[str], what: str) -> Failure | None:
    """Return the failure in the values of a sample, shape (n,); None where all are finite."""
    finite = np.isfinite(values)
    return None if finite.all() else Failure(t, joints[int(np.argmin(finite))], what)


def first_failure(times: np.ndarray, joints: Sequence[str],
                  named: Iterable[tuple[str, np.ndarray]]) -> Failure | None:
    """Return the first failure along a run.

    Args:
        times: Times of N samples, shape (N,) [s].
        joints: Names of the n joints.
        named: Quantities with their values, shape (N, n).
    """
    found = []
    for what, values in named:
        broken = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if broken.size:
            k = broken[0]
            found.append(failure_at(float(times[k]), values[k], joints, what))
    return min((each for each in found if each is not None), key=lambda each: each.t, default=None)
