# SPDX-License-Identifier: Apache-2.0
"""What holds for every test: an isolated ROS graph, seeded properties, the measured logs."""

from __future__ import annotations

import os
from pathlib import Path
import tempfile

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]

# Before any test module imports rclpy: two runs on one machine must not hear each other. On Linux
# domains 0 to 101 keep clear of the ephemeral ports; 0 is everybody's default.
os.environ['ROS_DOMAIN_ID'] = str(os.getpid() % 101 + 1)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
# The package sets this on import, which is too late where a test module imports numpy first.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
_log_folder = tempfile.TemporaryDirectory(prefix='adaptive_blf_control_ros_log_')
os.environ['ROS_LOG_DIR'] = _log_folder.name
os.environ['ROS_HOME'] = _log_folder.name  # where estimates go by default

try:
    from hypothesis import settings
except ImportError:  # colcon test on a machine with pytest alone: property tests skip themselves
    pass
else:
    settings.register_profile('repository', deadline=None, derandomize=True, database=None)
    settings.load_profile('repository')


@pytest.fixture(scope='session')
def repository() -> Path:
    """Return the root of the source tree."""
    return REPOSITORY


@pytest.fixture(scope='session')
def realdata() -> Path:
    """Return the folder of measured robot logs beside the repository, or skip."""
    folder = REPOSITORY.parent / 'shared' / 'realdata'
    if not folder.is_dir():
        pytest.skip(f'no measured logs: {folder} does not exist')
    return folder
