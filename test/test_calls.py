# SPDX-License-Identifier: Apache-2.0
"""Facts about calls with wrong arguments: what the error names and says."""

from __future__ import annotations

import pytest

from adaptive_blf_control.calls import argument_names, checked_call
from adaptive_blf_control.errors import ParameterError, UnknownParameter


@checked_call
def weigh(mass, height=1.0, *, gravity=9.81, **others):
    """Return an energy.

    Args:
        mass: What is lifted, e.g. a load [kg]. It may be zero.
        height: How far
            it is lifted [m].
        gravity: Where [m/s²].
    """
    return mass * height * gravity + len(others)


class Scale:
    """Something with a constructor and a method."""

    @checked_call
    def __init__(self, limit):
        """Take a limit."""
        self.limit = limit

    @checked_call
    def read(self, unit, digits=2):
        """Fail inside."""
        return digits + unit


def test_a_call_that_fits_is_left_alone():
    assert weigh(1.0, 2.0, gravity=3.0, colour='red') == 7.0
    assert weigh.__name__ == 'weigh'
    assert argument_names(weigh) == ['mass', 'height', 'gravity']


@pytest.mark.parametrize(('call', 'message'), [
    (lambda: weigh(), r"parameter 'mass' is missing: expected weigh\(mass, height=\.\.\., \*, "
     r'gravity=\.\.\.\), mass: What is lifted, e\.g\. a load \[kg\]$'),
    (lambda: weigh(1.0, 2.0, 3.0), r"'weigh' is given 3 arguments in order: expected at most 2 of "
     'them'),
    (lambda: weigh(1.0, mass=2.0), r"'mass' is 2\.0: expected one value, not two"),
    (lambda: Scale(), r"'limit' is missing: expected Scale\(limit\)$"),
    (lambda: Scale(1.0).read(), r"'unit' is missing: expected read\(unit, digits=\.\.\.\)$"),
    (lambda: Scale(1.0).read(1, 2, 3), r'given 3 arguments in order: expected at most 2'),
])
def test_a_call_that_does_not_fit_names_the_argument_and_what_it_is(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


def test_an_unknown_argument_is_told_the_one_that_is_meant():
    with pytest.raises(UnknownParameter, match=r"'limits' is 2\.0.*did you mean limit\?"):
        Scale(limits=2.0)
    with pytest.raises(UnknownParameter, match=r"'n_digits' is 3.*did you mean digits\?"):
        Scale(1.0).read(1, n_digits=3)


def test_a_type_error_from_inside_passes_unchanged():
    with pytest.raises(TypeError, match='unsupported operand') as caught:
        Scale(1.0).read('kg')
    assert not isinstance(caught.value, ParameterError)
