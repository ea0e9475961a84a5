# SPDX-License-Identifier: Apache-2.0
"""What is measured of a simulated arm: the true state, encoder counts, or a sensor of the user's.

Noise of the measured torque is a part of its own, in front of any of them.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
import math
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arrays import checked_array, record
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.parameters.plugin import load_plugin, made, require_call
from adaptive_blf_control.simulation.settings import SensorSettings
from adaptive_blf_control.simulation.step import (
    encoder_step,
    in_counts,
    new_encoder_state,
    SensorArrays,
)

__all__ = ['Encoder', 'Measurement', 'NoisyTorque', 'PerfectSensor', 'Sensor', 'made_sensor',
           'sensor_arrays', 'torque_noise']

_REQUIRED = ('measure', 'position')


@record
class Measurement(NamedTuple):
    """Measured q [rad], q̇ [rad/s] and τ [N·m], each of shape (n,)."""

    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray


class Sensor(Protocol):
    """What is measured of a simulated arm, made as ``sensor(settings, arm)``.

    The settings are those of ``arm_driver.sensors``; it is made again when one of them changes.
    A class that inherits from it needs no more than ``measure``.
    """

    @abstractmethod
    def measure(self, q: np.ndarray, qd: np.ndarray, torque: np.ndarray,
                dt: float) -> Measurement:
        """Measure the true state, once a sample; the arrays given are not to be changed.

        Args:
            q: True positions, shape (n,) [rad].
            qd: True velocities, shape (n,) [rad/s].
            torque: Mean torque over the interval that ends now, shape (n,) [N·m]; NaN where the
                brakes hold.
            dt: Length of that interval [s], 0 for the first sample.
        """
        ...

    def position(self, q: np.ndarray) -> np.ndarray:
        """Return what would be shown of true positions q, (n,) [rad], without taking a sample."""
        return q


class PerfectSensor(Sensor):
    """The true state."""

    def __init__(self, settings: SensorSettings, arm: Arm) -> None:
        """Take the settings and the arm; it needs neither."""

    def measure(self, q: np.ndarray, qd: np.ndarray, torque: np.ndarray,
                dt: float) -> Measurement:
        """Return what is given; see `Sensor`."""
        return Measurement(q, qd, torque)


class Encoder(Sensor):
    """Positions in whole counts, and velocities from their differences; see `encoder_step`.

    Attributes:
        resolution: Step of one count at the joint [rad].
    """

    def __init__(self, settings: SensorSettings, arm: Arm) -> None:
        """Take counts, gear ratio and T, ``velocity_time_constant``."""
        self.resolution = 2.0 * math.pi / (settings.encoder_counts * settings.gear_ratio)
        self.time_constant = settings.velocity_time_constant
        self.state = new_encoder_state(arm.n)

    def measure(self, q: np.ndarray, qd: np.ndarray, torque: np.ndarray,
                dt: float) -> Measurement:
        """Measure q and its differences; see `Sensor`. An interval of 0 s has no difference."""
        encoder_step(self.state, q, qd, dt, self.resolution, self.time_constant)
        return Measurement(self.state.q.copy(), self.state.qd.copy(), torque)

    def position(self, q: np.ndarray) -> np.ndarray:
        """Return true positions, shape (n,) [rad], in whole counts."""
        return np.asarray(in_counts(q, self.resolution))


class NoisyTorque(Sensor):
    """White noise on the torque that a sensor is given.

    Attributes:
        sensor: The sensor behind it.
    """

    def __init__(self, sensor: Sensor, deviation: float, seed: int) -> None:
        """Take the sensor, the standard deviation [N·m] and the seed."""
        self.sensor = sensor
        self._deviation = deviation
        self._random = np.random.default_rng(seed)

    def measure(self, q: np.ndarray, qd: np.ndarray, torque: np.ndarray,
                dt: float) -> Measurement:
        """Measure with noise on the torque; see `Sensor`."""
        return self.sensor.measure(q, qd, torque + self.noise(1, torque.size)[0], dt)

    def noise(self, samples: int, n: int) -> np.ndarray:
        """Return the noise of the next samples, shape (samples, n) [N·m]."""
        return self._deviation * self._random.standard_normal((samples, n))

    def position(self, q: np.ndarray) -> np.ndarray:
        """Return what the sensor behind it shows, shape (n,) [rad]."""
        return self.sensor.position(q)


class _Checked(Sensor):
    """A plug-in whose measurements have the shapes that are needed, or are refused."""

    def __init__(self, sensor: Sensor, arm: Arm) -> None:
        self._sensor, self._arm = sensor, arm

    def measure(self, q: np.ndarray, qd: np.ndarray, torque: np.ndarray,
                dt: float) -> Measurement:
        given = self._sensor.measure(q, qd, torque, dt)
        if not isinstance(given, tuple) or len(given) != len(Measurement._fields):
            raise ParameterError(f'{type(self._sensor).__name__}.measure', given, 'a Measurement')
        return Measurement(*map(self._checked, Measurement._fields, given))

    def position(self, q: np.ndarray) -> np.ndarray:
        return self._checked('position', self._sensor.position(q))

    def _checked(self, name: str, value: Any) -> np.ndarray:
        return checked_array(f'{type(self._sensor).__name__}: {name}', value, (self._arm.n,),
                             self._arm.joints)


_OURS: Mapping[str, type[Sensor]] = MappingProxyType(
    {'perfect': PerfectSensor, 'encoder': Encoder})


def sensor_arrays(sensor: Sensor, n: int) -> SensorArrays | None:
    """Return a sensor of ``n`` joints as `sensor_step` takes it; None for one of the user's.

    What an encoder remembers is shared, so that the sensor goes on from what a step has done.
    """
    inner = sensor.sensor if type(sensor) is NoisyTorque else sensor
    if type(inner) is Encoder:
        return SensorArrays(True, inner.resolution, inner.time_constant, inner.state)
    if type(inner) is PerfectSensor:
        return SensorArrays(False, 1.0, 0.0, new_encoder_state(n))
    return None


def torque_noise(sensor: Sensor, samples: int, n: int) -> np.ndarray:
    """Return what a sensor adds to the torque of its next samples, shape (samples, n) [N·m]."""
    return sensor.noise(samples, n) if type(sensor) is NoisyTorque else np.zeros((samples, n))


def made_sensor(settings: SensorSettings, arm: Arm,
                given: Sensor | type[Sensor] | None = None) -> Sensor:
    """Return the sensor that ``settings.model`` names, behind the noise that they ask for.

    Args:
        settings: Model, noise and seed.
        arm: The arm that is measured.
        given: A sensor, or what is called with both and returns one, in place of the model.

    Raises:
        ParameterError: it cannot be imported or made, or lacks what a `Sensor` has.
    """
    if isinstance(given, Mapping):
        names = ', '.join(row.name for row in SensorSettings.table())
        raise ParameterError('sensor', given, "a sensor, a class of sensors, or a name such as "
                             "'encoder'; settings are given by name, "
                             f"sensors={{'torque_noise': 0.1}}, with {names}")
    if given is None and settings.model in _OURS:
        sensor = _OURS[settings.model](settings, arm)  # type: ignore[call-arg]
    else:
        name = 'arm_driver.sensors.model' if given is None else 'sensor'
        value = settings.model if given is None else given
        part = load_plugin(name, settings.model) if given is None else given
        own = made(name, value, part, _REQUIRED, settings, arm, base='Sensor')
        require_call(name, value, own, 'measure', 'q', 'qd', 'torque', 'dt')
        sensor = _Checked(own, arm)
    if settings.torque_noise > 0.0:
        return NoisyTorque(sensor, settings.torque_noise, settings.seed)
    return sensor
