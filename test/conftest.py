# SPDX-License-Identifier: Apache-2.0
"""What holds for every test: an isolated ROS graph, seeded properties, the measured logs."""

from __future__ import annotations

import atexit
from contextlib import ExitStack
import os
from pathlib import Path
import signal
import tempfile

import pytest

from adaptive_blf_control.runtime.domain import own_domain

REPOSITORY = Path(__file__).resolve().parents[1]

# A shell that starts the suite in the background lets it, and all that it starts, ignore these.
for _number, _default in ((signal.SIGINT, signal.default_int_handler),
                          (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(_number) == signal.SIG_IGN:
        signal.signal(_number, _default)

# Before any test module imports rclpy: two runs on one machine, or two workers of one run, must
# not hear each other.
_claim = ExitStack()
atexit.register(_claim.close)
os.environ['ROS_DOMAIN_ID'] = str(_claim.enter_context(own_domain()))
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


# They run real nodes in real time, or measure.
_REAL_TIME = ('nodes', 'bench', 'runtime')


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that are not to run beside others."""
    for item in items:
        room = item.path.relative_to(REPOSITORY / 'test').parts[0]
        if room in _REAL_TIME:
            item.add_marker(pytest.mark.real_time)


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
