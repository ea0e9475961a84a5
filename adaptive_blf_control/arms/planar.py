# SPDX-License-Identifier: Apache-2.0
"""What the planar arms share: names of their joints, and where their links are, for drawing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptive_blf_control.arms.arm import described, GuidedArm
from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.errors import ArmError

__all__ = ['PlanarArm', 'planar_points']


_WORDS = {2: 'two', 3: 'three'}


class PlanarArm(GuidedArm):
    """Names of a planar arm, as the `Arm` that inherits from it has them.

    Attributes:
        joints: Joint names, length n, in the order of every array.
        parameters: Parameter names, length m, in the order of θ.
    """

    joints: tuple[str, ...]
    parameters: tuple[str, ...]

    def __init__(self, arm: str, joints: Sequence[str], count: int) -> None:
        """Name the joints; ArmError unless they are ``count`` distinct names."""
        given = list(joints) if isinstance(joints, tuple) else joints
        names = tuple(given) if isinstance(given, list) else ()
        named = all(isinstance(name, str) and name for name in names)
        if not named or len(names) != count or len(set(names)) != count:
            raise ArmError(f'{arm} has {_WORDS[count]} joints: expected as many distinct names, '
                           f'got {given!r}')
        self.joints = names
        self._shape = (count,)

    def __repr__(self) -> str:
        """Name joints and count parameters."""
        return described(self, self.joints, self.parameters)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def m(self) -> int:
        """Number of parameters."""
        return len(self.parameters)


def planar_points(q: np.ndarray, lengths: Sequence[float]) -> np.ndarray:
    """Return the base and the far end of every link, shape (n + 1, 3) [m], in the x-y plane.

    Args:
        q: Joint positions, each relative to the link before, shape (n,) [rad].
        lengths: Link lengths, length n [m].

    Raises:
        ParameterError: ``q`` has another shape.
    """
    angles = np.cumsum(checked_array('q', q, (len(lengths),)))
    steps = np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    ends = np.cumsum(steps * np.array(lengths)[:, None], axis=0)
    return np.vstack([np.zeros((1, 3)), ends])
