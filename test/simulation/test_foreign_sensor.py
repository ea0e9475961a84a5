# SPDX-License-Identifier: Apache-2.0
"""A plug-in for a sensor, named in a parameter or given as an object, measures our arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import adaptive_blf_control as door
from adaptive_blf_control.simulation.settings import PlantSettings

HERE = Path(__file__).parent


@pytest.fixture
def on_path(monkeypatch):
    """Let the plug-in be imported."""
    monkeypatch.syspath_prepend(str(HERE))


def measured(repository, **parts) -> np.ndarray:
    samples = []
    door.simulate(repository / 'config' / 'two_link.yaml', 0.1,
                  observer=lambda sample: samples.append(sample.measured.q), **parts)
    return np.array(samples)


def test_the_loop_sees_the_arm_through_it(repository, on_path):
    named = measured(repository, **{'arm_driver.sensors.model': 'foreign_sensor:Coarse'})
    steps = named / 0.01
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert len(np.unique(named[:, 0])) > 1
    assert not np.allclose(named, measured(repository))
    import foreign_sensor
    np.testing.assert_array_equal(named, measured(repository, sensor=foreign_sensor.Coarse))


@pytest.mark.parametrize(('model', 'message'), [
    ('foreign_sensor:NoSensor', r'NoSensor has no measure, position'),
    ('foreign_sensor:Nobody', r'AttributeError.*Nobody'),
    ('no_such_module:Sensor', r'ModuleNotFoundError'),
    ('own', r'one of perfect, encoder, module:name')])
def test_one_that_cannot_measure_is_refused_with_the_reason(repository, on_path, model, message):
    with pytest.raises(door.ParameterError, match=rf'sensors\.model.*{message}'):
        measured(repository, **{'arm_driver.sensors.model': model})


def test_a_plant_of_the_users_has_sensors_of_its_own(repository, on_path):
    import foreign_plant
    import foreign_sensor
    with pytest.raises(door.ParameterError, match=r'sensor.*the plant.*has its own'):
        measured(repository, sensor=foreign_sensor.Coarse,
                 **{'arm_driver.plant': 'foreign_plant:Pendulums'})
    plant = foreign_plant.Pendulums(PlantSettings(initial_position=[0.0, 2.0]),
                                    door.TwoLinkArm())
    with pytest.raises(door.ParameterError, match=r'sensor.*the plant.*has its own'):
        measured(repository, sensor=foreign_sensor.Coarse, plant=plant)
