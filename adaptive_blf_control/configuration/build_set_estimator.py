# SPDX-License-Identifier: Apache-2.0
"""Build what watches the set of θ*, as ``identifier.parameter_set`` asks."""

from __future__ import annotations

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.node_settings import (
    ControllerNodeSettings,
    IdentifierNodeSettings,
)
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.prior import stated_prior
from adaptive_blf_control.limits.set_estimator import SetEstimator

__all__ = ['build_set_estimator', 'check_learns']


def build_set_estimator(settings: IdentifierNodeSettings, arm: Arm) -> SetEstimator | None:
    """Return the estimator of an arm; None where ``parameter_set.period`` is 0.

    Raises:
        ParameterError: the prior cannot be one of this arm.
    """
    given = settings.parameter_set.resolved(joints=arm.n)
    if given.period == 0.0:
        return None
    return SetEstimator(stated_prior(arm, given.prior), given.prior.unexplained, given.period)


def check_learns(controller: ControllerNodeSettings,
                 estimator: SetEstimator | None) -> SetEstimator | None:
    """Return the estimator where the controller's safety filter learns from it, None where not.

    Raises:
        ParameterError: it learns, and there is no estimator.
    """
    if controller.safety_filter == 'none' or not controller.limits.learn:
        return None
    if estimator is None:
        raise ParameterError('identifier.parameter_set.period', 0.0,
                             'a time > 0 s, because controller.limits.learn is on')
    return estimator
