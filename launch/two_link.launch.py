# SPDX-License-Identifier: Apache-2.0
"""The paper's two-link arm: ``arm.launch.py`` with its default parameter file and arguments.

``ros2 launch adaptive_blf_control two_link.launch.py bag:=/tmp/first_run namespace:=left_arm``
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource


def generate_launch_description() -> LaunchDescription:
    """Return what ``arm.launch.py`` does."""
    arm = Path(__file__).with_name('arm.launch.py')
    return LaunchDescription([IncludeLaunchDescription(PythonLaunchDescriptionSource(str(arm)))])
