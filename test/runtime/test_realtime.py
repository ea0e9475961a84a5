# SPDX-License-Identifier: Apache-2.0
"""Who goes first: what the system permits is done to every thread, what it does not is said."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.runtime.realtime import cpus_of
from patience import PATIENCE

pytestmark = pytest.mark.skipif(sys.platform != 'linux', reason="the scheduler calls are Linux's")

# Each runs in a process of its own: what it does to its threads must not stay with the tests.
BEGIN = """
import json, os, sys, threading
from pathlib import Path
from adaptive_blf_control.runtime import realtime
hold = threading.Event()
other = threading.Thread(target=hold.wait, daemon=True)
other.start()
threads = [int(task.name) for task in Path('/proc/self/task').iterdir()]
"""


def _run(code: str) -> object:
    done = subprocess.run([sys.executable, '-c', BEGIN + code], capture_output=True, text=True,
                          timeout=PATIENCE, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_processors_are_read_from_numbers_and_ranges() -> None:
    first = min(os.sched_getaffinity(0))
    assert cpus_of('') == set()
    assert cpus_of(f'{first}') == cpus_of(f'{first}-{first}') == {first}
    assert cpus_of(f'{first},{first}') == {first}


@pytest.mark.parametrize('text', ['one', '0-', '1,,x', '100000', '-1'])
def test_processors_that_cannot_be_used_are_refused_with_what_is_there(text: str) -> None:
    with pytest.raises(ParameterError, match='realtime.cpus'):
        cpus_of(text)


def test_every_thread_keeps_to_the_processors() -> None:
    first = min(os.sched_getaffinity(0))
    assert _run(f"""
realtime.stay_on({{{first}}})
print(json.dumps([sorted(os.sched_getaffinity(thread)) for thread in threads]))
""") == [[first]] * 2


def test_threads_that_end_meanwhile_do_not_matter() -> None:
    assert _run(f"""
def churn():
    while not hold.is_set():
        thread = threading.Thread(target=int)
        thread.start()
        thread.join()
churners = [threading.Thread(target=churn) for _ in range(3)]
for churner in churners:
    churner.start()
try:
    for _ in range(500):
        realtime.short_slices(2e-4)
        realtime.stay_on({os.sched_getaffinity(0)!r})
        reason = realtime.raise_priority(1)
        if 'No such process' in (reason or ''):
            break
finally:
    hold.set()
    for churner in churners:
        churner.join()
print(json.dumps('No such process' in (reason or '')))
""") is False


def test_only_the_calling_thread_steps_back() -> None:
    mine, others = _run("""
realtime.step_back(7)
nice = [os.getpriority(os.PRIO_PROCESS, thread) for thread in (threads[0], other.native_id)]
print(json.dumps(nice))
""")
    assert mine == 7
    assert others < 7


def test_short_turns_are_asked_for_every_thread_and_leave_its_nice_value() -> None:
    slices, nice = _run("""
import ctypes, platform, struct
os.setpriority(os.PRIO_PROCESS, 0, 3)
realtime.short_slices(2e-4)
number = {'x86_64': 315, 'aarch64': 275}.get(platform.machine())
def ask(thread):
    answer = ctypes.create_string_buffer(48)
    if number is None or ctypes.CDLL(None).syscall(number, thread, answer, 48, 0) != 0:
        return None
    return struct.unpack('=IIQiIQQQ', answer.raw)[5]
print(json.dumps([[ask(thread) for thread in threads], os.getpriority(os.PRIO_PROCESS, 0)]))
""")
    assert nice == 3
    if slices[0] in (None, 0):
        pytest.skip('this kernel has no slices to ask for (Linux 6.12 and later)')
    assert slices == [200_000, 200_000]


def test_real_time_priority_is_given_to_every_thread_or_refused_with_how_to_allow_it() -> None:
    refused, policies = _run("""
reason = realtime.raise_priority(1)
print(json.dumps([reason, [os.sched_getscheduler(thread) for thread in threads]]))
""")
    if refused is None:
        assert policies == [os.SCHED_FIFO] * 2
    else:
        assert 'limits.d' in refused
        assert os.SCHED_FIFO not in policies[:1]


def test_without_the_right_real_time_priority_and_locked_memory_are_refused_politely() -> None:
    reasons = _run("""
import resource
if os.getuid() == 0:
    os.setgid(65534); os.setuid(65534)
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
print(json.dumps([realtime.raise_priority(50), realtime.lock_memory()]))
""")
    assert [reason.split(':')[0] for reason in reasons] == ['real-time priority 50',
                                                            'locked memory']
    assert all('limits.d' in reason for reason in reasons)


def test_the_waits_of_the_thread_that_asks_are_not_drawn_out() -> None:
    assert _run("""
import ctypes
realtime.sharp_timer()
print(json.dumps(ctypes.CDLL(None).prctl(30, 0, 0, 0, 0)))  # PR_GET_TIMERSLACK
""") == 1
