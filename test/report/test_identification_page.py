# SPDX-License-Identifier: Apache-2.0
"""The page of an identification: it renders, has the figures, and runs no text of a log."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
import json
from pathlib import Path
import re
from typing import Any

import numpy as np
import pytest

pytest.importorskip('plotly', reason='plotly is not installed: pip install .[plot]')
pytest.importorskip('pinocchio')

from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.report.identification_page import identification_page
from adaptive_blf_control.report.identification_panels import identification_sections
from adaptive_blf_control.report.png import write_png
from adaptive_blf_control.runs.identification import Identification, identify
from adaptive_blf_control.runs.model_report import parameter_table
from adaptive_blf_control.tools.report import main as report
from planar_arm import planar_urdf

Browse = Callable[[Path, str], Any]
JOINTS = ['shoulder', '</script><!--<script>']
URDF = planar_urdf(*JOINTS)


@pytest.fixture(scope='module')
def result() -> Identification:
    t = np.arange(0.0, 12.0, 0.005)
    w, size = np.array([[2.1, 5.3], [3.2, 4.1]]), np.array([[0.6, 0.2], [0.5, 0.3]])
    angles = t[:, None, None] * w
    q, qd = (size * np.sin(angles)).sum(axis=2), (size * w * np.cos(angles)).sum(axis=2)
    qdd = -(size * w ** 2 * np.sin(angles)).sum(axis=2)
    arm = load_arm(URDF)
    tau = inverse_dynamics(arm, arm.nominal, q, qd, qdd)
    tau[:, 0] += 0.8 * np.sign(qd[:, 0])  # dry friction that is not learned
    tau += np.random.default_rng(0).normal(0.0, 0.05, tau.shape)
    return identify({'t': t, 'q': q, 'qd': qd, 'tau': tau}, URDF, friction={'coulomb': False,
                    'square_root': False}, filter={'time_constant': 0.05})


@pytest.fixture(scope='module')
def page(result: Identification, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp('page') / 'identification.html'
    file.write_text(identification_page(result), encoding='utf-8')
    return file


def test_every_plot_is_drawn_and_no_text_of_the_robot_is_run(page: Path, browse: Browse) -> None:
    visit = browse(page, """
        return [...document.querySelectorAll('.js-plotly-plot')].map(
            (plot) => [plot.id, plot.querySelectorAll('.scatterlayer path.js-line').length]);""")
    assert visit.console == []
    lines = dict(visit.result)
    assert {re.sub(r'\d+$', '', name) for name in lines} == {
        'torques', 'residuals', 'friction', 'gravity', 'history'}
    assert len(lines) == 4 * 2 + 3
    assert all(count > 0 for count in lines.values()), lines


def test_the_table_has_the_figures(page: Path, result: Identification) -> None:
    html = page.read_text(encoding='utf-8')
    for value in result.figures['test_rmse']:
        assert f'<td>{value:.4f}</td>' in html
    stored = re.search(r'<script type="application/json" id="figures">(.*?)</script>', html, re.S)
    assert stored is not None
    assert json.loads(stored[1])['test_rmse'] == result.figures['test_rmse']
    assert JOINTS[1] not in html


def test_a_joint_with_hardly_any_torque_does_not_make_the_model_a_poor_one(
        result: Identification) -> None:
    torque, tested = list(result.figures['test_torque_rms']), list(result.figures['test_rmse'])
    torque[1], tested[1] = 0.009 * torque[0], 0.03 * torque[0]
    figures = {**result.figures, 'test_torque_rms': torque, 'test_rmse': tested}
    html = identification_page(dataclasses.replace(result, figures=figures))
    assert f'In the worst joint, {JOINTS[0]}, θ̂ leaves' in html
    assert 'Hardly any torque, too little to judge by: &lt;/script' in html
    assert '<td>333.3%</td>' in html
    assert 'badge">Poor' not in html


def test_parameters_have_units_and_the_word_for_what_they_are(page: Path, result: Identification,
                                                              ) -> None:
    html = page.read_text(encoding='utf-8')
    table = parameter_table(result.figures)
    for text in ('Ixx .. Izz [kg·m²] are sums over a link and others', 'Ia rotor inertia [kg·m²]',
                 'fv viscous friction [N·m·s/rad]'):
        assert text in html
        assert text in table
    assert 'fc Coulomb' not in table


def test_a_single_curve_has_no_legend(result: Identification) -> None:
    panels = {panel.key: panel for section in identification_sections(result)
              for panel in section.panels}
    assert panels['rank'].title == f'Rank, of {result.arm.m} parameters'
    assert not any(curve.legend for key in ('rank', 'directions') for curve in panels[key].curves)


def test_friction_that_is_not_learned_is_a_step_over_the_velocity(result: Identification) -> None:
    panels = {panel.key: panel for section in identification_sections(result)
              for panel in section.panels}

    def step(key: str) -> float:
        mean = panels[key].curves[0]
        slow = np.abs(mean.x) < 0.6
        return float(mean.y[slow & (mean.x > 0.1)].mean() - mean.y[slow & (mean.x < -0.1)].mean())

    assert step(f'friction_{JOINTS[0]}') > 0.2
    assert abs(step(f'friction_{JOINTS[1]}')) < 0.05


def test_the_history_grows_to_full_rank(result: Identification) -> None:
    assert result.growth is not None
    assert result.growth.rank[-1] == result.rank == result.arm.m
    assert (np.diff(result.growth.rank) >= 0).all()
    largest, _, smallest = result.growth.singular[-1]
    assert largest / smallest == pytest.approx(result.figures['condition'], rel=0.3)


def test_pictures_have_the_names_of_the_panels(result: Identification, tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    sections = identification_sections(result)
    assert len(write_png(tmp_path / 'history', sections[-1:])) == 3  # two have no legend
    files = write_png(tmp_path, sections[:1])
    assert [file.name for file in files] == [
        'torque_shoulder.png', 'torque___script___--_script_.png']
    assert all(file.stat().st_size > 5000 for file in files)


def test_report_prints_the_figures_of_a_page_and_of_saved_json(page, result, tmp_path, capsys):
    assert report([str(page)]) == 0
    text = capsys.readouterr().out
    assert f'rank {result.rank} of {result.arm.m}' in text
    assert f'{np.mean(result.test_rmse):.4f}' in text
    assert report([str(page), '--json']) == 0
    figures = json.loads(capsys.readouterr().out)['identifications'][str(page)]
    assert figures['theta_hat'] == pytest.approx(result.estimate)
    (tmp_path / 'figures.json').write_text(json.dumps(figures))
    assert report([str(tmp_path / 'figures.json')]) == 0
    assert f'rank {result.rank} of {result.arm.m}' in capsys.readouterr().out


@pytest.mark.parametrize(('name', 'text', 'words'), [
    ('theta_hat.yaml', 'theta_hat: {}', 'holds a model'), ('a.urdf', '<robot/>', 'holds a model'),
    ('a.html', '<html>', 'has no figures of an identification'),
    ('a.html', '<script type="application/json" id="figures">{"bags":[]}</script>',
     'is the page of a run'), ('a.json', '[', 'has no figures of an identification')])
def test_report_says_what_to_call_for_other_files(tmp_path, capsys, name, text, words):
    (tmp_path / name).write_text(text)
    assert report([str(tmp_path / name)]) == 2
    assert words in capsys.readouterr().err


def test_report_draws_no_identification_again(page, tmp_path, capsys):
    assert report([str(page), '--png', str(tmp_path / 'pictures')]) == 2
    assert 'identify LOG --urdf FILE' in capsys.readouterr().err
    assert report([str(page), str(tmp_path)]) == 2
    assert 'expected one kind' in capsys.readouterr().err
