# SPDX-License-Identifier: Apache-2.0
"""Facts about arms as compiled functions take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.regressors import arrays_of, law_regressor, regressors
from adaptive_blf_control.arms.three_link import ThreeLinkArm
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.compiled import jit


@jit
def _both(arm, q, qd, alpha, alpha_dot):
    return regressors(arm, q, qd), law_regressor(arm, q, qd, alpha, alpha_dot)


@pytest.fixture(params=['two', 'three', 'urdf'])
def arm(request, pair_urdf) -> Arm:
    if request.param == 'urdf':
        pytest.importorskip('pinocchio')
        from adaptive_blf_control.arms.load import load_arm
        return load_arm(pair_urdf)
    return TwoLinkArm() if request.param == 'two' else ThreeLinkArm()


def test_the_arrays_of_an_arm_give_the_regressors_of_its_methods(arm):
    q, qd, alpha, alpha_dot = np.random.default_rng(3).normal(size=(4, arm.n))
    both, x = _both(arrays_of(arm), q, qd, alpha, alpha_dot)
    np.testing.assert_array_equal(both, arm.Y12(q, qd))
    np.testing.assert_array_equal(x, arm.X(q, qd, alpha, alpha_dot))


class Lightened(TwoLinkArm):
    """Overrides what its arrays do not know of."""

    def X(self, q, qd, alpha, alpha_dot):
        return 0.5 * super().X(q, qd, alpha, alpha_dot)


class Named(TwoLinkArm):
    """Overrides nothing that counts."""

    def link_points(self, q):
        return np.zeros((1, 3))


def test_the_methods_of_a_subclass_count_before_its_arrays():
    assert arrays_of(Lightened()) is None
    assert arrays_of(Named()) == TwoLinkArm().arrays
    assert arrays_of(object()) is None


class Stranger(NamedTuple):
    """Of a type that nobody has registered."""

    parameters: int


@pytest.mark.parametrize('ask', [lambda arm, *state: regressors(arm, *state[:2]), law_regressor])
def test_an_arm_that_nobody_registered_is_named(ask):
    with pytest.raises(TypeError, match='registered for Stranger'):
        ask(Stranger(1), *np.zeros((4, 2)))
