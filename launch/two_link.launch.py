# SPDX-License-Identifier: Apache-2.0
"""Start the simulated two-link arm, its identifier, its controller and a recorder.

``ros2 launch adaptive_blf_control two_link.launch.py bag:=/tmp/first_run namespace:=left_arm``

``use_sim_time:=true`` runs them in lockstep; with ``autostart:=false`` driver and controller wait
for ``ros2 lifecycle set``.
"""

from datetime import datetime

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'adaptive_blf_control'


def generate_launch_description() -> LaunchDescription:
    """Return the launch arguments and the four nodes."""
    params_file = LaunchConfiguration('params_file')
    namespace = LaunchConfiguration('namespace')
    bag = ParameterValue(LaunchConfiguration('bag'), value_type=str)
    clock = {'use_sim_time': ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool)}
    start = {'autostart': ParameterValue(LaunchConfiguration('autostart'), value_type=bool)}
    return LaunchDescription([
        DeclareLaunchArgument(
            'params_file',
            default_value=PathJoinSubstitution(
                [FindPackageShare(PACKAGE), 'config', 'two_link.yaml']),
            description='Scenario: the parameters of all four nodes.'),
        DeclareLaunchArgument(
            'bag',
            # The recorder refuses an existing folder, so each start needs a new name.
            default_value=datetime.now().strftime('two_link_%Y_%m_%d-%H_%M_%S'),
            description='Folder the recorder writes; must not exist yet.'),
        DeclareLaunchArgument(
            'namespace', default_value='', description='Namespace of all four nodes.'),
        DeclareLaunchArgument(
            'use_sim_time', default_value='false',
            description='Lockstep: the driver publishes /clock and waits for every answer.'),
        DeclareLaunchArgument(
            'autostart', default_value='true',
            description='Whether driver and controller configure and activate themselves.'),
        Node(package=PACKAGE, executable='recorder', name='recorder', namespace=namespace,
             output='screen', parameters=[params_file, clock, {'bag': bag}]),
        Node(package=PACKAGE, executable='identifier', name='identifier', namespace=namespace,
             output='screen', parameters=[params_file, clock]),
        # The end of the driver or of the controller ends the launch.
        Node(package=PACKAGE, executable='controller', name='controller', namespace=namespace,
             output='screen', parameters=[params_file, clock, start], on_exit=Shutdown()),
        Node(package=PACKAGE, executable='arm_driver', name='arm_driver', namespace=namespace,
             output='screen', parameters=[params_file, clock, start], on_exit=Shutdown()),
    ])
