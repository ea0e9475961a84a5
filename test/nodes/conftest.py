# SPDX-License-Identifier: Apache-2.0
"""Without ROS this folder is skipped; what its tests share is in ``test/support``."""

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')
