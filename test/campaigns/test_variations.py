# SPDX-License-Identifier: Apache-2.0
"""Facts about what varies in a campaign: names, ranges, elements, reproducibility."""

from __future__ import annotations

import re

import numpy as np
import pytest
import yaml

from adaptive_blf_control.campaigns.variations import draw, read_vary_file, variations
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_changes, load_yaml
from adaptive_blf_control.errors import ParameterError


@pytest.fixture
def data(repository) -> dict:
    return load_yaml(repository / 'config' / 'two_link.yaml')


def drawn(data: dict, vary: dict, runs: int = 200, seed: int = 1,
          sampling: str = 'independent') -> list[dict]:
    return draw(variations({'vary': vary}, data), runs, seed, sampling).changes


def test_a_scaled_array_has_a_number_of_its_own_for_each_element(data):
    changes = drawn(data, {'controller.k2': {'scale': {'uniform': [0.5, 1.5]}}})
    k2 = np.array([change['controller.k2'] for change in changes])
    factors = k2 / build_closed_loop(data).controller.settings.resolved(joints=2).k2
    assert ((factors >= 0.5) & (factors <= 1.5)).all()
    assert abs(np.corrcoef(factors.T)[0, 1]) < 0.3


def test_together_one_number_stands_for_all_elements(data):
    changes = drawn(data, {'controller.k2': {'scale': {'uniform': [0.5, 1.5]}, 'together': True}})
    k2 = np.array([change['controller.k2'] for change in changes])
    np.testing.assert_allclose(k2[:, 0] / k2[:, 1], k2[0, 0] / k2[0, 1])
    assert np.ptp(k2[:, 0]) > 0.0


def test_an_offset_is_added_to_the_value_of_the_scenario(data):
    changes = drawn(data, {'arm_driver.initial_position': {'offset': {'normal': [0.0, 0.01]}}})
    q = np.array([change['arm_driver.initial_position'] for change in changes])
    np.testing.assert_allclose(q.mean(axis=0), build_closed_loop(data).plant.q, atol=0.005)


def test_scaled_true_parameters_are_those_of_the_arm_and_are_given(data):
    twice = {'arm_driver.true_parameters': {'scale': {'uniform': [2.0, 2.0 + 1e-9]}}}
    change, = drawn(data, twice, runs=1)
    nominal = build_closed_loop(data).arm.nominal
    np.testing.assert_allclose(change['arm_driver.true_parameters'], 2.0 * nominal)
    loop = build_closed_loop(apply_changes(data, change))
    (_, true), = loop.plant.truth(loop.arm.parameters)
    np.testing.assert_allclose(true, 2.0 * nominal)


def test_elements_vary_by_themselves_and_the_others_stay(data):
    inertia, friction = 'arm_driver.true_parameters[0:3]', 'arm_driver.true_parameters[4]'
    vary = {inertia: {'scale': {'uniform': [0.5, 2.0]}, 'together': True},
            friction: {'scale': {'uniform': [2.0, 3.0]}}}
    found = draw(variations({'vary': vary}, data), 50, 1)
    true = np.array([change['arm_driver.true_parameters'] for change in found.changes])
    factors = true / build_closed_loop(data).arm.nominal
    np.testing.assert_allclose(factors[:, :3], np.repeat(factors[:, :1], 3, axis=1))
    assert (factors[:, 3] == 1.0).all()
    assert (factors[:, 4] >= 2.0).all()
    assert set(found.shown) == {f'{inertia} scale', friction}
    np.testing.assert_allclose(found.shown[f'{inertia} scale'], factors[:, 0])
    np.testing.assert_array_equal(found.shown[friction], true[:, 4])


def test_an_integer_parameter_gets_integers(data):
    changes = drawn(data, {'identifier.history.size': {'log_uniform': [10.0, 1000.0]}})
    assert {type(change['identifier.history.size']) for change in changes} == {int}


def test_grids_run_through_all_combinations(data):
    changes = drawn(data, {'arm_driver.dead_time': {'grid': [0, 1, 2]},
                           'controller.k2': {'grid': [[30.0, 5.0], [60.0, 8.0]]}}, runs=12)
    pairs = [(change['arm_driver.dead_time'], tuple(change['controller.k2']))
             for change in changes]
    assert len(set(pairs[:6])) == 6
    assert pairs[:6] == pairs[6:]


@pytest.mark.parametrize('sampling', ['independent', 'latin_hypercube'])
def test_what_else_varies_does_not_change_what_is_drawn(data, sampling):
    payload = {'arm_driver.rate': {'uniform': [500.0, 1000.0]}}
    other = {'controller.k2': {'scale': {'uniform': [0.5, 2.0]}}}
    alone = drawn(data, payload, sampling=sampling)
    with_other = drawn(data, {**other, **payload}, sampling=sampling)
    assert ([change['arm_driver.rate'] for change in alone]
            == [change['arm_driver.rate'] for change in with_other])


@pytest.mark.parametrize(('vary', 'words'), [
    ({'arm_driver.dead_tim': {'uniform': [0.0, 1.0]}}, 'did you mean dead_time'),
    ({'k2': {'uniform': [0.0, 1.0]}}, 'NODE.PARAMETER'),
    ({'arm_driver.dead_time': {'uniform': [-5.0, -1.0]}}, '>= 0'),
    ({'controller.k2': {'scale': {'normal': [0.0, 1.0]}}}, 'of run'),
    ({'arm_driver.dead_time': {'integers': [0, 1001]}}, 'at an end of'),
    ({'arm_driver.dead_time': {'choice': [1] * 999 + [-1]}}, '>= 0'),
    ({'controller.k2[2]': {'uniform': [1.0, 2.0]}}, 'the number of elements'),
    ({'controller.k2[1:1]': {'uniform': [1.0, 2.0]}}, 'the number of elements'),
    ({'arm_driver.dead_time[0]': {'integers': [0, 1]}}, 'as a whole'),
    ({'controller.k2[0]': {'choice': [[1.0, 2.0]]}}, 'numbers for single elements'),
    ({'controller.k2[0:2]': {'uniform': [1.0, 2.0]}, 'controller.k2': {'uniform': [1.0, 2.0]}},
     'does not vary'),
    ({'arm_driver.plant': {'scale': {'uniform': [0.0, 1.0]}}}, 'a parameter of numbers'),
    ({'arm_driver.plant': {'choice': ['sunny']}}, 'builtin'),
    ({'controller.k2': 3.0}, 'a distribution'),
    ({'controller.k2': {'uniform': [1.0, 2.0], 'together': 'yes'}}, 'true or false'),
    ({'controller.k2': {'scale': {'uniform': [1.0, 2.0]}, 'uniform': [1.0, 2.0]}}, 'scale alone'),
])
def test_what_cannot_vary_so_is_named_before_the_first_run(data, vary, words):
    with pytest.raises(ParameterError) as error:
        drawn(data, vary)
    assert words in str(error.value)
    assert next(iter(vary)) in str(error.value)


@pytest.mark.parametrize('text', ['', '3', 'vary: {}', 'vary: [1]', 'other: 1', ': ::'])
def test_a_file_that_says_nothing_of_what_varies_is_refused(tmp_path, text):
    path = tmp_path / 'vary.yaml'
    path.write_text(text, encoding='utf-8')
    with pytest.raises(ParameterError, match='vary.yaml'):
        read_vary_file(path)


def test_a_sampling_that_does_not_exist_is_refused(data):
    with pytest.raises(ParameterError, match='latin_hypercube'):
        variations({'sampling': 'sobol', 'vary': {'arm_driver.rate': {'uniform': [1.0, 2.0]}}},
                   data)


@pytest.mark.parametrize('name', ['two_link', 'three_link_encoder', 'panda'])
def test_what_varies_in_the_study_fits_its_scenario(repository, name):
    data = load_yaml(repository / 'config' / f'{name}.yaml')
    given = read_vary_file(repository / 'config' / 'campaigns' / f'{name}.yaml')
    found = draw(variations(given, data), 16, 1, given['sampling'])
    assert len(found.changes) == 16
    assert 'arm_driver.sensors.encoder_counts' in found.shown


def test_the_example_of_the_docs_fits_the_scenario_that_it_names(repository):
    page = (repository / 'docs' / 'campaigns.md').read_text(encoding='utf-8')
    config, *_ = re.findall(r'campaign (config/\w+\.yaml)', page)
    given = yaml.safe_load(re.search(r'```yaml\n(.*?)```', page, re.DOTALL).group(1))
    data = load_yaml(repository / config)
    for change in draw(variations(given, data), 5, 0, given['sampling']).changes:
        build_closed_loop(apply_changes(data, change))
