# SPDX-License-Identifier: Apache-2.0
"""θ̂ as a YAML file that a later run can start from, matched by parameter name."""

from __future__ import annotations

from collections.abc import Mapping
import os
from pathlib import Path

import numpy as np
import yaml

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.identifier import Identifier

__all__ = ['read_estimate', 'write_estimate']


def write_estimate(path: Path, parameters: tuple[str, ...], identifier: Identifier) -> None:
    """Write θ̂ with the state of its history, atomically: a reader never sees half a file.

    Raises:
        OSError: the file cannot be written.
    """
    stack = identifier.stack
    content: Mapping[str, object] = {
        'theta_hat': dict(zip(parameters, identifier.theta.tolist())),
        'history_rank': stack.rank,
        'history_sigma_min': stack.sigma_min,
        'insertions': stack.insertions,
    }
    temporary = path.with_name(f'.{path.name}.{os.getpid()}')
    temporary.write_text(yaml.safe_dump(content, sort_keys=False), encoding='utf-8')
    temporary.replace(path)


def read_estimate(path: Path, parameters: tuple[str, ...]) -> np.ndarray:
    """Read θ̂ that :func:`write_estimate` wrote, in the order of ``parameters``, shape (m,).

    Raises:
        ParameterError: the file cannot be read or lacks a parameter.
    """
    name = 'identifier.initial_estimate_file'
    try:
        values = yaml.safe_load(path.read_text(encoding='utf-8'))['theta_hat']
        return np.array([float(values[parameter]) for parameter in parameters])
    except OSError as error:
        raise ParameterError(name, str(path), f'a readable file ({error.strerror})') from None
    except KeyError as error:
        raise ParameterError(name, str(path), f'an entry {error.args[0]!r}') from None
    except (TypeError, ValueError, yaml.YAMLError):
        raise ParameterError(name, str(path),
                             'a mapping theta_hat of parameter names to numbers') from None
