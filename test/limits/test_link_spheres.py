# SPDX-License-Identifier: Apache-2.0
"""Facts about the spheres on a chain: Pinocchio has them at the same places, moving alike."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.limits.link_spheres import LinkSpheres, sphere_centres, sphere_motion

pin = pytest.importorskip('pinocchio')

URDF = """<robot name="crane"><link name="base"/>
<joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/>
<origin xyz="0 0.1 0.3" rpy="0.2 0 0.4"/><axis xyz="0 1 0"/><limit lower="-1" upper="1"
effort="9" velocity="9"/></joint>
<link name="cart"><inertial><mass value="3"/><origin xyz="0 0 0.1"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="turn" type="revolute"><parent link="cart"/><child link="arm"/>
<origin xyz="0.1 0 0.2" rpy="0 0.7 0"/><axis xyz="0.6 0 0.8"/><limit lower="-2" upper="2"
effort="9" velocity="9"/></joint>
<link name="arm"><inertial><mass value="2"/><origin xyz="0.2 0 0"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="lift" type="continuous"><parent link="arm"/><child link="hand"/>
<origin xyz="0.5 0 0"/><axis xyz="0 1 0"/></joint>
<link name="hand"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link></robot>"""


@pytest.mark.parametrize('order', [('rail', 'turn', 'lift'), ('lift', 'rail', 'turn')])
def test_centres_jacobians_and_drifts_are_pinocchios(order):
    arm, random = UrdfArm(URDF, order), np.random.default_rng(0)
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    spheres = LinkSpheres(np.array([0, 1, 2, 3, 3]), random.normal(size=(5, 3)), np.full(5, 0.1))
    frames = [model.addFrame(pin.Frame(f's{k}', int(body), 0, pin.SE3(np.eye(3), centre),
                                       pin.FrameType.OP_FRAME))
              for k, (body, centre) in enumerate(zip(spheres.body, spheres.centre))]
    data = model.createData()
    names = list(model.names)[1:]
    for _ in range(20):
        q, qd = random.normal(size=(2, 3))
        theirs_q, theirs_qd = np.zeros(model.nq), np.zeros(model.nv)
        for name in names:
            joint, i = model.joints[model.getJointId(name)], order.index(name)
            theirs_qd[joint.idx_v] = qd[i]
            theirs_q[joint.idx_q:joint.idx_q + joint.nq] = (
                [np.cos(q[i]), np.sin(q[i])] if joint.nq == 2 else [q[i]])
        pin.forwardKinematics(model, data, theirs_q, theirs_qd, np.zeros(3))
        pin.updateFramePlacements(model, data)
        pin.computeJointJacobians(model, data, theirs_q)
        centres, jacobians, velocities, drifts = sphere_motion(arm.chain.chain, spheres, q, qd)
        np.testing.assert_allclose(centres, sphere_centres(arm.chain.chain, spheres, q))
        aligned = pin.LOCAL_WORLD_ALIGNED
        for k, frame in enumerate(frames):
            np.testing.assert_allclose(centres[k], data.oMf[frame].translation, atol=1e-12)
            theirs = pin.getFrameJacobian(model, data, frame, aligned)[:3]
            columns = [model.joints[model.getJointId(name)].idx_v for name in order]
            np.testing.assert_allclose(jacobians[k], theirs[:, columns], atol=1e-12)
            np.testing.assert_allclose(velocities[k], jacobians[k] @ qd, atol=1e-12)
            np.testing.assert_allclose(drifts[k], pin.getFrameClassicalAcceleration(
                model, data, frame, aligned).linear, atol=1e-11)
