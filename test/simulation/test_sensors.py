# SPDX-License-Identifier: Apache-2.0
"""Facts about the simulated sensors: counts, the filtered difference, seeded noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.sensors import resolution, Sensors
from adaptive_blf_control.simulation.settings import SensorSettings

STEP = 2.0 * math.pi / 200000.0  # 2000 counts behind 1:100
ENCODER = SensorSettings(model='encoder', encoder_counts=2000, gear_ratio=100.0,
                         velocity_time_constant=0.005)
DT = 1e-3


def measured(settings: SensorSettings, q: np.ndarray, torque: float = 0.0):
    """Measure one joint at the positions q, DT apart."""
    sensors = Sensors(settings)
    rows = [sensors.measure(np.array([x]), np.zeros(1), np.array([torque]), DT if k else 0.0)
            for k, x in enumerate(q)]
    return [np.array([row[i][0] for row in rows]) for i in range(3)]


def test_positions_are_whole_counts_at_most_half_a_count_off():
    q = np.random.default_rng(1).uniform(-3.0, 3.0, 500)
    seen, _, _ = measured(ENCODER, q)
    assert resolution(ENCODER) == pytest.approx(STEP)
    np.testing.assert_allclose(seen / STEP, np.round(q / STEP), atol=1e-6)
    assert np.abs(seen - q).max() <= 0.5 * STEP * (1.0 + 1e-9)


def test_velocity_is_the_difference_of_counts_behind_the_stated_filter():
    q = 0.3 * np.sin(2.0 * np.arange(400) * DT)
    seen, velocity, _ = measured(ENCODER, q)
    state, keep = 0.0, math.exp(-DT / 0.005)
    for k in range(1, len(q)):
        state = keep * state + (1.0 - keep) * (seen[k] - seen[k - 1]) / DT
        assert velocity[k] == pytest.approx(state, abs=1e-12)


def test_velocity_lags_by_its_time_constant_and_half_a_sample():
    t = np.arange(4000) * DT
    _, velocity, _ = measured(ENCODER, 0.5 * t ** 2)  # true velocity t
    lag = np.mean(t[2000:] - velocity[2000:])
    assert lag == pytest.approx(0.005, abs=0.6e-3)


def test_without_a_filter_the_velocity_is_the_bare_difference():
    bare = SensorSettings(model='encoder', encoder_counts=2000, gear_ratio=100.0,
                          velocity_time_constant=0.0)
    seen, velocity, _ = measured(bare, np.linspace(0.0, 0.1, 50))
    np.testing.assert_allclose(velocity[1:], np.diff(seen) / DT)


def test_torque_noise_has_its_deviation_and_its_seed():
    def noise(seed: int) -> np.ndarray:
        settings = SensorSettings(torque_noise=0.02, seed=seed)
        return measured(settings, np.zeros(20000), torque=3.0)[2] - 3.0
    first = noise(4)
    assert np.std(first) == pytest.approx(0.02, rel=0.03)
    assert abs(np.mean(first)) < 1e-3
    np.testing.assert_array_equal(first, noise(4))
    assert not np.array_equal(first, noise(5))


def test_perfect_sensors_pass_everything_on():
    state = np.array([0.1]), np.array([0.2]), np.array([0.3])
    assert Sensors(SensorSettings()).measure(*state, 0.0) == state


@pytest.mark.parametrize(('name', 'value'), [
    ('encoder_counts', 0), ('encoder_counts', -2000), ('gear_ratio', 0.0),
    ('gear_ratio', float('nan')), ('velocity_time_constant', -1e-3), ('torque_noise', -0.1),
    ('torque_noise', float('inf'))])
def test_absurd_sensors_are_refused_by_name(name, value):
    with pytest.raises(ParameterError, match=rf'arm_driver\.sensors\.{name}'):
        SensorSettings(**{'encoder_counts': 2000, name: value})
