# SPDX-License-Identifier: Apache-2.0
"""The largest error of the predicted torque that a test may show, for scripts and CI."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any, NamedTuple

from adaptive_blf_control.errors import ParameterError

__all__ = ['RmseRequirement']


class RmseRequirement(NamedTuple):
    """A bound on the RMSE of the filtered torque of each joint over the test span.

    Attributes:
        bound: In N·m, or as a part of the RMS of the torque itself.
        relative: Whether it is such a part.
    """

    bound: float
    relative: bool

    @classmethod
    def of(cls, text: str) -> RmseRequirement:
        """Read ``0.5`` [N·m] or ``5%``; ParameterError where it is neither."""
        relative = text.strip().endswith('%')
        try:
            value = float(text.strip().removesuffix('%')) / (100.0 if relative else 1.0)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and value > 0.0):
            raise ParameterError('--require-rmse', text, 'a torque in N·m, or a part as in 5%')
        return cls(value, relative)

    def missed(self, figures: Mapping[str, Any]) -> list[str]:
        """Say which joints miss it; all of them where nothing was tested."""
        missed = []
        for joint, rmse, torque in zip(figures['joints'], figures['test_rmse'],
                                       figures['test_torque_rms'], strict=True):
            if rmse is None:
                missed.append(f'{joint}: not tested')
                continue
            bound = self.bound * (torque if self.relative else 1.0)
            if not rmse <= bound:
                missed.append(f'{joint}: {rmse:.4g} N·m, more than {bound:.4g} N·m')
        return missed
