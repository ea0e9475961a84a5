# SPDX-License-Identifier: Apache-2.0
"""ament_python package: ``colcon build``, ``pip install .`` and ``pip install -e .`` read this.

Kept plain on purpose (no generated code, no build system of its own): colcon runs it directly.
"""

from glob import glob
from pathlib import Path
import runpy

from setuptools import find_packages, setup

package_name = 'adaptive_blf_control'

# Run by path, not imported: the package itself may need what is not installed yet.
executables = runpy.run_path(
    str(Path(__file__).resolve().parent / package_name / 'executables.py'))

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(include=[package_name, f'{package_name}.*']),
    package_data={'': ['*.css', '*.js', '*.json', '*.xml', '*.yaml', 'py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/config', sorted(glob('config/*.*'))),
        (f'share/{package_name}/config/campaigns', sorted(glob('config/campaigns/*.*'))),
        (f'share/{package_name}/launch', sorted(glob('launch/*.launch.py'))),
        (f'share/{package_name}/rviz', sorted(glob('rviz/*.rviz'))),
    ],
    python_requires='>=3.10',
    # rclpy and common_interfaces come from the ROS installation, or from the extra `ros`.
    # mcap brings the decompressors; named because compressed bags need them, too.
    install_requires=['numpy>=1.26', 'mcap>=1.5', 'zstandard', 'lz4', 'PyYAML>=6.0'],
    extras_require={
        'ros': ['ros-jazzy-rclpy[fastrtps]>=7.1', 'ros-jazzy-common-interfaces>=5.3'],
        'urdf': ['pin>=3.3'],
        # numba's linear algebra calls the BLAS that scipy carries.
        'fast': ['numba>=0.59', 'scipy>=1.11'],
        # One wheel each for CPython 3.10 to 3.13, Apache-2.0; 4.0 needs a second package.
        'mujoco': ['mujoco>=3.3,<3.4'],
        'plot': ['matplotlib>=3.6', 'plotly>=6.0'],
        'campaign': ['tqdm>=4.60', 'pyarrow>=14', 'distributed>=2024.1'],
        'test': [
            'pytest>=7.4',
            'pytest-xdist>=3.5',
            'hypothesis>=6.98',
            'daqp>=0.7',
            'rosbags>=0.11',
            'mcap-ros2-support>=0.5',
            'example-robot-data>=4.3',
            # setuptools 80 removed what colcon's --symlink-install is built on.
            'setuptools<80',
            'colcon-core>=0.18',
            'colcon-ros>=0.5',
        ],
        'lint': ['ruff>=0.6', 'mypy>=1.9'],
    },
    zip_safe=True,
    maintainer='adaptive_blf_control developers',
    maintainer_email='maintainers@adaptive-blf-control.invalid',
    description='Adaptive barrier-Lyapunov control of unknown robot arms, and their '
                'identification without accelerations.',
    license='Apache-2.0',
    entry_points={'console_scripts': executables['console_scripts']()},
)
