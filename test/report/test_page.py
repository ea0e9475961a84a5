# SPDX-License-Identifier: Apache-2.0
"""The page in a browser: it renders, the slider moves the arm, its numbers are the JSON's."""

from __future__ import annotations

from collections.abc import Callable
from html import unescape
import json
from pathlib import Path
import re
from typing import Any

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.report.page import number_text
from adaptive_blf_control.tools.report import main

pytest.importorskip('plotly', reason='plotly is not installed: pip install .[plot]')

LIMIT = 10_000_000  # bytes
Browse = Callable[[Path, str], Any]
MakeBag = Callable[..., Path]


@pytest.fixture(scope='module')
def page(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp('page') / 'report.html'
    assert main([str(bag), '-o', str(file)]) == 0
    return file


@pytest.fixture(scope='module')
def overlay(bag: Path, other_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp('overlay') / 'report.html'
    assert main([str(bag), str(other_bag), '-o', str(file)]) == 0
    return file


def _script(html: str, name: str) -> object:
    found = re.search(rf'<script type="application/json" id="{name}">(.*?)</script>', html, re.S)
    assert found is not None
    return json.loads(found[1])


def test_page_renders_every_plot_without_a_console_message(page: Path, browse: Browse) -> None:
    visit = browse(page, """
        return [...document.querySelectorAll('.js-plotly-plot')].map(
            (plot) => [plot.id, plot.querySelectorAll('.scatterlayer path.js-line').length]);""")
    assert visit.console == []
    lines = dict(visit.result)
    assert {re.sub(r'\d+$', '', name) for name in lines} == {
        'arm', 'margins', 'positions', 'errors', 'torques', 'estimates', 'estimate_errors',
        'history', 'lyapunov', 'timing'}
    assert len(lines) == len(_script(visit.html, 'plots'))
    assert all(count > 0 for count in lines.values()), lines


def test_slider_moves_the_arm_to_the_posture_of_that_time(page: Path, browse: Browse) -> None:
    visit = browse(page, """
        const slider = document.getElementById('time'), arm = document.getElementById('arm');
        const seen = [];
        for (const index of [0, 150, 299]) {
          slider.value = index;
          slider.dispatchEvent(new Event('input'));
          slider.dispatchEvent(new Event('change'));
          await new Promise((done) => setTimeout(done, 200));
          const path = arm.querySelectorAll('.scatterlayer path.js-line');
          seen.push({clock: document.getElementById('clock').textContent,
                     x: [...arm.data[1].x], y: [...arm.data[1].y],
                     drawn: path[path.length - 1].getAttribute('d')});
        }
        const cursors = [...document.querySelectorAll('.js-plotly-plot')].filter(
            (plot) => plot.layout.shapes && plot.id.startsWith('errors')).map(
            (plot) => plot.layout.shapes[plot.layout.shapes.length - 1].x0);
        return {seen, cursors};""")
    arm = TwoLinkArm()
    assert len({seen['drawn'] for seen in visit.result['seen']}) == 3
    for seen, index in zip(visit.result['seen'], (0, 150, 299)):
        t = np.floor(1000.0 * 2.0 * index / 299.0 + 1e-6) / 1000.0
        scale = np.array([1.0, 0.5])
        points = arm.link_points((np.sin(t) + 0.05 * np.exp(-2.0 * t)) * scale)
        assert seen['x'] == pytest.approx(points[:, 0].tolist(), abs=1e-4)
        assert seen['y'] == pytest.approx(points[:, 1].tolist(), abs=1e-4)
        assert seen['clock'] == f'{2.0 * index / 299.0:.2f} s'
    assert visit.result['cursors'] == pytest.approx([2.0, 2.0])


def test_numbers_on_the_page_are_those_of_json(
        overlay: Path, bag: Path, other_bag: Path, browse: Browse,
        capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main([str(bag), str(other_bag), '--json']) == 0
    numbers = json.loads(capsys.readouterr().out)
    visit = browse(overlay, """
        return {numbers: JSON.parse(document.getElementById('figures').textContent),
                cells: [...document.querySelectorAll('[data-figure]')].map((cell) =>
                    [JSON.parse(cell.dataset.figure), cell.dataset.format, cell.textContent])};
        """)
    assert visit.result['numbers'] == numbers
    assert len(visit.result['cells']) > 100
    for path, form, text in visit.result['cells']:
        value = numbers
        for key in path:
            value = value[key] if value is not None else None
        assert text == number_text(value, form), path


def test_playing_runs_to_the_end_and_pause_stops(page: Path, browse: Browse) -> None:
    visit = browse(page, """
        const slider = document.getElementById('time');
        document.getElementById('play').click();
        await new Promise((done) => setTimeout(done, 600));
        const moving = Number(slider.value);
        document.getElementById('play').click();
        const paused = Number(slider.value);
        await new Promise((done) => setTimeout(done, 300));
        return [moving, Number(slider.value) - paused];""")
    assert visit.result[0] > 0
    assert visit.result[1] == 0
    assert visit.console == []


def test_zooming_one_plot_zooms_all_over_time(page: Path, browse: Browse) -> None:
    visit = browse(page, """
        const plots = [...document.querySelectorAll('.js-plotly-plot')];
        const torque = plots.find((plot) => plot.id.startsWith('torques'));
        await Plotly.relayout(torque, {'xaxis.range[0]': 0.5, 'xaxis.range[1]': 1.0});
        await new Promise((done) => setTimeout(done, 300));
        return plots.filter((plot) => plot.layout.xaxis && plot.id !== 'arm'
                            && !plot.id.startsWith('timing')).map(
            (plot) => plot.layout.xaxis.range);""")
    assert len(visit.result) > 8
    assert all(ends == [0.5, 1.0] for ends in visit.result)


def test_errors_can_be_seen_in_the_set_and_close_up(page: Path, browse: Browse) -> None:
    visit = browse(page, """
        const button = document.querySelector('.zoom');
        const plot = document.querySelector('[id^=errors].js-plotly-plot');
        const ranges = [[...plot.layout.yaxis.range]];
        for (let i = 0; i < 2; i += 1) {
          button.click();
          await new Promise((done) => setTimeout(done, 200));
          ranges.push([...plot.layout.yaxis.range]);
        }
        return ranges;""")
    whole, close, again = visit.result
    assert whole[0] < -0.2 < 0.2 < whole[1]
    assert -0.01 < close[0] < 0.0 < 0.05 < close[1] < 0.06
    assert again == whole


def test_two_bags_are_overlaid_and_each_can_be_hidden(overlay: Path, browse: Browse) -> None:
    visit = browse(overlay, """
        const shown = () => [...document.querySelectorAll('.js-plotly-plot')].map(
            (plot) => [plot.id, [0, 1].map((bag) => plot.data.filter(
                (trace) => trace.meta && trace.meta.bag === bag && trace.visible !== false
            ).length)]);
        const before = shown();
        const chips = [...document.querySelectorAll('.bags button')];
        chips[1].click();
        await new Promise((done) => setTimeout(done, 300));
        return {before, after: shown(), chips: chips.map((chip) => chip.textContent)};""")
    assert visit.result['chips'] == ['run', 'left_run']
    assert visit.console == []
    for (name, before), (_, after) in zip(visit.result['before'], visit.result['after']):
        assert min(before) >= 1, name
        assert after == [before[0], 0], name
    assert re.search(r'id="verdict0">\s*<h2><span class="badge">Sets kept', visit.html)
    assert re.search(r'id="verdict1">\s*<h2><span class="badge">Sets left', visit.html)


def test_what_acts_from_outside_is_shaded_in_time_and_marked_at_the_tip(
        make_bag: MakeBag, tmp_path: Path, browse: Browse) -> None:
    bag = make_bag(tmp_path / 'pushed', pushed=(0.5, 0.8))
    assert main([str(bag), '-o', str(tmp_path / 'page.html')]) == 0
    visit = browse(tmp_path / 'page.html', """
        const marks = document.getElementById('arm').data.filter(
            (trace) => trace.name === 'acted on from outside');
        const shaded = [...document.querySelectorAll('.js-plotly-plot')].filter(
            (plot) => plot.id.startsWith('errors') || plot.id.startsWith('external')).map(
            (plot) => plot.layout.shapes.filter((shape) => shape.type === 'rect' &&
                shape.yref === 'paper').map((shape) => [shape.x0, shape.x1]));
        return {marks: marks.map((trace) => [[...trace.x], [...trace.y]]), shaded};""")
    assert visit.console == []
    assert visit.result['shaded'] == 4 * [[[pytest.approx(0.5), pytest.approx(0.8)]]]
    [tip] = np.array(visit.result['marks'])
    t = np.arange(0.5, 0.8001, 0.05)
    e1 = 0.05 * np.exp(-2.0 * t)
    expected = [TwoLinkArm().link_points((np.sin(a) + b) * np.array([1.0, 0.5]))[-1, :2]
                for a, b in zip(t, e1)]
    np.testing.assert_allclose(tip.T, expected, atol=2e-3)


def test_page_asks_no_other_file_or_host(page: Path) -> None:
    html = page.read_text(encoding='utf-8')
    tags = re.findall(r'<(?:script|link|img|iframe)\b[^>]*>', re.sub(
        r'(<script>).*?(</script>)', r'\1\2', html, flags=re.S))
    assert len(tags) >= 5
    for tag in tags:
        for address in re.findall(r'(?:src|href)="([^"]*)"', tag):
            assert address.startswith('data:')
    assert '@import' not in html


def test_no_name_from_a_bag_becomes_markup(make_bag: MakeBag, tmp_path: Path) -> None:
    bag = make_bag(tmp_path / '<img src=x onerror=alert(1)>', 0.2)
    assert main([str(bag), '-o', str(tmp_path / 'page.html')]) == 0
    html = (tmp_path / 'page.html').read_text(encoding='utf-8')
    assert '<img' not in html.partition('<main>')[2].partition('</main>')[0]
    assert '&lt;img' in unescape(html) or '&lt;img' in html


def test_a_page_of_100_s_at_1_khz_is_below_10_mb(make_bag: MakeBag, tmp_path: Path) -> None:
    bag = make_bag(tmp_path / 'long', 100.0, arm='three_link')
    page = tmp_path / 'page.html'
    assert main([str(bag), '-o', str(page)]) == 0
    assert page.stat().st_size < LIMIT
    frames = _script(page.read_text(encoding='utf-8'), 'frames')
    assert isinstance(frames, dict)
    assert len(frames['t']) <= 300
