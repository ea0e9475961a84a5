# SPDX-License-Identifier: Apache-2.0
"""What an arm is to the rest of the package: regressors, names and forward dynamics."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, NoReturn, Protocol, TYPE_CHECKING

import numpy as np

from adaptive_blf_control.arms import integrator
from adaptive_blf_control.arrays import (
    are_vectors,
    checked_array,
    checked_count,
    checked_number,
    dimensions,
)
from adaptive_blf_control.compiled import uncompiled
from adaptive_blf_control.errors import (
    ArmError,
    check_open,
    close_when_made,
    no_array,
    ParameterError,
    shown,
    TypeWithHints,
    without_attribute,
)

if TYPE_CHECKING:
    from abc import ABCMeta as ProtocolType
else:
    ProtocolType = type(Protocol)

__all__ = ['Arm', 'ClosedArm', 'ForwardDynamics', 'checked_arm']


class ForwardDynamics(Protocol):
    """The true arm of a simulation: equation (3) for one fixed parameter vector.

    A class that inherits from it needs no more than ``acceleration``.
    """

    @abstractmethod
    def acceleration(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return q̈ = M⁻¹(τ − C q̇ − G − F q̇).

        Args:
            q: Joint positions, shape (n,) [rad].
            qd: Joint velocities, shape (n,) [rad/s].
            tau: Joint torques, shape (n,) [N·m].

        Returns:
            Joint accelerations, shape (n,) [rad/s²].
        """
        ...

    def advance(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray, dt: float,
                substeps: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Integrate over ``dt`` [s] under a held torque with RK4 sub-steps; return new (q, q̇).

        ``acceleration`` is called with arrays, whatever is given here.

        Raises:
            ParameterError: An array is not of shape (n,), or a number cannot be used.
        """
        if not are_vectors(np.shape(q), q, qd, tau):
            q = checked_array('q', q, (-1,) if dimensions(q) else (1,))
            qd, tau = (checked_array(name, value, q.shape)
                       for name, value in (('qd', qd), ('tau', tau)))
        q, qd = q.copy(), qd.copy()
        uncompiled(integrator.move)(self, q, qd, tau, checked_number('dt', dt),
                                    checked_count('substeps', substeps))
        return q, qd


def _acceleration(arm: ForwardDynamics, q: np.ndarray, qd: np.ndarray,
                  tau: np.ndarray) -> np.ndarray:
    name = f'{type(arm).__name__}.acceleration'
    return checked_array(name, arm.acceleration(q, qd, tau), q.shape)


integrator.acceleration.register(ForwardDynamics, _acceleration)


LOADED = 'load_arm(urdf) returns the arm of a URDF'
_INSTEAD = {
    **dict.fromkeys(('from_urdf', 'from_file', 'from_xml', 'load'), LOADED),
    'names': 'joints has the names of the joints, parameters those of the parameters',
    'theta': 'nominal has the nominal parameters, in the order of parameters',
    **dict.fromkeys(('inverse_dynamics', 'rnea', 'rne', 'torque', 'tau'),
                    'inverse_dynamics(arm, theta, q, qd, qdd) of the package'),
    'step': 'dynamics(theta).advance(q, qd, tau, dt)',
    'advance': 'dynamics(theta).advance(q, qd, tau, dt)',
    'simulate': 'simulate(arm) of the package, or dynamics(theta).advance(q, qd, tau, dt)',
    'regressor': 'X(q, qd, qd, qdd) is the regressor of the torque, Y1 and Y2 need no qdd',
    'Y': 'X(q, qd, qd, qdd) is the regressor of the torque, Y1 and Y2 need no qdd',
    **dict.fromkeys(('mass_matrix', 'M', 'inertia'),
                    'Y1(q, e) @ theta is the product of M(q) with a vector e'),
    **dict.fromkeys(('C', 'coriolis', 'bias', 'nle'),
                    'inverse_dynamics(arm, theta, q, qd, 0 * q) of the package is their sum '
                    'C qd + G + F qd'),
    **dict.fromkeys(('G', 'g', 'gravity', 'gravity_vector', 'gravload', 'gravity_torque'),
                    'inverse_dynamics(arm, theta, q, 0 * q, 0 * q) of the package'),
    **dict.fromkeys(('to_urdf', 'export_urdf', 'save_urdf'),
                    'identify(log, urdf).urdf(path) writes a URDF with what was learned'),
    'friction': 'the last entries of nominal, named in parameters',
    'lengths': 'the regressors have none; link_points(q) has what is drawn',
    'masses': 'theta has combinations of masses, lengths and inertias, named in parameters'}


class _ArmType(TypeWithHints, ProtocolType):
    """Type of arms: their classes have the hints of their objects."""


class Arm(Protocol, metaclass=_ArmType):
    """A serial arm, linear in its dynamic parameters: Y(q, q̇, q̈) θ = τ (2).

    A class that inherits from it has to have joints, parameters, Y1, Y2 and X; with nominal and
    dynamics it can be simulated, with link_points drawn.

    Attributes:
        joints: Joint names, length n, in the order of every array.
        parameters: Parameter names, length m, in the order of θ.
        nominal: Nominal parameters, shape (m,); what a simulation takes as θ*.
        payload_direction: dθ*/d(payload), what 1 kg at the tip adds to θ*, shape (m,); None where
            the arm has no geometry to say so.
    """

    joints: tuple[str, ...]
    parameters: tuple[str, ...]
    nominal: np.ndarray
    payload_direction: np.ndarray | None = None

    def __init_subclass__(cls, instead: Mapping[str, str] | None = None, **options: Any) -> None:
        """Take what to write for names that a class does not have, beside those of every arm."""
        super().__init_subclass__(**options)
        if instead:
            cls._instead = {**cls._instead, **instead}  # type: ignore[attr-defined]

    if not TYPE_CHECKING:
        _instead = _INSTEAD

        def __new__(cls, *_: Any, **__: Any) -> Any:
            """Refuse to make the base itself, with what makes an arm."""
            if cls is Arm:
                raise ArmError('Arm is the base of arms of your own: load_arm(urdf) returns the '
                               'arm of a URDF, TwoLinkArm() and ThreeLinkArm() those of papers')
            return super().__new__(cls)

        def __getattr__(self, name: str) -> Any:
            """Raise AttributeError for what is not there, with the one that is meant."""
            raise without_attribute(self, name)

    def __repr__(self) -> str:
        """Name joints and count parameters."""
        joints, parameters = (getattr(self, name, ()) for name in ('joints', 'parameters'))
        return (f'<{type(self).__name__}: {len(joints)} joints ({", ".join(joints)}), '
                f'{len(parameters)} parameters>')

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def m(self) -> int:
        """Number of parameters."""
        return len(self.parameters)

    @abstractmethod
    def Y1(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Momentum regressor, Y1 θ = M(q) q̇ (12), shape (n, m) [N·m·s per unit of θ]."""
        ...

    @abstractmethod
    def Y2(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Y2 θ = −Ṁ q̇ + C q̇ + G + F q̇ (12), shape (n, m) [N·m per unit of θ]."""
        ...

    def Y12(self, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Y1 and Y2 of the same state, sharing work."""
        return self.Y1(q, qd), self.Y2(q, qd)

    @abstractmethod
    def X(self, q: np.ndarray, qd: np.ndarray, alpha: np.ndarray,
          alpha_dot: np.ndarray) -> np.ndarray:
        """X θ = M α̇ + C α + G + F q̇, shape (n, m) [N·m per unit of θ].

        C is the Christoffel matrix, so that this and (35) give the same V̇ (Slotine and Li). Arms
        in closed form may instead return the paper's (35) with −½ Ṁ e2; both make
        e2ᵀ(X θ − M α̇ − C q̇ − G − F q̇ + ½ Ṁ e2) = 0.

        Args:
            q: Joint positions, shape (n,) [rad].
            qd: Joint velocities, shape (n,) [rad/s].
            alpha: Stabilising function, shape (n,) [rad/s].
            alpha_dot: Its time derivative, shape (n,) [rad/s²].
        """
        ...

    def dynamics(self, theta: np.ndarray) -> ForwardDynamics:
        """Forward dynamics with the parameters ``theta``, shape (m,), or by name."""
        raise ArmError(f'{type(self).__name__} has no dynamics: it cannot be simulated')

    def link_points(self, q: np.ndarray) -> np.ndarray:
        """Points to draw the arm through, base to tip, at joint positions q, shape (k, 3) [m]."""
        raise ArmError(f'{type(self).__name__} has no link_points: it cannot be drawn')


class ClosedArm(Arm, instead={
        **dict.fromkeys(('nominal =', 'payload_direction ='),
                        "simulate(arm, true_model='given', true_parameters=[...]) moves with "
                        'another theta, Identifier(arm, initial_estimate=[...]) begins with one'),
        'joints =': 'they are named where the arm is made'}):
    """Base of the arms of this package: what they are made of cannot be set, nor written to.

    Limits can be set: they are looked for on any arm.
    """

    _closed = False
    _settable = ('torque_limit', 'velocity_limit', 'position_lower', 'position_upper')

    def __init_subclass__(cls, **options: Any) -> None:
        """Close the arms of a class of this package once they have been made."""
        super().__init_subclass__(**options)
        close_when_made(cls)

    def __array__(self, *_: Any, **__: Any) -> NoReturn:
        """Raise TypeError: NumPy would make an array of the object itself."""
        raise no_array(self)

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute; AttributeError where the arm is made already."""
        if name in type(self)._instead:  # type: ignore[attr-defined]
            raise without_attribute(self, name)
        check_open(self, name)
        if isinstance(value, np.ndarray) and not name.startswith('_'):
            value = value.copy()
            value.setflags(write=False)
        super().__setattr__(name, value)


REQUIRED = ('joints', 'parameters', 'n', 'm', 'Y1', 'Y2', 'Y12', 'X')
"""What an arm has to have for learning and control."""
SIMULATED = ('nominal', 'payload_direction', 'dynamics')
"""What it has to have besides to be simulated."""


def checked_arm(name: str, arm: Any) -> Arm:
    """Return ``arm``; ParameterError where it lacks what learning and control need of an arm.

    Args:
        name: What the caller calls it, for the message.
        arm: What is to be one.

    Raises:
        ParameterError: see above.
        ArmError: a regressor of a user's arm has another shape than (n, m).
    """
    if isinstance(arm, type) or not all(hasattr(arm, each) for each in REQUIRED):
        lacks = [each for each in REQUIRED if not hasattr(arm, each)]
        said = (f'{arm.__name__}(...), not the class' if isinstance(arm, type) else
                f'{type(arm).__name__} has no {", ".join(lacks)}')
        raise ParameterError(name, arm, f'a part with {", ".join(REQUIRED)}, such as '
                             'TwoLinkArm(), load_arm(urdf) or an object of a class that inherits '
                             f'from Arm: {said}')
    _check_regressors(arm)
    return arm  # type: ignore[no-any-return]


def _check_regressors(arm: Any) -> None:
    """Raise ArmError where a method of a user's arm returns no regressor of shape (n, m)."""
    shape = (arm.n, arm.m)
    for method, vectors in (('Y1', 2), ('Y2', 2), ('Y12', 2), ('X', 4)):
        function = getattr(arm, method)
        if getattr(function, '__module__', '').startswith('adaptive_blf_control.'):
            continue
        answer = function(*np.zeros((vectors, arm.n)))
        for part in answer if isinstance(answer, tuple) else (answer,):
            if not isinstance(part, np.ndarray) or part.shape != shape:
                raise ArmError(f'{type(arm).__name__}.{method} gives '
                               + (f'shape {part.shape}' if isinstance(part, np.ndarray)
                                  else shown(part))
                               + f': expected a numpy array of shape {shape}, a row for each of '
                               f'{", ".join(arm.joints)}, a column for each of '
                               f'{", ".join(arm.parameters)}')
