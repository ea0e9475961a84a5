# SPDX-License-Identifier: Apache-2.0
"""What holds for every test: an isolated ROS graph, seeded properties, the measured logs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
import os
from pathlib import Path
import signal
import tempfile

import pytest

from adaptive_blf_control.runtime.domain import own_domain
from patience import MEANT_TO_FAIL

pytest_plugins = ('node_fixtures', 'run_fixtures')  # of test/support

REPOSITORY = Path(__file__).resolve().parents[1]

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
# The package sets this on import, which is too late where a test module imports numpy first.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
_log_folder = tempfile.TemporaryDirectory(prefix='adaptive_blf_control_ros_log_')
os.environ['ROS_LOG_DIR'] = _log_folder.name
os.environ['ROS_HOME'] = _log_folder.name  # where estimates go by default

try:
    from hypothesis import Phase, settings
except ImportError:  # colcon test on a machine with pytest alone: property tests skip themselves
    pass
else:
    phases = (Phase.explicit, Phase.generate) if MEANT_TO_FAIL else tuple(Phase)
    settings.register_profile('repository', deadline=None, derandomize=True, database=None,
                              phases=phases)
    settings.load_profile('repository')


def pytest_configure(config: pytest.Config) -> None:
    """Take a DDS domain for this process alone: no other run, and no other worker, hears it."""
    claim = ExitStack()
    config.add_cleanup(claim.close)
    os.environ['ROS_DOMAIN_ID'] = str(claim.enter_context(own_domain()))


@pytest.fixture(scope='session', autouse=True)
def _default_signals() -> Iterator[None]:
    """Let the processes that tests start begin with the default signals.

    A shell that starts the suite in the background, or nohup, lets it ignore some of them. A child
    would inherit that; a handler it does not inherit, whatever that does.
    """
    ignored = [number for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM)
               if signal.getsignal(number) == signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, lambda *_: None)
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


# They run real nodes in real time, or measure.
_REAL_TIME = ('nodes', 'bench', 'runtime')


# They solve thousands of eigenvalue problems, or simulate for long: minutes without numba.
_SLOW_PLAIN = {
    'test_an_arm_in_mujoco_is_varied_as_any', 'test_integration_is_of_fourth_order',
    'test_pruned_search_equals_brute_force_with_more_parameters_than_kept_directions',
    'test_rank_never_falls_while_the_stack_is_deficient',
    'test_sums_stay_exact_over_hundreds_of_replacements',
    'test_the_rank_grows_whenever_some_replacement_makes_it_grow'}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is not to run beside what computes, and what needs compiled laws."""
    for item in items:
        room = item.path.relative_to(REPOSITORY / 'test').parts[0]
        if room in _REAL_TIME:
            item.add_marker(pytest.mark.real_time)
        if getattr(item, 'originalname', item.name) in _SLOW_PLAIN:
            item.add_marker(pytest.mark.slow_plain)


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
