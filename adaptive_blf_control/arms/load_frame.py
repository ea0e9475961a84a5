# SPDX-License-Identifier: Apache-2.0
"""A load at a frame of the robot: its ten inertial parameters as base parameters of the arm.

A load that is fixed to a frame is a part of the body that carries it. Pseudo-inertias add up, and
that of the load in the axes of the body is T P Tᵀ with the placement T of the frame (Wensing, Kim,
Slotine, RA-L 2018, (12)). That is linear in P, so that what the load adds to the base parameters
is linear in its ten inertial parameters.
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.base_parameters import PER_BODY
from adaptive_blf_control.arms.pseudo_inertia import BASIS, inertial_parameters
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.errors import ParameterError

__all__ = ['load_frames', 'load_map']


def load_frames(arm: UrdfArm) -> tuple[str, ...]:
    """Return the links of the URDF that a joint of the arm moves, base first."""
    return tuple(frame.name for frame in arm.model.frames
                 if frame.parentJoint > 0 and 'BODY' in str(frame.type))


def load_map(arm: Arm, frame: str, name: str = 'payload.frame') -> np.ndarray:
    """Return what a load adds to θ per inertial parameter, shape (m, 10).

    Args:
        arm: The arm, from a URDF.
        frame: Link or joint of the URDF whose frame the load is fixed to and described in.
        name: The parameter that names it, for messages.

    Raises:
        ParameterError: there is no such frame, no joint of the arm moves it, or the arm is not
            from a URDF.
    """
    if not isinstance(arm, UrdfArm):
        raise ParameterError(name, frame, f'nothing: {type(arm).__name__} is not from a URDF and '
                             'has no frames')
    found = [each for each in arm.model.frames if each.name == frame and each.parentJoint > 0]
    if not found:
        raise ParameterError(name, frame, 'a link that a joint of the arm moves: one of '
                             + ', '.join(load_frames(arm)))
    found.sort(key=lambda each: 'BODY' not in str(each.type))  # a link may be named as a joint
    placement = np.asarray(found[0].placement.homogeneous)
    of_body = inertial_parameters(placement @ BASIS @ placement.T).T
    body = arm.joints.index(arm.model.names[found[0].parentJoint])
    result = np.zeros((arm.m, PER_BODY))
    own = slice(PER_BODY * body, PER_BODY * (body + 1))
    result[:arm.base_count] = arm.base_from_standard[:, own] @ of_body
    return result
