# SPDX-License-Identifier: Apache-2.0
"""What somebody who guesses a name of a `Controller` that is not there may mean."""

from __future__ import annotations

__all__ = ['INSTEAD']

INSTEAD = {
    **dict.fromkeys(('from_yaml', 'from_file', 'from_config', 'load'),
                    'simulate(file, 0.001).controller is that of a parameter file'),
    **dict.fromkeys(('publish', 'subscribe', 'spin'),
                    '`python -m adaptive_blf_control controller` is the node'),
    **dict.fromkeys(('reset', 'restart', 'start'),
                    'begin(q, qd) begins another motion, whose time is 0 at its first '
                    'sample'),
    **dict.fromkeys(('save', 'to_yaml', 'dump'),
                    'settings.values() has all that it was made with by name; what is '
                    'learned is in the Identifier'),
    '()': 'update(t, q, qd, theta) returns the output, whose torque is to be sent',
    'theta': 'update is given it: the theta of an Identifier',
    'gains': 'settings has them, retune(k2=...) changes them',
    'set_reference': 'retune(t, q, reference=...) changes it',
}
