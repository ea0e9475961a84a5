# SPDX-License-Identifier: Apache-2.0
"""Facts about the laws as compiled functions: the same numbers as the Python they are made of."""

from __future__ import annotations

import copy
import math
import os
import pickle
import re
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest

from adaptive_blf_control.arms import two_link
from adaptive_blf_control.compiled import (
    all_finite,
    before_each_compilation,
    borrowed,
    both_finite,
    by_type,
    COMPILED,
    cos_sin,
    entry_for,
    handle,
    jit,
    jit_apart,
    uncompiled,
)
from adaptive_blf_control.control import barrier, law, reference
from adaptive_blf_control.identification import change_monitor, pair_selection
from nested_suite import run_tests

N, M = 2, 5
RANDOM = np.random.default_rng(20)


def vector(scale: float = 1.0) -> np.ndarray:
    return scale * RANDOM.normal(size=N)


def matrix() -> np.ndarray:
    return RANDOM.normal(size=(N, M))


B = np.full(N, 0.2)
WEIGHT = np.array([0.5, 2.0])
STATE = (vector(), vector())
THETA = np.array([3.473, 0.196, 0.242, 5.3, 1.1])

CASES = {
    two_link.two_link_Y1: STATE,
    two_link.two_link_Y2: STATE,
    two_link.two_link_Y12: STATE,
    two_link.two_link_X: (*STATE, vector(), vector()),
    two_link.two_link_acceleration: (*STATE, vector(10.0), THETA),
    barrier.active_bound: (vector(), -B, B),
    barrier.interior: (vector(), B),
    barrier.barrier: (vector(0.05), B, WEIGHT),
    barrier.barrier_gradient: (vector(0.05), B, WEIGHT),
    law.stabilising_function: (vector(0.05), vector(), vector(), vector(), B, np.full(N, 40.0)),
    law.per_joint_coupling: (vector(0.05), vector(), B, WEIGHT),
    law.pseudoinverse_coupling: (vector(0.05), vector(), B, WEIGHT),
    law.torque: (matrix(), THETA, np.full(N, 30.0), vector(0.05), vector(), B,
                 WEIGHT, True),
    law.limited: (np.array([np.nan, -5.0]), np.ones(N)),
    law.errors: (vector(), vector(), vector(), vector(), vector(), -B, B, np.full(N, 40.0)),
    reference.quintic: (0.7, 2.0),
    reference._blend: (0.7, 2.0, *(vector() for _ in range(6))),
    change_monitor.residual_with_scale: (vector(), 0.3, THETA[:N], matrix()[:, :N].copy(), 0.1,
                                         0.2),
    pair_selection.is_different: (matrix(), matrix(), 0.1),
    all_finite: (vector(),),
}


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
@pytest.mark.parametrize('function', CASES, ids=lambda function: function.__name__)
def test_a_compiled_function_equals_its_python(function):
    arguments = CASES[function]
    compiled, plain = function(*arguments), function.py_func(*arguments)
    if not isinstance(plain, tuple):
        compiled, plain = (compiled,), (plain,)
    for got, expected in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-13)


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
def test_compiled_sinusoids_equal_those_in_python():
    given = reference.Sinusoids(vector(), matrix(), matrix(), matrix())
    points = [reference.ReferencePoint(*np.zeros((3, N))) for _ in range(2)]
    reference.write_sinusoids(points[0], 0.7, given)
    reference.write_sinusoids.py_func(points[1], 0.7, given)
    assert np.all(points[1])
    for got, expected in zip(*points):
        np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-13)


LEARNING = """
import numpy as np
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.update_law import advance, kept_history
n, m = 2, 17
random, stack, kept = np.random.default_rng(4), HistoryStack(n, m, 12, 0.1), kept_history(n, m)
theta, gamma, slots = np.zeros(m), random.uniform(0.5, 2.0, m), []
for _ in range(90):
    pair = random.normal(size=(n, m)), random.normal(size=n)
    slots.append(stack.offer(*pair))
    advance(kept, theta, 1e-3, gamma, 10.0, 100.0, *pair, stack.gram, stack.moment, theta)
stack.resize(10)
slots += [stack.offer(*pair) for _ in range(3)]
assert stack.rank == m and stack.insertions > 20
print(COMPILED, slots, stack.sigma_min.hex(), theta.tobytes().hex(), stack.gram.tobytes().hex())
"""


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
def test_history_and_update_give_the_same_bits_compiled_and_in_python():
    printed = [subprocess.run([sys.executable, '-c', LEARNING], check=True, capture_output=True,
                              text=True, env={**os.environ, 'NUMBA_DISABLE_JIT': switch,
                                              'PYTHONPATH': os.pathsep.join(sys.path)}).stdout
               for switch in '01']
    compiled, plain = (text.partition(' ') for text in printed)
    assert (compiled[0], plain[0]) == ('True', 'False')
    assert compiled[2] == plain[2]


APART = """
from adaptive_blf_control.compiled import jit, jit_apart
@jit_apart
def halved(x):
    return 0.5 * x[0]
@jit
def caller(x):
    return halved(x)
"""


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
def test_what_compiled_functions_call_apart_is_not_what_another_process_calls(tmp_path):
    (tmp_path / 'a_module_of_the_test.py').write_text(APART, encoding='utf-8')
    for called in ('caller', 'halved', 'caller', 'halved'):
        run = subprocess.run(
            [sys.executable, '-c', 'import numpy, a_module_of_the_test as module\n'
             f'print(module.{called}(numpy.ones(3)))'], capture_output=True, text=True,
            env={**os.environ, 'PYTHONPATH': os.pathsep.join([str(tmp_path), *sys.path])})
        assert (run.returncode, run.stdout) == (0, '0.5\n'), (called, run.stderr)


@pytest.mark.parametrize(('values', 'expected'), [
    ([0.0, 1e308], True), ([], True), ([np.nan, 0.0], False), ([0.0, np.inf], False),
    ([-np.inf, 0.0], False)])
def test_all_finite_sees_every_element(values, expected):
    assert all_finite(np.array(values, dtype=float)) is expected


BLOCKED = """
import sys
sys.modules['numba'] = None
from adaptive_blf_control.compiled import COMPILED, jit
def function(x): return x
assert not COMPILED
assert jit(function) is function
import adaptive_blf_control.simulation.closed_loop
"""


def test_the_core_works_where_numba_is_not_installed():
    subprocess.run([sys.executable, '-c', BLOCKED], check=True,
                   env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)})


class Scale(NamedTuple):
    factor: np.ndarray


@jit
def scaled_sum(scale, values: np.ndarray, times: float) -> float:
    return times * scale.value.factor[0] * borrowed(values).sum()


def test_an_entry_computes_what_its_function_does():
    scale, values = handle(Scale(np.array([3.0]))), np.array([1.0, 2.0])
    entry = entry_for(scaled_sum, scale, values, 1.0)
    assert entry(scale, values, 2.0) == scaled_sum(scale, values, 2.0) == 18.0
    assert entry_for(scaled_sum, scale, values, 1.0)(scale, values, 2.0) == 18.0
    assert entry(handle(Scale(np.array([-1.0]))), np.ones(5), 1.0) == -5.0


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
def test_an_entry_refuses_an_array_of_other_numbers():
    scale, values = handle(Scale(np.array([3.0]))), np.array([1.0, 2.0])
    entry = entry_for(scaled_sum, scale, values, 1.0)
    for wrong in (values.astype(np.float32), values.astype('>f8'), values.astype(np.int64),
                  np.ones((2, 2)), np.ones(6)[::2], np.float64(2.0), [1.0, 2.0], None):
        with pytest.raises(TypeError, match='expected a contiguous array of float64'):
            entry(scale, wrong, 1.0)


@jit
def number_of_ones(data: bytes) -> int:
    ones = 0
    for value in borrowed(data):
        ones += value == 1
    return ones


def test_an_entry_reads_bytes_and_vectors_of_any_length_and_keeps_neither():
    # Each is a type of its own; one reference is the caller's, one that of `getrefcount`.
    entry, both = entry_for(number_of_ones, b''), entry_for(both_finite, np.ones(2), np.ones(2))
    for given in (bytes(0), bytes((1, 0, 1, 255)), bytes(1000) + b'\x01'):
        before = sys.getrefcount(given)
        assert entry(given) == given.count(1)
        assert sys.getrefcount(given) == before
    for bad in (np.nan, np.inf, -np.inf):
        for place in range(7):
            values = np.ones(7)
            values[place] = bad
            before = sys.getrefcount(values)
            assert not both(values, np.ones(1))
            assert not both(np.ones(1), values)
            assert sys.getrefcount(values) == before
    assert both(np.ones(7), np.zeros(0))


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
def test_an_entry_refuses_what_is_no_bytes():
    entry = entry_for(number_of_ones, b'')
    for wrong in (bytearray(b'abc'), memoryview(b'abc'), 'abc', None, np.zeros(3, np.uint8)):
        with pytest.raises(TypeError, match='expected bytes'):
            entry(wrong)


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
def test_the_control_room_passes_its_tests_as_plain_python():
    # Python raises where compiled code goes on with NaN.
    run = run_tests('test/control', NUMBA_DISABLE_JIT='1')
    assert run.returncode == 0, run.stdout


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
def test_what_is_called_before_each_compilation_may_end_it():
    numba = pytest.importorskip('numba')

    @numba.njit
    def inner(x: float) -> float:
        return 2.0 * x

    @numba.njit
    def outer(x: float) -> float:
        return inner(x) + 1.0

    calls = []

    def second_time() -> None:
        calls.append(len(calls))
        if len(calls) == 2:
            raise SystemExit(130)

    with before_each_compilation(second_time), pytest.raises(SystemExit):
        outer(1.0)
    assert calls == [0, 1]  # outer, then inner, which it needs
    assert outer(1.0) == 3.0
    assert calls == [0, 1]


class Circle(NamedTuple):
    """A shape to tell from a square."""

    radius: float


class Square(NamedTuple):
    """A shape to tell from a circle."""

    side: float


@by_type
def area(shape: Circle | Square) -> float:
    """Return the area of a shape; no other is known."""
    raise TypeError(type(shape).__name__)


@jit
def circle_area(shape: Circle) -> float:
    """Return the area of a circle."""
    return 3.0 * shape.radius * shape.radius


@jit
def square_area(shape: Square) -> float:
    """Return the area of a square."""
    return shape.side * shape.side


@jit
def volume(shape: Circle | Square, height: float) -> float:
    """Return the volume of a prism on a shape."""
    return height * area(shape)


area.register(Circle, circle_area)
area.register(Square, square_area)


def test_a_function_by_type_takes_the_implementation_of_its_first_argument():
    assert (area(Circle(2.0)), area(Square(2.0))) == (12.0, 4.0)
    with pytest.raises(TypeError, match='str'):
        area('round')


def test_a_compiled_function_calls_the_implementation_for_the_type_it_is_given():
    assert (volume(Circle(2.0), 5.0), volume(Square(2.0), 5.0)) == (60.0, 20.0)


def test_two_types_of_one_name_are_not_told_apart_and_the_second_is_refused():
    class Circle(NamedTuple):
        radius: float

    with pytest.raises(TypeError, match='Circle'):
        area.register(Circle, circle_area)


WARM = """
import numpy as np
from adaptive_blf_control.arms.three_link import ThreeLinkArm
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.compiled import before_each_compilation
with before_each_compilation(lambda: print('compiled')):
    for arm in (TwoLinkArm(), ThreeLinkArm()):
        state = np.zeros(arm.n)
        arm.dynamics(arm.nominal).advance(state, state, state, 1e-3, 1)
"""


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
def test_a_second_process_compiles_no_integrator():
    runs = [subprocess.run([sys.executable, '-c', WARM], check=True, capture_output=True,
                           text=True, env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)})
            for _ in range(2)]
    assert runs[-1].stdout == ''


class Counter(NamedTuple):
    count: np.ndarray
    step: float


@jit
def _count(counter) -> float:
    counter.value.count[0] += counter.value.step
    return counter.value.count[0]


def test_a_handle_shares_the_arrays_of_its_tuple_with_compiled_functions():
    counter = Counter(np.zeros(1), 2.0)
    held = handle(counter)
    assert [_count(held) for _ in range(3)] == [2.0, 4.0, 6.0]
    assert counter.count[0] == 6.0


def test_a_copied_handle_is_one_of_the_copied_tuple():
    counter = Counter(np.zeros(1), 2.0)
    held = handle(counter)
    for other in (copy.deepcopy(held), pickle.loads(pickle.dumps(held))):
        assert _count(other) == 2.0
        assert other.value.count[0] == 2.0
    assert counter.count[0] == 0.0


@pytest.mark.parametrize('function', [cos_sin, uncompiled(cos_sin)], ids=['as it runs', 'plain'])
def test_an_angle_that_is_not_finite_has_no_cosine_with_and_without_numba(function) -> None:
    assert function(2.0) == (math.cos(2.0), math.sin(2.0))
    for angle in (math.inf, -math.inf, math.nan):
        assert np.isnan(function(angle)).all()


class _Sum(NamedTuple):
    numbers: np.ndarray


@jit_apart
def _add_root(total: _Sum, value: float) -> None:
    total = borrowed(total)
    total.numbers[:] += np.sqrt(value)


@jit
def _add_both(total, first: float, second: float) -> None:
    _add_root(total.value, first)
    _add_root(total.value, second)


def test_a_function_apart_is_called_where_it_is_and_gives_what_it_gives_in_python() -> None:
    total = _Sum(np.zeros(3))
    _add_both(handle(total), 4.0, 9.0)
    _add_root(total, 16.0)
    uncompiled(_add_root)(total, 25.0)
    np.testing.assert_array_equal(total.numbers, 14.0)
    if COMPILED:
        (code,) = _add_both.inspect_llvm().values()
        assert re.search(r'declare \S+ @\S*_add_root', code)
        assert 'sqrt' not in code
