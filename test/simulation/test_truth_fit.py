# SPDX-License-Identifier: Apache-2.0
"""θ* as a least-squares fit: exact where the parameters express the plant, else with a rest."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.simulation.truth_fit import fit_truth

ARM = TwoLinkArm()


def test_the_parameters_of_a_plant_of_ours_come_back():
    fit = fit_truth(ARM, ARM.parameters,
                    lambda q, qd, qdd: inverse_dynamics(ARM, ARM.nominal, q, qd, qdd))
    np.testing.assert_allclose(fit.theta, ARM.nominal, rtol=1e-12)
    assert fit.unexpressed.max() < 1e-13


def test_parameters_in_another_order_and_unknown_ones_are_matched_by_name():
    names = ('f0_joint1', *reversed(ARM.parameters))
    fit = fit_truth(ARM, names,
                    lambda q, qd, qdd: inverse_dynamics(ARM, ARM.nominal, q, qd, qdd))
    np.testing.assert_allclose(fit.theta, [0.0, *ARM.nominal[::-1]], rtol=1e-12)


def test_what_no_parameter_expresses_is_left_over_in_its_joint():
    """A torque cos(3 q₂) on joint 2 has RMS 1/√2, and next to nothing of it looks like θ."""
    def torque(q, qd, qdd):
        return inverse_dynamics(ARM, ARM.nominal, q, qd, qdd) + [0.0, np.cos(3.0 * q[1])]

    fit = fit_truth(ARM, ARM.parameters, torque)
    assert fit.residual[0] < 0.3
    np.testing.assert_allclose(fit.residual[1], np.sqrt(0.5), rtol=0.2)
