# SPDX-License-Identifier: Apache-2.0
"""What ends a process while its node is being made, and while it leaves the graph."""

from __future__ import annotations

import signal
import subprocess
import sys
import textwrap

import pytest

from patience import PATIENCE


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_process_though_nothing_looks_at_the_flag(
        number: signal.Signals) -> None:
    pytest.importorskip('rclpy', reason='no ROS 2 here')
    # Like the compiler: calls into C that give the interpreter away, and nobody asks for the stop.
    script = textwrap.dedent("""
        import ctypes
        from adaptive_blf_control.runtime.process import ends_on_signal, stop_on_signals
        stop_on_signals()
        with ends_on_signal():
            print('working', flush=True)
            while True:
                ctypes.CDLL(None).sleep(1000)
    """)
    process = subprocess.Popen([sys.executable, '-c', script], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    with process:
        assert process.stdout.readline() == 'working\n'
        process.send_signal(number)
        assert process.wait(PATIENCE) == 128 + number


def test_what_is_done_before_a_signal_is_not_ended_by_it_later() -> None:
    pytest.importorskip('rclpy', reason='no ROS 2 here')
    script = textwrap.dedent("""
        import os, signal
        from adaptive_blf_control.runtime import process
        stop = process.stop_on_signals()
        process.GRACE = 0.01
        with process.ends_on_signal():
            pass
        os.kill(os.getpid(), signal.SIGINT)
        assert stop.wait(60.0) and stop.signal == signal.SIGINT
        assert signal.set_wakeup_fd(-1) == -1
        print('still here')
    """)
    result = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True,
                            timeout=PATIENCE, check=False)
    assert (result.returncode, result.stdout) == (0, 'still here\n'), result.stderr


def test_a_process_that_cannot_leave_the_graph_ends_and_says_where_it_waited() -> None:
    pytest.importorskip('rclpy', reason='no ROS 2 here')
    # Like Fast DDS where it waits for itself: a call into C that holds the interpreter.
    script = textwrap.dedent("""
        import ctypes
        from adaptive_blf_control.runtime import process
        process.LEAVE = 0.5
        with process.leaves_in_time():
            pass
        ctypes.PyDLL(None).usleep(900_000)
        print('left in time', flush=True)
        with process.leaves_in_time():
            ctypes.PyDLL(None).sleep(1000)
    """)
    result = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True,
                            timeout=PATIENCE, check=False)
    assert (result.returncode, result.stdout) == (1, 'left in time\n'), result.stderr
    assert 'line 10 in <module>' in result.stderr
