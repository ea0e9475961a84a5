# SPDX-License-Identifier: Apache-2.0
"""Facts about the command ``configure``: what it writes, keeps and refuses, and that it runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adaptive_blf_control.configuration.node_settings import (
    ControllerNodeSettings,
    DriverSettings,
    IdentifierNodeSettings,
)
from adaptive_blf_control.configuration.parameter_file import load_yaml, node_settings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.runs.simulation import simulate
from adaptive_blf_control.tools.configure import main

PANDA = ['package://panda_description/urdf/panda.urdf',
         '--joints', *(f'panda_joint{i}' for i in range(1, 8))]
REAL = ['--delay', '0.004', '--encoder', '200000', '--torque-noise', '0.05']


@pytest.fixture
def panda(tmp_path: Path) -> Path:
    pytest.importorskip('pinocchio')
    path = tmp_path / 'panda.yaml'
    assert main([*PANDA, *REAL, '-o', str(path)]) == 0
    return path


def test_the_file_states_the_loop_and_sensors_that_were_stated(panda: Path) -> None:
    data = load_yaml(panda)
    driver, controller = (node_settings(data, kind) for kind in (DriverSettings,
                                                                 ControllerNodeSettings))
    assert (driver.actuator.delay, driver.rate) == (0.004, 1000.0)
    assert driver.sensors.model == 'encoder'
    assert driver.sensors.encoder_counts * driver.sensors.gear_ratio == 200000.0
    assert driver.sensors.torque_noise == 0.05
    assert controller.loop.delay == 0.004
    assert controller.loop.velocity_lag == pytest.approx(0.0055)
    assert controller.loop.unstable == 'refuse'
    assert controller.torque_limit.tolist() == [87.0] * 4 + [12.0] * 3
    identifier = node_settings(data, IdentifierNodeSettings)
    assert identifier.initial_estimate == controller.initial_estimate == 'nominal'


def test_a_link_without_an_inertial_is_learned_as_slowly_as_the_lightest(tmp_path: Path) -> None:
    """As in a wrist whose axes meet: the links between have none."""
    pytest.importorskip('pinocchio')
    link = ('<link name="{0}">{3}</link><joint name="j{0}" type="revolute"><parent link="{1}"/>'
            '<child link="{0}"/><origin xyz="0.3 0 0"/><axis xyz="{2}"/>'
            '<limit lower="-2" upper="2" effort="50" velocity="3"/></joint>')
    inertial = ('<inertial><origin xyz="0.1 0 0"/><mass value="2"/><inertia ixx="0.01" ixy="0" '
                'ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>')
    urdf = tmp_path / 'wrist.urdf'
    urdf.write_text('<robot name="r"><link name="0"/>' + ''.join(
        link.format(i + 1, i, axis, inertial if i != 1 else '')
        for i, axis in enumerate(('0 0 1', '0 1 0', '0 0 1'))) + '</robot>')
    path = tmp_path / 'wrist.yaml'
    assert main([str(urdf), '-o', str(path)]) == 0
    gamma = np.array(node_settings(load_yaml(path), IdentifierNodeSettings).gamma)
    assert (gamma > 0.0).all()


def test_a_configured_arm_keeps_its_sets_late_and_noisy_with_a_urdf_that_is_a_fifth_off(
        panda: Path) -> None:
    data = load_yaml(panda)
    nominal = simulate(data, 0.002).loop.arm.nominal
    run = simulate(data, 3.0, initial_estimate=0.8 * nominal)
    assert run.kept
    assert np.abs(run.e1).max() < 0.1


def test_the_same_gains_are_refused_in_a_loop_that_is_four_times_as_late(panda: Path) -> None:
    with pytest.raises(ParameterError, match=r'controller\.k2.*would do'):
        simulate(load_yaml(panda), 0.1, **{'arm_driver.actuator.delay': 0.04})


def test_a_file_that_exists_is_kept_unless_it_is_to_be_overwritten(panda: Path, capsys) -> None:
    panda.write_text('mine', encoding='utf-8')
    assert main([*PANDA, '-o', str(panda)]) == 2
    assert '--overwrite' in capsys.readouterr().err
    assert panda.read_text(encoding='utf-8') == 'mine'
    assert main([*PANDA, '-o', str(panda), '--overwrite']) == 0
    assert load_yaml(panda)


def test_the_reasons_are_printed_and_nothing_is_written_without_a_file(
        tmp_path: Path, monkeypatch, capsys) -> None:
    pytest.importorskip('pinocchio')
    monkeypatch.chdir(tmp_path)
    assert main([*PANDA, *REAL]) == 0
    out = capsys.readouterr().out
    for part in ('panda_joint7', 'inertia seen', 'lambda_max', 'ms of further delay', 'reserve'):
        assert part in out
    assert list(tmp_path.iterdir()) == []


def test_a_urdf_of_a_relative_path_is_found_from_any_folder(tmp_path: Path, monkeypatch) -> None:
    pytest.importorskip('pinocchio')
    (tmp_path / 'arm.urdf').write_text(
        '<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/>'
        '<origin xyz="0.2 0 0"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
        '</inertial></link><joint name="j" type="continuous"><parent link="a"/><child link="b"/>'
        '<axis xyz="0 1 0"/></joint></robot>', encoding='utf-8')
    monkeypatch.chdir(tmp_path)
    assert main(['arm.urdf', '-o', 'arm.yaml']) == 0
    assert node_settings(load_yaml('arm.yaml'), DriverSettings).urdf == str(tmp_path / 'arm.urdf')


@pytest.mark.parametrize(('arguments', 'expected'), [
    (['nowhere.urdf'], "'nowhere.urdf' does not exist"),
    ([*PANDA[:2], 'panda_joint9'], "no joint 'panda_joint9'; drivable joints"),
    ([*PANDA, '--delay', '-1'], 'loop.delay'),
    ([*PANDA, '--torque-limit', '1', '2'], '--torque-limit'),
    ([*PANDA, '--rotor-inertia', '0.1', '0.2'], '--rotor-inertia'),
    ([*PANDA, '--rotor-inertia', '-0.1'], '[-0.1]: expected inertias >= 0 kg·m²'),
    ([*PANDA, '--centre', '9', '0', '0', '0', '0', '0', '0'], "joint 'panda_joint1'"),
    ([*PANDA, '-o', 'no/such/folder/arm.yaml'], 'a file in a folder that exists'),
])
def test_bad_input_is_one_clear_line_and_status_2(capsys, arguments, expected) -> None:
    pytest.importorskip('pinocchio')
    assert main(arguments) == 2
    err = capsys.readouterr().err
    assert err.startswith('configure: ')
    assert expected in err
    assert err.count('\n') == 1


def test_a_urdf_behind_the_rotors_is_no_number_of_theirs(capsys) -> None:
    with pytest.raises(SystemExit):
        main(['--rotor-inertia', 'arm.urdf'])
    assert "'arm.urdf' is no number" in capsys.readouterr().err


@pytest.mark.parametrize(('stated', 'nominal'), [([], [0.0]), (['0.3'], [0.3] * 7)])
def test_rotors_are_learned_from_zero_or_from_what_was_stated(
        tmp_path: Path, stated: list[str], nominal: list[float]) -> None:
    pytest.importorskip('pinocchio')
    path = tmp_path / 'arm.yaml'
    assert main([*PANDA, *REAL, '--rotor-inertia', *stated, '-o', str(path)]) == 0
    for kind in (DriverSettings, IdentifierNodeSettings, ControllerNodeSettings):
        friction = node_settings(load_yaml(path), kind).friction
        assert friction.rotor_inertia
        assert friction.nominal_rotor_inertia.tolist() == nominal
    loop = simulate(load_yaml(path), 0.002).loop
    column = loop.arm.parameters.index('Ia_panda_joint5')
    assert loop.initial_estimate[column] == nominal[-1]


def test_the_panda_that_is_shipped_is_what_its_first_lines_say(
        repository: Path, tmp_path: Path) -> None:
    pytest.importorskip('pinocchio')
    shipped = repository / 'config' / 'panda.yaml'
    command, = (line for line in shipped.read_text(encoding='utf-8').splitlines()
                if line.startswith('# configure '))
    arguments = command.removeprefix('# configure ').split()
    arguments[arguments.index('-o') + 1] = str(tmp_path / 'again.yaml')
    assert main(arguments) == 0
    for kind in (DriverSettings, IdentifierNodeSettings, ControllerNodeSettings):
        ours, again = (node_settings(load_yaml(path), kind).values()
                       for path in (shipped, tmp_path / 'again.yaml'))
        assert list(ours) == list(again)
        for name, value in ours.items():
            if isinstance(value, list) and isinstance(value[0], float):
                np.testing.assert_allclose(value, again[name], rtol=2e-3, err_msg=name)
            else:
                assert value == again[name], name
