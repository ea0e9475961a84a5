# SPDX-License-Identifier: Apache-2.0
"""Facts about the simulated sensors: counts, the filtered difference, seeded noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.sensors import made_sensor, Measurement, Sensor
from adaptive_blf_control.simulation.settings import SensorSettings

STEP = 2.0 * math.pi / 200000.0  # 2000 counts behind 1:100
ENCODER = SensorSettings(model='encoder', encoder_counts=2000, gear_ratio=100.0,
                         velocity_time_constant=0.005)
DT = 1e-3
ARM = TwoLinkArm()


def measured(settings: SensorSettings, q: np.ndarray, torque: float = 0.0):
    """Measure two joints at the positions q, DT apart; return what the first one shows."""
    sensor = made_sensor(settings, ARM)
    rows = [sensor.measure(np.array([x, 0.0]), np.zeros(2), np.array([torque, 0.0]),
                           DT if k else 0.0) for k, x in enumerate(q)]
    return [np.array([row[i][0] for row in rows]) for i in range(3)]


def test_positions_are_whole_counts_at_most_half_a_count_off():
    q = np.random.default_rng(1).uniform(-3.0, 3.0, 500)
    seen, _, _ = measured(ENCODER, q)
    assert made_sensor(ENCODER, ARM).resolution == pytest.approx(STEP)
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
    state = np.array([0.1, 0.2]), np.array([0.2, 0.3]), np.array([0.3, 0.4])
    assert made_sensor(SensorSettings(), ARM).measure(*state, 0.0) == state


def test_an_interval_of_no_time_has_no_difference():
    sensor = made_sensor(ENCODER, ARM)
    velocity, rest = np.array([0.5, -0.2]), np.zeros(2)
    sensor.measure(rest, velocity, rest, DT)
    again = sensor.measure(rest + 0.1, velocity, rest, 0.0)
    np.testing.assert_array_equal(again.qd, velocity)
    assert np.isfinite(sensor.measure(rest + 0.2, velocity, rest, DT)).all()


def test_torque_noise_goes_with_any_model():
    noisy = ENCODER.replace(torque_noise=0.1)
    rest, torque = np.zeros(2), np.array([1.0, 2.0])
    seen = made_sensor(noisy, ARM).measure(rest + 0.3 * STEP, rest, torque, 0.0)
    np.testing.assert_array_equal(seen.q, rest)
    assert (seen.torque != torque).all()
    assert np.abs(seen.torque - torque).max() < 1.0


class Offset(Sensor):
    """A sensor of the user's that needs nothing but `measure`."""

    def __init__(self, settings=None, arm=None):
        pass

    def measure(self, q, qd, torque, dt):
        return Measurement(q + 0.1, qd, torque)


@pytest.mark.parametrize('given', [Offset, Offset()])
def test_a_sensor_of_the_users_is_given_as_an_object_or_a_class(given):
    sensor = made_sensor(SensorSettings(), ARM, given)
    np.testing.assert_array_equal(
        sensor.measure(np.zeros(2), np.ones(2), np.ones(2), 0.0).q, [0.1, 0.1])
    np.testing.assert_array_equal(sensor.position(np.ones(2)), np.ones(2))


class Short(Offset):
    """Leaves a joint out."""

    def measure(self, q, qd, torque, dt):
        return Measurement(q[:1], qd, torque)


class Wordless(Offset):
    """Answers with no measurement."""

    def measure(self, q, qd, torque, dt):
        return q


@pytest.mark.parametrize(('kind', 'message'), [
    (Short, r'Short: q.*shape \(2,\)'), (Wordless, r'Wordless\.measure.*a Measurement')])
def test_a_sensor_that_measures_something_else_is_refused(kind, message):
    with pytest.raises(ParameterError, match=message):
        made_sensor(SensorSettings(), ARM, kind).measure(np.zeros(2), *np.ones((2, 2)), 0.0)


def test_what_is_no_sensor_is_refused():
    with pytest.raises(ParameterError, match=r"'sensor'.*object has no measure, position"):
        made_sensor(SensorSettings(), ARM, object())


@pytest.mark.parametrize(('name', 'value'), [
    ('encoder_counts', 0), ('encoder_counts', -2000), ('gear_ratio', 0.0),
    ('gear_ratio', float('nan')), ('velocity_time_constant', -1e-3), ('torque_noise', -0.1),
    ('torque_noise', float('inf'))])
def test_sensors_that_cannot_be_are_refused_by_name(name, value):
    with pytest.raises(ParameterError, match=rf'arm_driver\.sensors\.{name}'):
        SensorSettings(**{'encoder_counts': 2000, name: value})
