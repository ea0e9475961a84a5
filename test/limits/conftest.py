# SPDX-License-Identifier: Apache-2.0
"""Arms that several tests of the limits look at."""

from __future__ import annotations

import pytest

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.errors import ArmError


@pytest.fixture(scope='session')
def panda() -> UrdfArm:
    """Return the Panda of example-robot-data."""
    pytest.importorskip('pinocchio')
    try:
        return UrdfArm('package://example-robot-data/robots/panda_description/urdf/panda.urdf',
                       [f'panda_joint{i}' for i in range(1, 8)])
    except ArmError:
        pytest.skip('example-robot-data is not installed')
