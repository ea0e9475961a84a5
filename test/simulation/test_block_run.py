# SPDX-License-Identifier: Apache-2.0
"""Whole blocks of samples in one compiled function do what the parts do one sample at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop, OwnParts
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yaml
from adaptive_blf_control.control.laws.ablf import AblfLaw
from adaptive_blf_control.errors import ArmError, MissingExtra
from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.simulation.sensors import Measurement, Sensor

ENCODER = ('arm_driver.sensors.torque_noise=0.05', 'arm_driver.dead_time=2',
           'arm_driver.schedule.time=[0.0405, 0.13]', 'arm_driver.schedule.parameter=[payload, f]',
           'arm_driver.schedule.value=[1.0, 2.0]', 'identifier.excitation.window=0.4')
PUSHED = ('arm_driver.actuator.delay=0.0023', 'arm_driver.actuator.jitter=0.0011',
          'arm_driver.actuator.gain_error=[0.02]', 'arm_driver.actuator.torque_bias=[0.1]',
          'arm_driver.schedule.time=[0.02, 0.05, 0.0804, 0.1]',
          'arm_driver.schedule.parameter=[force.panda_link5.z, torque.panda_link7.x, '
          'force.panda_link5.z, payload]', 'arm_driver.schedule.value=[5.0, 1.0, 0.0, 0.3]')
CASES = {
    'two_link': (),
    'panda': PUSHED,
    'two_link_paper': ('controller.coupling=pseudoinverse', 'identifier.excitation.window=0.01'),
    'three_link_encoder': ENCODER,
    'three_link': ('controller.reference.smooth_start=0.1', 'arm_driver.rate=777.0',
                   'arm_driver.initial_velocity=[0.0]', 'arm_driver.substeps=3',
                   'controller.torque_limit=[5.0]'),
    'two_link_payload_step': ('controller.model=known', 'arm_driver.dead_time=2',
                              'arm_driver.actuator.effort=instant',
                              'controller.known_parameters=[3.473, 0.196, 0.242, 5.3, 1.1]'),
}

NONE_OWN = OwnParts()
Build = Callable[..., ClosedLoop]


@pytest.fixture
def build(repository) -> Build:
    """Return ``build(config, setting, ..., parts=...)``: the closed loop of a scenario."""
    def of(config: str, *settings: str, parts: OwnParts = NONE_OWN) -> ClosedLoop:
        data = load_yaml(repository / 'config' / f'{config}.yaml')
        try:
            return build_closed_loop(apply_settings(data, list(settings)), parts)
        except (MissingExtra, ArmError) as error:  # no Pinocchio, or not the robot of the file
            pytest.skip(str(error))
    return of


def leaves(value) -> Iterator[object]:
    """Yield what is in nested tuples."""
    if isinstance(value, tuple):
        for each in value:
            yield from leaves(each)
    else:
        yield value


@pytest.mark.parametrize('config', CASES)
def test_samples_of_blocks_have_the_bits_of_samples_one_at_a_time(build, config):
    one_by_one, seen = list(build(config, *CASES[config]).samples(0.3)), []
    loop = build(config, *CASES[config])
    trace = loop.run(0.3, seen.append)
    assert trace.in_python == ()
    assert len(seen) == len(one_by_one) == trace.t.size
    for one, other in zip(one_by_one, seen):
        for expected, got in zip(leaves(one), leaves(other), strict=True):
            np.testing.assert_array_equal(got, expected)
    np.testing.assert_array_equal(trace.torque, [one.output.torque for one in one_by_one])


@pytest.mark.parametrize('config', CASES)
def test_an_observer_changes_no_bit_of_the_trace(build, config):
    seen = []
    traces = [build(config, *CASES[config]).run(0.2, observer) for observer in (None, seen.append)]
    for name in ('t', 'q', 'qd', 'e1', 'torque', 'theta_hat', 'rank', 'sigma_min'):
        np.testing.assert_array_equal(*(getattr(trace, name) for trace in traces))
    np.testing.assert_array_equal(*(trace.measured for trace in traces))


def test_the_parts_go_on_from_what_a_block_has_done(build):
    whole = build('three_link_encoder', *ENCODER).plant, build('three_link_encoder', *ENCODER)
    loop = build('three_link_encoder', *ENCODER)
    loop.run(0.15)
    for _ in whole[1].samples(0.15):
        pass
    for one, other in ((loop.plant, whole[1].plant),):
        np.testing.assert_array_equal([one.q, one.qd, one.torque],
                                      [other.q, other.qd, other.torque])
        assert one.t == other.t
        for plant in (one, other):
            plant.advance(1e-3)
        np.testing.assert_array_equal(*(plant.measure(plant.torque, 1e-3) for plant in
                                        (one, other)))
    np.testing.assert_array_equal(loop.identifier.theta, whole[1].identifier.theta)
    assert loop.identifier.stack.insertions == whole[1].identifier.stack.insertions


@pytest.mark.parametrize(('config', 'settings'), [('three_link_encoder', ENCODER),
                                                  ('panda', PUSHED)])
def test_warming_a_block_up_leaves_no_trace(build, config, settings):
    loop = build(config, *settings)
    loop.warm_up()
    np.testing.assert_array_equal(loop.run(0.1).q, build(config, *settings).run(0.1).q)


class Damped(AblfLaw):
    """A law of the user's."""

    def answer(self, sample):
        answer = super().answer(sample)
        return answer._replace(torque=answer.torque - 0.1 * sample.qd)


class Held(Sensor):
    """A sensor of the user's."""

    def __init__(self, settings, arm):
        pass

    def measure(self, q, qd, torque, dt):
        return Measurement(q, qd, torque)


class Arm(TwoLinkArm):
    """An arm of the user's that only its methods know."""

    def X(self, q, qd, alpha, alpha_dot):
        return super().X(q, qd, alpha, alpha_dot)


@pytest.mark.parametrize(('parts', 'words'), [
    (OwnParts(law=Damped), ['controller with Damped of TwoLinkArm']),
    (OwnParts(sensor=Held), ['sensor']),
    (OwnParts(arm=Arm()), ['controller with AblfLaw of Arm', 'identifier of Arm'])])
def test_a_part_in_python_is_named_and_asked_sample_by_sample(build, parts, words):
    trace = build('two_link', parts=parts).run(0.02)
    assert list(trace.in_python) == words
    assert np.isfinite(trace.torque).all()
    plain = build('two_link').run(0.02)
    if parts.law is None:
        np.testing.assert_allclose(trace.theta_hat, plain.theta_hat, rtol=1e-9, atol=1e-12)
    else:
        assert not np.allclose(trace.torque, plain.torque)


