# SPDX-License-Identifier: Apache-2.0
"""Facts about the check of gains against the delay of a loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.node_settings import (
    ControllerNodeSettings,
    DriverSettings,
)
from adaptive_blf_control.configuration.parameter_file import load_yaml, node_settings
from adaptive_blf_control.control.loop_settings import LoopSettings
from adaptive_blf_control.control.reference import Posture
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.tuning.loop_check import check_loop, LoopCheck, warnings_of_loop
from adaptive_blf_control.tuning.loop_delay import loop_delay
from adaptive_blf_control.tuning.stated_loop import simulated_delay, stated_delay

ARM = TwoLinkArm()


def check(k2: list[float], delay: float = 0.0, **changes: object) -> LoopCheck:
    settings = ControllerSettings(**{'k1': [1.0], 'k2': k2, **changes})
    found = check_loop(ARM, settings, Posture([0.0, 0.4]), ARM.nominal, loop_delay(1000.0, delay))
    assert found is not None
    return found


def of_config(repository: Path, name: str, delay: float = 0.0) -> LoopCheck:
    data = load_yaml(repository / 'config' / f'{name}.yaml')
    loop, simulated = build_closed_loop(data), simulated_delay(node_settings(data, DriverSettings))
    found = check_loop(loop.arm, loop.controller.settings, loop.controller.reference,
                       loop.initial_estimate, simulated.longer(loop_delay(1000.0, delay)))
    assert found is not None
    return found


@pytest.mark.parametrize('name', ['two_link', 'two_link_paper', 'two_link_payload_step',
                                  'three_link', 'three_link_paper', 'three_link_encoder'])
def test_the_scenarios_are_stable_in_their_own_loop(repository: Path, name: str) -> None:
    assert not of_config(repository, name).unstable


def test_the_papers_gains_for_three_links_are_unstable_from_2_ms_of_delay_on(
        repository: Path) -> None:
    """It chatters with delays of 2 ms and more, as its file says; ours has 20 ms of room."""
    assert of_config(repository, 'three_link_paper', 2e-3).unstable
    assert not of_config(repository, 'three_link', 2e-3).unstable
    assert not of_config(repository, 'two_link', 20e-3).unstable


def test_good_gains_raise_no_word() -> None:
    assert list(check([10.0, 3.0]).problems()) == []


@pytest.mark.parametrize('part', [1.02, 3.0, 50.0])
def test_gains_beyond_the_limit_are_named_with_gains_that_would_do(part: float) -> None:
    limit = check([10.0, 3.0], 4e-3)
    k2 = (part * limit.delay.largest_rate / limit.rate * limit.k2).tolist()
    found = check(k2, 4e-3)
    assert found.unstable
    with pytest.raises(ParameterError, match='λ_max') as caught:
        found.refuse_unstable()
    assert caught.value.name == 'controller.k2'
    assert '4.5 ms of delay at 1000 Hz' in str(caught.value)
    assert 'joint2' in str(caught.value)
    better = check(np.minimum(found.k2, found.fitting_k2).tolist(), 4e-3)
    assert not better.unstable
    assert list(better.problems()) == []


def test_a_barrier_too_stiff_for_a_light_joint_is_named_with_a_weight_that_would_do() -> None:
    gains = {'performance': {'lower': -0.02, 'upper': 0.02}}
    found = check([10.0, 3.0], 4e-3, **gains)
    assert found.rate < 0.2 * found.delay.largest_rate
    assert found.unstable
    with pytest.raises(ParameterError, match="joint 'joint2' has a phase margin of -") as caught:
        found.refuse_unstable()
    assert caught.value.name == 'controller.barrier_weight'
    weight = np.minimum(found.weight, found.fitting_weight)
    assert list(check([10.0, 3.0], 4e-3, barrier_weight=weight, **gains).problems()) == []


def test_a_k1_too_fast_for_a_wide_performance_set_is_named_with_one_that_would_do() -> None:
    gains = {'performance': {'lower': -3.0, 'upper': 3.0}}
    found = check([10.0, 3.0], 4e-3, k1=20.0, **gains)
    assert found.unstable
    with pytest.raises(ParameterError, match='k1 b⁴') as caught:
        found.refuse_unstable()
    assert caught.value.name == 'controller.k1'
    k1 = np.minimum(found.k1, found.fitting_k1)
    assert list(check([10.0, 3.0], 4e-3, k1=k1, **gains).problems()) == []


def test_half_of_the_viscous_friction_is_not_counted_as_damping() -> None:
    """p1 to p3 of the arm are the same: only its joints rub less."""
    smooth = TwoLinkArm()
    vars(smooth)['nominal'] = np.array([*ARM.nominal[:3], 0.0, 0.0])  # closed to others
    k2 = np.array([10.0, 3.0])
    rough = check((k2 + 0.5 * ARM.nominal[3:]).tolist())
    settings = ControllerSettings(k2=k2)
    assert rough.rate == pytest.approx(check_loop(
        smooth, settings, Posture([0.0, 0.4]), smooth.nominal, loop_delay(1000.0)).rate)


def test_unstable_gains_are_warned_of_or_refused_as_the_settings_say() -> None:
    found = check([5000.0, 3000.0])
    assert 'is unstable from 2000 1/s' in ' '.join(warnings_of_loop(found, 'warn'))
    with pytest.raises(ParameterError):
        list(warnings_of_loop(found, 'refuse'))
    assert 'nothing is known' in ' '.join(warnings_of_loop(None, 'refuse'))


def test_the_loop_is_as_late_as_stated_or_simulated() -> None:
    stated = stated_delay(LoopSettings(rate=500.0, delay=0.004, velocity_lag=0.001))
    assert stated == (0.002, 0.004, 0.001)
    assert stated_delay(ControllerNodeSettings().loop) == (0.001, 0.0, 0.0)
    sensors = {'model': 'encoder', 'velocity_time_constant': 0.006}
    driver = DriverSettings(rate=1000.0, dead_time=3, sensors=sensors)
    assert simulated_delay(driver) == pytest.approx((0.001, 0.003, 0.0065))
    assert simulated_delay(DriverSettings()) == (0.001, 0.0, 0.0)
    late = DriverSettings(rate=500.0, actuator={'delay': 0.003, 'jitter': 0.001})
    assert simulated_delay(late) == pytest.approx((0.002, 0.004, 0.0))
    assert stated.longer(simulated_delay(driver)) == pytest.approx((0.002, 0.004, 0.0065))
