# SPDX-License-Identifier: Apache-2.0
"""Facts about the safety filter in a loop that learns: the truth stays inside, errors shrink."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import adaptive_blf_control as blf
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_changes, load_yaml
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.cause_intervals import CauseBounds
from adaptive_blf_control.limits.governor import Governor
from adaptive_blf_control.limits.pace import AHEAD, Pace

PRIOR = {'mass_error': 0.3, 'friction': [8.0, 2.0], 'unexplained': [0.05, 0.05]}
LEARNS = {'controller.safety_filter': 'limits', 'controller.limits.velocity': [0.45, 0.9],
          'controller.limits.learn': True, 'identifier.parameter_set.period': 0.02,
          'arm_driver.initial_velocity': [0.0, 0.0],
          **{f'controller.limits.prior.{name}': value for name, value in PRIOR.items()},
          **{f'identifier.parameter_set.prior.{name}': value for name, value in PRIOR.items()}}


@pytest.fixture(name='data', scope='module')
def _data(repository):
    return apply_changes(load_yaml(repository / 'config' / 'two_link.yaml'), LEARNS)


def _whole() -> CauseBounds:
    model = blf.Controller(blf.TwoLinkArm(), safety_filter='limits', limits={
        'velocity': [1.5], 'prior': PRIOR}, torque_limit=[200.0, 100.0]).safety_filter.model
    causes = model.prior.causes
    return CauseBounds(tuple(cause.name for cause in causes),
                       np.array([cause.middle - cause.half for cause in causes]),
                       np.array([cause.middle + cause.half for cause in causes]))


def test_the_true_parameters_stay_in_the_set_that_the_filter_uses(data):
    loop = build_closed_loop(data)
    truth, parts = np.array([3.473, 0.196, 0.242, 5.3, 1.1]), []
    for _ in loop.samples(3.0):
        model = loop.controller.safety_filter.model
        for cause, value in zip(model.known.causes, truth):
            assert abs(value - cause.middle) <= cause.half * (1.0 + 1e-9), cause.name
        parts.append(model.part)
    assert parts[0] == 1.0
    assert (np.diff(parts) <= 0.0).all()
    assert parts[-1] < 0.3


def test_what_was_learned_leaves_less_that_the_acceleration_may_be_wrong_by(data):
    errors = []
    for learns in (False, True):
        loop = build_closed_loop(apply_changes(data, {'controller.limits.learn': learns}))
        trace = loop.run(2.0)
        assert (np.abs(trace.qd) <= [0.45, 0.9]).all()
        errors.append(loop.controller.safety_filter.report.error)
    assert (errors[1] < 0.3 * errors[0]).all()


def test_a_filter_that_learns_from_nobody_is_refused(data):
    with pytest.raises(ParameterError, match=r'identifier\.parameter_set\.period.*limits\.learn'):
        build_closed_loop(apply_changes(data, {'identifier.parameter_set.period': 0.0}))


def test_intervals_that_exclude_the_prior_leave_the_prior_and_are_named(data):
    loop = build_closed_loop(data)
    loop.run(1.0)
    known, wrong = loop.controller.safety_filter, _whole()
    assert known.model.part < 1.0
    wrong.least[3] = wrong.most[3] = 9.0
    with pytest.raises(ParameterError, match=rf'{wrong.names[3]} of identifier/parameter_set.* is '
                                             r'\[9\.0, 9\.0\].*0 to 8'):
        known.narrow(wrong)
    assert known.model.part == 1.0


def test_without_news_it_is_the_prior_again_after_the_timeout(data):
    loop = build_closed_loop(apply_changes(data, {'controller.limits.learn_timeout': 0.1}))
    loop.run(0.5)
    controller = loop.controller
    assert controller.safety_filter.model.part < 1.0
    q, qd = loop.plant.q, loop.plant.qd
    narrow = []
    for k in range(120):
        controller.update(0.501 + 0.001 * k, q, qd, loop.identifier.theta)
        narrow.append(controller.safety_filter.model.part < 1.0)
    assert all(narrow[:75])  # the last news were at most 20 ms before 0.5 s
    assert not any(narrow[101:])


def test_a_pace_looks_at_all_points_again_after_a_few_samples(data):
    loop = build_closed_loop(data)
    arm, reference = loop.arm, loop.controller.reference
    model = loop.controller.safety_filter.model
    whole = _whole()
    part = whole._replace(least=whole.least + 0.4 * (whole.most - whole.least))
    narrow = model.narrowed(part).known
    limit = np.array([5.0, 2.0])
    paces = [Pace(arm, known, np.full(2, 20.0), limit) for known in (model.prior, narrow)]
    for pace in paces:
        pace.advance(0.0, reference, 0.0)
    before = copy.copy(paces[0])
    # What a pace knows of the points ahead is not public.
    assert not np.allclose(paces[0]._points, paces[1]._points)
    paces[0].narrow(narrow)
    for k in range(1, 12):
        for pace in (*paces, before):
            pace.advance(1e-4 * k, reference, 0.0)
    assert len(paces[0]._points) == AHEAD + 1
    np.testing.assert_array_equal(paces[0]._points, paces[1]._points)
    assert not np.array_equal(before._points, paces[0]._points)


def test_a_governor_takes_a_model_for_its_filter_and_its_pace(data):
    loop = build_closed_loop(data)
    loop.run(1.0)
    known = loop.controller.safety_filter
    governor = known.governor
    assert isinstance(governor, Governor)
    assert governor._parts.model is known.model.handle  # what it keeps is not public
    assert governor.pace._known is known.model.known


def test_the_scenario_beside_obstacles_learns_with_one_parameter(repository, panda):
    loop = build_closed_loop(apply_changes(
        load_yaml(repository / 'config' / 'panda_obstacles.yaml'),
        {'controller.limits.learn': True}))
    assert loop.arm.joints == panda.joints
    loop.run(1.0)
    assert loop.controller.safety_filter.model.part < 0.9
