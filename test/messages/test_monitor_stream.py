# SPDX-License-Identifier: Apache-2.0
"""Facts about what a controller's monitors publish, sample after sample."""

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.messages.controller_codecs import ControllerCodecs, MonitorStream
from adaptive_blf_control.messages.joint_state import decode_joint_state
from adaptive_blf_control.messages.topics import BARRIER, TRACKING_ERROR

EVERY = 3  # samples


@pytest.fixture
def answered():
    controller = Controller(TwoLinkArm(), start=[0.0, 0.0])
    return controller.answer(0.0, *np.zeros((2, 2)), np.zeros(5), np.zeros(2))


def published(answered, rows):
    """Return the margins of the messages for rows of margins that lie in one array, (k, 4)."""
    codecs = ControllerCodecs(('a', 'b'), ('p', 'q', 'r', 's', 't'), ('1', '2', '3', '4'))
    stream, margins, found = MonitorStream(codecs), np.empty(4), []
    for k, row in enumerate(rows):
        margins[:] = row
        messages = stream.messages(k, answered, margins, EVERY, lambda: 1.0)
        assert TRACKING_ERROR in messages
        assert (BARRIER in messages) == (k % EVERY == 0)
        if BARRIER in messages:
            found.append(decode_joint_state(messages[BARRIER]).position[:4])
    return np.array(found)


def test_margins_are_the_smallest_since_the_message_before(answered):
    rows = np.random.default_rng(0).normal(size=(13, 4))
    expected = [rows[0], *(rows[k:k + EVERY].min(axis=0) for k in range(1, 13, EVERY))]
    np.testing.assert_array_equal(published(answered, rows), expected)


@pytest.mark.parametrize('place', range(EVERY))
def test_a_margin_that_is_no_number_in_any_sample_is_published_as_such(answered, place):
    rows = np.ones((1 + EVERY, 4))
    rows[1 + place, 2] = np.nan
    assert np.isnan(published(answered, rows)[1]).tolist() == [False, False, True, False]
