# SPDX-License-Identifier: Apache-2.0
"""Facts about the search for exchanged positions: when it begins, and what it costs."""

from __future__ import annotations

import numpy as np
import pytest

import adaptive_blf_control as blf
from adaptive_blf_control.identification.exchange_check import exchange_finding, MOST_JOINTS
from adaptive_blf_control.identification.finding import Excerpt
from adaptive_blf_control.identification.settings import IdentifierSettings

ARM = blf.TwoLinkArm()
SETTINGS = IdentifierSettings(filter={'time_constant': 0.02})


@pytest.fixture(scope='module')
def log():
    t = 1e-3 * np.arange(3000)
    w = np.array([3.0, 7.0])
    q, qd = 0.5 * np.sin(np.outer(t, w)), 0.5 * w * np.cos(np.outer(t, w))
    tau = np.array([ARM.X(*row) @ ARM.nominal for row in zip(
        q, qd, qd, -0.5 * w ** 2 * np.sin(np.outer(t, w)))])
    return Excerpt(t, q, qd, tau, 1e-3, np.ones(2999, dtype=bool))


def asked(log, factor=1.0):
    """Return the finding, and how often a trial was compared with the masses."""
    trials = []

    def nominal_of(pairs, arm):
        trials.append(pairs)
        return factor * pairs.regressors @ arm.nominal

    return exchange_finding(log, ARM, SETTINGS, nominal_of), len(trials)


def test_a_log_that_fits_as_given_costs_one_trial(log):
    assert asked(log) == (None, 1)


def test_a_poor_fit_that_no_exchange_explains_is_not_told(log):
    strange = log._replace(tau=np.random.default_rng(0).normal(size=log.tau.shape))
    assert asked(strange) == (None, 2)


def test_arms_of_many_joints_are_not_searched(log):
    class Long:
        joints = tuple(map(str, range(MOST_JOINTS + 1)))

    assert exchange_finding(log, Long(), SETTINGS, lambda pairs, arm: 1 / 0) is None
