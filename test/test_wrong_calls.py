# SPDX-License-Identifier: Apache-2.0
"""Whatever is given where at the door: it is used, or refused by an error of ours."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest

import adaptive_blf_control as door
from adaptive_blf_control.control.reference import Posture, SumOfSinusoids
from adaptive_blf_control.simulation.sensors import Measurement

ARM, ARM3 = door.TwoLinkArm(), door.ThreeLinkArm()
DYNAMICS = ARM.dynamics(ARM.nominal)
Q = [0.1, 0.2]
LOG = {'t': np.arange(0.0, 0.5, 1e-3), **{name: np.ones((500, 2)) for name in ('q', 'qd', 'tau')}}

WRONG = {
    'None': None, 'text': 'high', 'empty text': '', 'bytes': b'x', 'a path': Path('nowhere'),
    'true': True, 'an integer': 7, 'minus one': -1, 'a number': 0.5, 'NaN': np.nan,
    'infinity': np.inf, 'a complex number': 1j, 'an object': object(), 'a class': dict,
    'a function': len, 'a module': np, 'a mapping': {'a': 1.0}, 'an empty mapping': {},
    'a set': {1.0, 2.0}, 'a generator': (k for k in range(2)),
    'no elements': [], 'one element': [1.0], 'three elements': [1.0, 2.0, 3.0],
    'integers': [1, 2], 'texts': ['1.0', 'b'], 'Nones': [None, None], 'NaNs': [np.nan, np.nan],
    'infinities': [np.inf, -np.inf], 'objects': np.array([object(), 'x'], dtype=object),
    'complex numbers': np.array([1j, 2.0]), 'times': np.array(['2024-01-01'], dtype='datetime64'),
    'float32': np.array([1.0, 2.0], dtype=np.float32), 'read-only': np.broadcast_to(0.5, (2,)),
    'a column': [[1.0], [2.0]], 'a row': [[1.0, 2.0]], 'rows of two lengths': [[1.0], [1.0, 2.0]],
    'three axes': np.zeros((2, 2, 2)), 'huge': [1e308, 1e308], 'five elements': [1.0] * 5,
    'another arm': ARM3, 'settings': door.IdentifierSettings(), 'an error': ValueError('x'),
}

CALLS = {
    'TwoLinkArm': lambda x: door.TwoLinkArm(x),
    'ThreeLinkArm': lambda x: door.ThreeLinkArm(x),
    'Y1 q': lambda x: ARM.Y1(x, Q),
    'Y2 qd': lambda x: ARM.Y2(Q, x),
    'Y12 q': lambda x: ARM3.Y12(x, [0.0, 0.0, 0.0]),
    'X alpha': lambda x: ARM.X(Q, Q, x, Q),
    'link_points': lambda x: ARM3.link_points(x),
    'dynamics': lambda x: ARM.dynamics(x),
    'dynamics of three': lambda x: ARM3.dynamics(x),
    'acceleration': lambda x: DYNAMICS.acceleration(Q, Q, x),
    'advance q': lambda x: DYNAMICS.advance(x, Q, Q, 1e-3),
    'advance dt': lambda x: DYNAMICS.advance(Q, Q, Q, x),
    'advance substeps': lambda x: DYNAMICS.advance(Q, Q, Q, 1e-3, x),
    'inverse_dynamics arm': lambda x: door.inverse_dynamics(x, ARM.nominal, Q, Q, Q),
    'inverse_dynamics theta': lambda x: door.inverse_dynamics(ARM, x, Q, Q, Q),
    'inverse_dynamics q': lambda x: door.inverse_dynamics(ARM, ARM.nominal, x, Q, Q),
    'inverse_dynamics qdd': lambda x: door.inverse_dynamics(ARM, ARM.nominal, Q, Q, x),
    'IdentifierSettings gamma': lambda x: door.IdentifierSettings(gamma=x),
    'IdentifierSettings history': lambda x: door.IdentifierSettings(history=x),
    'IdentifierSettings history.size': lambda x: door.IdentifierSettings(history={'size': x}),
    'ControllerSettings safety': lambda x: door.ControllerSettings(safety=x),
    'ControllerSettings reference': lambda x: door.ControllerSettings(reference=x),
    'ControllerSettings of a joint': lambda x: door.ControllerSettings(reference={'joint1': x}),
    'ControllerSettings of joints':
        lambda x: door.ControllerSettings(reference={'of_joint': x}),
    'settings that are not there': lambda x: door.IdentifierSettings(gama=x),
    'Identifier arm': lambda x: door.Identifier(x),
    'Identifier settings': lambda x: door.Identifier(ARM, x),
    'Identifier update_law': lambda x: door.Identifier(ARM, update_law=x).update(0.0, Q, Q, Q),
    'Identifier kt': lambda x: door.Identifier(ARM, kt=x),
    'Identifier gamma': lambda x: door.Identifier(ARM, gamma=x),
    'Identifier initial_estimate': lambda x: door.Identifier(ARM, initial_estimate=x),
    'Identifier filter': lambda x: door.Identifier(ARM, filter=x),
    'retune': lambda x: door.Identifier(ARM).retune(x),
    'update t': lambda x: door.Identifier(ARM).update(x, Q, Q, Q),
    'update q': lambda x: door.Identifier(ARM).update(0.0, x, Q, Q),
    'update tau': lambda x: door.Identifier(ARM).update(0.0, Q, Q, x),
    'update adaptation_term': lambda x: door.Identifier(ARM).update(0.0, Q, Q, Q, x),
    'observe qd': lambda x: door.Identifier(ARM).observe(0.0, Q, x, Q),
    'learn t': lambda x: door.Identifier(ARM).learn(x, [Q, Q], [Q, Q], [Q, Q]),
    'learn q': lambda x: door.Identifier(ARM).learn([0.0, 0.1], x, [Q, Q], [Q, Q]),
    'predict q': lambda x: door.Identifier(ARM).predict(x, Q, Q),
    'predict qd': lambda x: door.Identifier(ARM).predict(Q, x, Q),
    'Controller arm': lambda x: door.Controller(x),
    'Controller settings': lambda x: door.Controller(ARM, x),
    'Controller safety': lambda x: door.Controller(ARM, safety=x),
    'Controller performance': lambda x: door.Controller(ARM, performance=x),
    'Controller reference': lambda x: door.Controller(ARM, reference=x),
    'Controller law': lambda x: door.Controller(ARM, law=x).update(0.0, Q, Q, [0.0] * 5),
    'Controller start': lambda x: door.Controller(ARM, start=x),
    'Controller k1': lambda x: door.Controller(ARM, k1=x),
    'Controller update t': lambda x: door.Controller(ARM).update(x, Q, Q, [0.0] * 5),
    'Controller update q': lambda x: door.Controller(ARM).update(0.0, x, Q, [0.0] * 5),
    'Controller update theta': lambda x: door.Controller(ARM).update(0.0, Q, Q, x),
    'Controller check_start': lambda x: door.Controller(ARM).check_start(x),
    'Controller retune settings': lambda x: door.Controller(ARM).retune(0.0, [0.0, 0.0],
                                                                        settings=x),
    'Controller retune q': lambda x: door.Controller(ARM).retune(
        0.0, x, reference=Posture([0.0, 0.0])),
    'SumOfSinusoids': lambda x: SumOfSinusoids(x, [[0.1], [0.1]], [[1.0], [1.0]], [[0.0], [0.0]]),
    'SumOfSinusoids amplitude': lambda x: SumOfSinusoids([0.0, 0.0], x, x, x),
    'Posture': lambda x: door.Controller(ARM, reference=Posture(x)),
    'ClosedLoop plant': lambda x: door.ClosedLoop(x, door.Controller(ARM)),
    'ClosedLoop controller': lambda x: door.ClosedLoop(Still(), x),
    'ClosedLoop identifier': lambda x: door.ClosedLoop(Still(), door.Controller(ARM), x),
    'ClosedLoop period': lambda x: door.ClosedLoop(Still(), door.Controller(ARM), period=x),
    'ClosedLoop initial_estimate':
        lambda x: door.ClosedLoop(Still(), door.Controller(ARM), initial_estimate=x),
    'simulate scenario': lambda x: door.simulate(x, 1e-3),
    'simulate duration': lambda x: short(x) or door.simulate(ARM, x),
    'simulate plant': lambda x: door.simulate(ARM, 1e-3, plant=x),
    'simulate controller': lambda x: door.simulate(ARM, 1e-3, controller=x),
    'simulate k2': lambda x: door.simulate(ARM, 1e-3, controller={'k2': x}),
    'simulate initial_position': lambda x: door.simulate(ARM, 1e-3,
                                                         arm_driver={'initial_position': x}),
    'simulate names': lambda x: door.simulate(ARM, 1e-3, nobody=x),
    'identify log': lambda x: door.identify(x, arm=ARM),
    'identify urdf': lambda x: door.identify(LOG, x),
    'identify joints': lambda x: door.identify(LOG, arm='two_link', joints=x),
    'identify arm': lambda x: door.identify(LOG, arm=x),
    'identify train': lambda x: door.identify(LOG, arm=ARM, train=x),
    'identify test': lambda x: door.identify(LOG, arm=ARM, test=x),
    'identify options': lambda x: door.identify(LOG, arm=ARM, options=x),
    'identify validate': lambda x: door.identify(LOG, arm=ARM, validate=x),
    'LogOptions gain': lambda x: door.LogOptions(gain={'joint1': x}),
    'LogOptions effort_delay': lambda x: door.LogOptions(effort_delay=x),
    'identify settings': lambda x: door.identify(LOG, arm=ARM, settings=x),
    'identify kt': lambda x: door.identify(LOG, arm=ARM, kt=x),
    'read_log': lambda x: door.read_log(x),
    'read_log joints': lambda x: door.read_log(LOG, joints=x),
    'read_log t': lambda x: door.read_log({**LOG, 't': x}),
    'read_log q': lambda x: door.read_log({**LOG, 'q': x}),
    'read_bag': lambda x: door.read_bag(x),
    'load_arm': lambda x: door.load_arm(x),
}


class Still:
    """A plant that does not move."""

    q = qd = torque = np.zeros(2)

    def measure(self, torque, dt):
        return Measurement(self.q, self.qd, torque)

    def measured_position(self):
        return self.q

    def apply(self, torque):
        pass

    def advance(self, dt):
        pass

    def brake(self):
        pass


def short(duration: object) -> bool:
    """Whether a duration would make a run that takes long."""
    return isinstance(duration, (int, float)) and not isinstance(duration, bool) and duration > 1.0


URDF = """<robot name="pendulum"><link name="base"/><link name="rod"><inertial><mass value="1"/>
<origin xyz="0 0 -0.2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
</link><joint name="pivot" type="continuous"><parent link="base"/><child link="rod"/>
<axis xyz="0 1 0"/></joint></robot>"""
CALLS_OF_URDF = {
    'load_arm joints': lambda x: door.load_arm(URDF, x),
    'load_arm viscous': lambda x: door.load_arm(URDF, viscous=x),
    'load_arm coulomb_velocity': lambda x: door.load_arm(URDF, coulomb=True, coulomb_velocity=x),
    'load_arm gravity': lambda x: door.load_arm(URDF, gravity=x),
    'Y12': lambda x: PENDULUM().Y12(x, [0.0]),
    'X': lambda x: PENDULUM().X([0.0], [0.0], [0.0], x),
    'Y': lambda x: PENDULUM().Y([0.0], [0.0], x),
    'link_points': lambda x: PENDULUM().link_points(x),
    'dynamics': lambda x: PENDULUM().dynamics(x),
    'advance': lambda x: PENDULUM().dynamics(PENDULUM().nominal).advance([0.0], [0.0], x, 1e-3),
    'mass_matrix': lambda x: PENDULUM().mass_matrix([0.0], x),
    'to_inertial': lambda x: PENDULUM().to_inertial(x),
    'friction': lambda x: PENDULUM().friction(x),
    'identify joints': lambda x: door.identify(LOG, URDF, x),
    'UrdfArm viscous': lambda x: door.UrdfArm(URDF, viscous=x),
    'UrdfArm package_dirs': lambda x: door.UrdfArm('package://a/b', package_dirs=x),
}
PENDULUM = functools.cache(lambda: door.load_arm(URDF))


@pytest.mark.parametrize('call', CALLS)
def test_it_is_used_or_refused_by_an_error_of_ours(call):
    assert others_than_ours(CALLS[call]) == {}


@pytest.mark.parametrize('call', CALLS_OF_URDF)
def test_an_arm_of_a_urdf_uses_or_refuses_it_by_an_error_of_ours(call):
    pytest.importorskip('pinocchio')
    assert others_than_ours(CALLS_OF_URDF[call]) == {}


def others_than_ours(call):
    others = {}
    for name, value in WRONG.items():
        try:
            call(value)
        except door.BlfError as error:
            text = str(error)
            assert 10 < len(text) < 3000, text
        except Exception as error:
            others[name] = f'{type(error).__name__}: {error}'
    return others
