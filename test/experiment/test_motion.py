# SPDX-License-Identifier: Apache-2.0
"""Facts about the motions that are to be recorded: where they begin, what they keep and teach."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('pinocchio')

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.control.harmonics import extremes
from adaptive_blf_control.errors import ArmError, ParameterError, SetViolation
from adaptive_blf_control.experiment.criterion import condition, criterion
from adaptive_blf_control.experiment.design import best_motion, random_motions
from adaptive_blf_control.experiment.expectation import expectation
from adaptive_blf_control.experiment.statement import Statement, task_of
from adaptive_blf_control.experiment.torque_rows import torque_rows

STEPS = 60
RANDOM = np.random.default_rng(5)


@pytest.fixture(scope='module')
def arm(folding):
    return load_arm(folding, coulomb=True, offset=True)


@pytest.fixture(scope='module')
def task(arm):
    return task_of(arm, Statement(duration=8.0, noise=(0.2,), payload=1.0,
                                  torque_limit=(22.0, 3.4)))[0]


@pytest.fixture(scope='module')
def design(task):
    return best_motion(task, steps=STEPS, descents=1)


def test_a_motion_begins_and_ends_at_rest_with_exact_derivatives(design):
    motion = design.motion
    ends = motion.at(np.array([0.0, motion.period]))
    np.testing.assert_allclose(ends.qd, 0.0, atol=1e-9)
    np.testing.assert_allclose(ends.qdd, 0.0, atol=1e-8)
    np.testing.assert_allclose(ends.q[0], ends.q[1], atol=1e-9)
    t, h = RANDOM.uniform(0.0, motion.period, 50), 1e-5
    before, here, after = (motion.at(t + shift) for shift in (-h, 0.0, h))
    np.testing.assert_allclose((after.q - before.q) / (2.0 * h), here.qd, atol=1e-6)
    np.testing.assert_allclose((after.qd - before.qd) / (2.0 * h), here.qdd, atol=1e-6)


def test_the_reference_is_the_motion(design):
    t = RANDOM.uniform(0.0, 20.0, 30)
    for mine, other in zip(design.motion.at(t), design.motion.reference.along(t)):
        np.testing.assert_allclose(mine, other, atol=1e-9)


def test_every_limit_is_kept_between_the_samples_and_by_every_arm_of_the_prior(arm, task, design):
    limits, times = task.limits, np.linspace(0.0, task.period, 4001)
    states = design.motion.at(times)
    assert (states.q > limits.lower).all()
    assert (states.q < limits.upper).all()
    assert (np.abs(states.qd) <= 1.001 * limits.velocity).all()
    assert (np.abs(states.qdd) <= 1.001 * limits.acceleration).all()
    rows = torque_rows(arm.arrays, *states)
    for _ in range(30):
        corner = RANDOM.choice([-1.0, 1.0], limits.prior.generators.shape[1])
        theta = limits.prior.centre + limits.prior.generators @ corner
        assert (np.abs(rows @ theta) <= 1.001 * limits.torque).all()
    assert (limits.torque <= [22.0, 3.4]).all()
    assert max(design.use.torque) > 0.9  # it is no timid motion either


def test_bodies_keep_their_distance_where_the_same_motion_without_them_would_touch(arm):
    stated = {'duration': 8.0, 'noise': (0.2,), 'centre': (0.8, 1.2), 'distance': 0.03}
    free, _ = task_of(arm, Statement(**stated, collisions=False))
    careful, _ = task_of(arm, Statement(**stated))
    reckless = best_motion(free, steps=STEPS, descents=1).motion
    times = np.linspace(0.0, 8.0, 801)
    assert careful.bodies.least(reckless.at(times).q)[0] < 0.0
    kept = best_motion(careful, steps=STEPS, descents=1)
    distance, between = careful.bodies.least(kept.motion.at(times).q)
    assert distance > 0.029
    assert set(between) == {'base_0', 'fore_0'}


def test_the_gradient_of_a_distance_is_its_derivative(arm):
    bodies = task_of(arm, Statement())[0].bodies
    for q in RANDOM.uniform(-1.5, 1.5, (20, 2)):
        (_, _, slope), = bodies.near(q[None], np.inf)
        for i, axis in enumerate(np.eye(2)):
            above, below = (bodies.least(q[None] + sign * 1e-5 * axis)[0] for sign in (1.0, -1.0))
            assert slope[i] == pytest.approx((above - below) / 2e-5, abs=2e-3)


def test_a_floor_is_not_touched(arm):
    task, _ = task_of(arm, Statement(duration=8.0, noise=(0.2,), floor=-0.3,
                                     centre=(-0.8, 0.0)))
    motion = best_motion(task, steps=20, descents=1).motion
    distance, between = task.bodies.least(motion.at(np.linspace(0.0, 8.0, 401)).q)
    assert distance > 0.019
    assert 'floor' in {name for pair in task.bodies.pairs for name in pair}


def test_the_gradient_of_the_objective_is_its_derivative(arm):
    task, _ = task_of(arm, Statement(duration=8.0, noise=(0.2,), centre=(0.8, 1.2)))
    objective = task.objective()
    x = 1.5 * objective.random(RANDOM)  # beyond the limits: every penalty counts
    slope = objective.gradient(x)
    for _ in range(5):
        along = RANDOM.normal(size=x.size)
        change = (objective.value(x + 1e-6 * along) - objective.value(x - 1e-6 * along)) / 2e-6
        assert slope @ along == pytest.approx(change, rel=2e-3, abs=1e-2)


def test_the_gradient_of_the_criterion_is_its_derivative():
    rows = RANDOM.normal(size=(40, 6)) * [1.0, 10.0, 0.1, 1.0, 3.0, 1.0]
    gram, along = rows.T @ rows, RANDOM.normal(size=(6, 6))
    along = along + along.T
    above, below = (criterion(gram + sign * 1e-6 * along)[0] for sign in (1.0, -1.0))
    assert np.sum(criterion(gram)[1] * along) == pytest.approx((above - below) / 2e-6, rel=1e-5)
    scaled = rows / np.linalg.norm(rows, axis=0)
    assert condition(gram) == pytest.approx(np.linalg.cond(scaled))


def test_a_designed_motion_tells_parameters_apart_that_random_ones_do_not(task, design):
    assert np.median([each.condition for each in random_motions(task, 9)]) > 1.5 * design.condition


def test_standard_deviations_are_those_of_least_squares_with_that_noise(arm, task, design):
    rate = 50.0
    expected = expectation(task, design, rate, 0.0)
    states = design.motion.at(np.arange(int(task.period * rate)) / rate)
    rows = (torque_rows(arm.arrays, *states) / 0.2).reshape(-1, arm.m)
    np.testing.assert_allclose(expected.std, np.sqrt(np.diag(np.linalg.inv(rows.T @ rows))),
                               rtol=0.02)
    alike = expectation(task, design, rate, 0.1)
    np.testing.assert_allclose(alike.std / expected.std, np.sqrt(0.2 * rate))
    assert alike.needed == pytest.approx(10.0 * expected.needed)


def test_extremes_are_those_of_the_period_and_of_all_phases_without_one():
    amplitude, phase = np.array([0.5, 0.4, 0.3]), np.array([0.1, 1.7, -2.0])
    w = 2.0 * np.pi / 7.0 * np.array([1.0, 2.0, 5.0])
    values = np.sin(np.outer(np.linspace(0.0, 7.0, 20001), w) + phase) @ amplitude
    low, high = extremes(amplitude, w, phase)
    assert low <= values.min() < 0.0 < values.max() <= high
    assert high - values.max() < 0.01
    assert extremes(amplitude, w * [1.0, 1.0001, 1.0], phase) == (-1.2, 1.2)
    assert extremes(amplitude, 0.0 * w, phase) == (-1.2, 1.2)


@pytest.mark.parametrize(('changes', 'name'), [
    ({'duration': 1.0}, '--duration'), ({'duration': float('nan')}, '--duration'),
    ({'rate': 5.0}, '--rate'), ({'speed': 1.5}, '--speed'), ({'payload': -1.0}, '--payload'),
    ({'mass_error': 2.0}, '--mass-error'), ({'floor': float('inf')}, '--floor')])
def test_what_cannot_be_is_refused_by_the_name_of_its_option(changes, name):
    with pytest.raises(ParameterError, match=f"'{name}'"):
        Statement(**changes)


@pytest.mark.parametrize(('given', 'instead'), [
    ('effort="20"', 'effort="0"'),
    ('type="revolute"><parent link="upper"/>', 'type="continuous"><parent link="upper"/>')])
def test_an_arm_without_a_torque_limit_needs_one(folding, given, instead):
    xml = folding.replace(given, instead)
    if 'continuous' in xml:
        xml = xml.replace('<limit lower="-2.5" upper="2.5" effort="20" velocity="5"/>', '')
    with pytest.raises(ParameterError, match=r'--torque-limit.*elbow'):
        task_of(load_arm(xml), Statement())
    task, assumed = task_of(load_arm(xml), Statement(torque_limit=(20.0,)))
    assert np.isfinite(task.limits.upper).all()
    assert any('elbow' in text for text in assumed) == ('continuous' in xml)


def test_an_arm_that_cannot_be_held_where_it_is_to_move_is_refused(folding):
    arm = load_arm(folding)
    task, _ = task_of(arm, Statement(duration=8.0, torque_limit=(5.0,)))
    with pytest.raises(SetViolation, match="'shoulder'.*centre of the motion.*--centre"):
        random_motions(task, 1)


def test_a_mesh_that_is_not_there_is_named(folding):
    xml = folding.replace('<box size="0.4 0.1 0.05"/>',
                          '<mesh filename="package://nowhere/fore.stl"/>')
    with pytest.raises(ArmError, match=r'nowhere/fore\.stl'):
        task_of(load_arm(xml), Statement())
