# SPDX-License-Identifier: Apache-2.0
"""Facts about the parameters of the nodes that keep an arm safe."""

from __future__ import annotations

import pytest

from adaptive_blf_control.configuration.node_settings import (
    ControllerNodeSettings,
    DriverSettings,
)
from adaptive_blf_control.errors import ParameterError


@pytest.mark.parametrize(('kind', 'name'), [
    (DriverSettings, 'command_timeout'), (ControllerNodeSettings, 'state_timeout')])
def test_a_watchdog_is_on_by_default_and_cannot_be_switched_off(kind, name):
    assert getattr(kind(), name) == 0.1
    for off in (0.0, -1.0, 60.1, float('inf')):
        with pytest.raises(ParameterError, match=rf'{name}.*> 0 and <= 60 s|{name}.*finite'):
            kind(**{name: off})
