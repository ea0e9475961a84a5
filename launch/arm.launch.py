# SPDX-License-Identifier: Apache-2.0
"""Start an arm, simulated or yours, with its identifier, its controller and a recorder.

``ros2 launch adaptive_blf_control arm.launch.py params_file:=my_arm.yaml plant:=mujoco``

``plant:=none`` starts no driver: that of your robot publishes the joint states. Where they are
installed, robot_state_publisher makes the frames of a simulated arm, and RViz shows it if there is
a display. ``composed:=true`` runs controller and identifier in one process, ``arm_control``.
``use_sim_time:=true`` runs the nodes in lockstep; with ``autostart:=false`` driver and controller
wait for ``ros2 lifecycle set``. The end of driver or controller ends the launch.
"""

from datetime import datetime
import os

from ament_index_python.packages import get_package_prefix, PackageNotFoundError
from launch import LaunchContext, LaunchDescription
from launch.action import Action
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from adaptive_blf_control.configuration.robot_description import description_in_file, root_link

PACKAGE = 'adaptive_blf_control'


def generate_launch_description() -> LaunchDescription:
    """Return the launch arguments and the nodes."""
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
            description='The parameters of all four nodes, as configure writes them.'),
        DeclareLaunchArgument(
            'plant', default_value='', choices=['', 'builtin', 'mujoco', 'none'],
            description='What is driven; none: your robot. By default as the file says.'),
        DeclareLaunchArgument(
            'bag',
            # The recorder refuses an existing folder, so each start needs a new name.
            default_value=datetime.now().strftime('arm_%Y_%m_%d-%H_%M_%S'),
            description='Folder the recorder writes; must not exist yet.'),
        DeclareLaunchArgument(
            'namespace', default_value='', description='Namespace of all nodes.'),
        DeclareLaunchArgument(
            'use_sim_time', default_value='false',
            description='Lockstep: the driver publishes /clock and waits for every answer.'),
        DeclareLaunchArgument(
            'autostart', default_value='true',
            description='Whether driver and controller configure and activate themselves.'),
        DeclareLaunchArgument(
            'composed', default_value='false', choices=['true', 'false'],
            description='Whether controller and identifier run in one process, arm_control.'),
        DeclareLaunchArgument(
            'rviz', default_value='auto', choices=['auto', 'true', 'false'],
            description='Whether RViz is started; auto: where it and a display are there.'),
        Node(package=PACKAGE, executable='recorder', name='recorder', namespace=namespace,
             output='screen', parameters=[params_file, clock, {'bag': bag}]),
        OpaqueFunction(function=_control, args=[params_file, namespace, clock, start]),
        OpaqueFunction(function=_driver, args=[params_file, namespace, clock, start]),
        OpaqueFunction(function=_viewers, args=[params_file, namespace]),
    ])


def _control(context: LaunchContext, params_file: LaunchConfiguration,
             namespace: LaunchConfiguration, clock: dict[str, ParameterValue],
             start: dict[str, ParameterValue]) -> list[Action]:
    """Return controller and identifier, in one process or in two."""
    if context.launch_configurations['composed'] == 'true':
        # Without a name, which would become that of both nodes.
        return [Node(package=PACKAGE, executable='arm_control', namespace=namespace,
                     output='screen', parameters=[params_file, clock, start],
                     on_exit=Shutdown())]
    return [Node(package=PACKAGE, executable='identifier', name='identifier',
                 namespace=namespace, output='screen', parameters=[params_file, clock]),
            Node(package=PACKAGE, executable='controller', name='controller',
                 namespace=namespace, output='screen', parameters=[params_file, clock, start],
                 on_exit=Shutdown())]


def _driver(context: LaunchContext, params_file: LaunchConfiguration,
            namespace: LaunchConfiguration, clock: dict[str, ParameterValue],
            start: dict[str, ParameterValue]) -> list[Action]:
    plant = context.launch_configurations['plant']
    if plant == 'none':
        return []
    chosen = [{'plant': plant}] if plant else []
    return [Node(package=PACKAGE, executable='arm_driver', name='arm_driver', namespace=namespace,
                 output='screen', parameters=[params_file, clock, start, *chosen],
                 on_exit=Shutdown())]


def _viewers(context: LaunchContext, params_file: LaunchConfiguration,
             namespace: LaunchConfiguration) -> list[Action]:
    """Return what draws the arm: the frames of a simulated one, and RViz."""
    rviz = context.launch_configurations['rviz']
    display = bool(os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY'))
    wanted = rviz == 'true' or (rviz == 'auto' and display and _installed('rviz2'))
    text = description_in_file(params_file.perform(context))
    actions: list[Action] = []
    if text is not None and context.launch_configurations['plant'] != 'none' and _installed(
            'robot_state_publisher'):
        actions.append(Node(
            package='robot_state_publisher', executable='robot_state_publisher',
            namespace=namespace, output='screen',
            parameters=[{'robot_description': ParameterValue(text, value_type=str)}]))
    if wanted:
        config = PathJoinSubstitution([FindPackageShare(PACKAGE), 'rviz', 'arm.rviz'])
        frame = [] if text is None else ['-f', root_link(text)]
        # The file names the topic without a namespace, so that one file shows any arm.
        actions.append(Node(
            package='rviz2', executable='rviz2', namespace=namespace, output='screen',
            arguments=['-d', config, *frame],
            remappings=[('/robot_description', 'robot_description')]))
    return actions


def _installed(package: str) -> bool:
    try:
        get_package_prefix(package)
    except PackageNotFoundError:
        return False
    return True
