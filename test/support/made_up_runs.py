# SPDX-License-Identifier: Apache-2.0
"""Bags of an arm whose motion is known in closed form."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.configuration.parameter_file import node_settings, PARAMETERS_KEY
from adaptive_blf_control.control.constraints import MarginName
from adaptive_blf_control.messages.cdr import encode_float64, encode_int32, Float64MultiArrayCodec
from adaptive_blf_control.messages.controller_codecs import margin_names
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.topics import (
    BARRIER,
    COMMANDS,
    EXTERNAL_TORQUE,
    HISTORY_RANK,
    HISTORY_SIGMA_MIN,
    JOINT_STATES,
    RECORDED,
    REFERENCE,
    THETA_HAT,
    TRACKING_ERROR,
)

__all__ = ['write_run']

EPOCH_NS = 5_000_000_000
RATE = 1000
DELAY_NS = 300_000  # from a state to its command at the recorder
PERFORMANCE = 0.2


def run_parameters(arm: str, n: int) -> dict[str, Any]:
    """Return the parameter file of a made-up run."""
    return {
        '/**': {'ros__parameters': {'arm': arm, 'joints': [f'joint{i + 1}' for i in range(n)]}},
        '/**/arm_driver': {'ros__parameters': {'rate': float(RATE)}},
        '/**/controller': {'ros__parameters': {
            'safety': {'lower': [-1.5], 'upper': [1.5]},
            'performance': {'lower': [-PERFORMANCE], 'upper': [PERFORMANCE]}}}}


def write_run(path: Path, seconds: float = 2.0, arm: str = 'two_link', error: float = 0.05,
             parameters: bool = True, topics: Collection[str] = tuple(RECORDED),
             skip: Collection[int] = (), first_estimate: float = 0.0,
             pushed: tuple[float, float] | None = None) -> Path:
    """Write a run: q follows sin t with an error that decays from ``error`` within 0.5 s.

    θ̂ approaches θ* as 2⁻ᵗ·θ* would, ten times as fast. States whose number is in ``skip`` are
    missing on every topic; estimates start at ``first_estimate`` [s]. In the interval ``pushed``
    [s] 5 N·m act on the first joint from outside, of which 1 N·m means nothing.
    """
    data = run_parameters(arm, 2 if arm == 'two_link' else 3)
    model = build_arm(node_settings(data, ControllerNodeSettings))
    writer = BagWriter(path, custom_data={PARAMETERS_KEY: yaml.safe_dump(data)}
                       if parameters else {})
    codecs = {JOINT_STATES: JointStateCodec(model.joints),
              REFERENCE: JointStateCodec(model.joints),
              TRACKING_ERROR: JointStateCodec(model.joints, fields=('position', 'velocity')),
              THETA_HAT: JointStateCodec(model.parameters, fields=('position',)),
              EXTERNAL_TORQUE: JointStateCodec(
                  (*model.joints, *(f'{joint}.bound' for joint in model.joints)),
                  fields=('position',)),
              BARRIER: JointStateCodec(
                  margin_names([MarginName(joint, what) for what in ('safety', 'performance')
                                 for joint in model.joints]), fields=('position',))}
    torque = Float64MultiArrayCodec(model.n)
    for topic, type_name in RECORDED.items():
        if topic in topics and topic != '/diagnostics':
            writer.add_topic(f'/{topic}', type_name)
    scale = 1.0 / (1.0 + np.arange(model.n))
    for k in range(int(seconds * RATE) + 1):
        if k in skip:
            continue
        t, stamp = k / RATE, EPOCH_NS + k * 1_000_000
        e1, yd = error * np.exp(-2.0 * t) * scale, np.sin(t) * scale
        q, tau = yd + e1, 3.0 * np.cos(7.0 * t) * scale
        messages = {
            JOINT_STATES: codecs[JOINT_STATES].encode(stamp, q, np.cos(t) * scale, tau),
            REFERENCE: codecs[REFERENCE].encode(stamp, yd, np.cos(t) * scale, -yd),
            TRACKING_ERROR: codecs[TRACKING_ERROR].encode(stamp, e1, -2.0 * e1),
            THETA_HAT: codecs[THETA_HAT].encode(stamp, model.nominal * (1.0 - 0.5 ** (10.0 * t))),
            BARRIER: codecs[BARRIER].encode(stamp, np.concatenate(
                [1.5 - np.abs(q), PERFORMANCE - np.abs(e1), [np.sum(e1 ** 2)]])),
            COMMANDS: torque.encode(tau)}
        if pushed is not None and k % 10 == 0:
            outside = np.zeros(model.n)
            outside[0] = 5.0 if pushed[0] <= t <= pushed[1] else 0.0
            messages[EXTERNAL_TORQUE] = codecs[EXTERNAL_TORQUE].encode(
                stamp, np.concatenate([outside, np.ones(model.n)]))
        if k % 100 == 0:
            messages[HISTORY_RANK] = encode_int32(min(k // 100, model.m))
            messages[HISTORY_SIGMA_MIN] = encode_float64(1e-3 * k)
        for topic, message in messages.items():
            if topic in topics and not (topic == THETA_HAT and t < first_estimate):
                late = DELAY_NS if topic == COMMANDS else 0
                writer.write(f'/{topic}', message, stamp + late)
    writer.close()
    return path
