# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Metadata of the package: one place for pip and for colcon."""

from pathlib import Path

from setuptools import Distribution, find_packages, setup

NAME = 'lava_ros'

# colcon runs a link to this file elsewhere.
ROOT = Path(__file__).resolve().parent

EXTRAS = {
    # Only the ros-jazzy-* wheels are named: they pin every other ROS wheel to Jazzy's version.
    'ros': [
        'ros-jazzy-rclpy[fastrtps]>=7.1.6,<7.2',
        'ros-jazzy-common-interfaces>=5.3.6,<5.4',
    ],
    'terrain': ['pyogrio>=0.12,<1', 'rasterio>=1.3.10,<2'],
    'plot': ['matplotlib>=3.8,<4', 'mcap-ros2-support>=0.5.5,<1', 'pillow>=10,<14'],
    'hindcast': ['scipy>=1.11,<2'],
    'completion': ['shtab>=1.7,<2'],
    'ensemble': ['dask>=2025.1,<2027', 'distributed>=2025.1,<2027', 'scipy>=1.11,<2'],
    'watch': [
        'bokeh>=3.4,<4',
        'matplotlib>=3.8,<4',
        'mcap-ros2-support>=0.5.5,<1',
        'tornado>=6.2,<7',
    ],
    'test': [
        'fastjsonschema>=2.19,<3',
        'hypothesis>=6.100,<7',
        'mcap-ros2-support>=0.5.5,<1',
        'pytest>=8,<10',
        'pytest-xdist>=3.6,<4',
        'rosbags>=0.10.4,<0.12',
        'scipy>=1.11,<2',
    ],
}
EXTRAS['all'] = sorted({requirement for extra in EXTRAS.values() for requirement in extra})
# NetCDF, which few need: it brings pandas.
EXTRAS['gis'] = ['scipy>=1.11,<2', 'xarray>=2024.1,<2027']
# Chromium and ffmpeg as wheels, for the tests of pages and films on machines that have neither:
# 900 MB, too much for everybody.
EXTRAS['look'] = ['PySide6-WebEngine>=6.12,<6.13', 'imageio-ffmpeg>=0.6,<1']


class WithData(Distribution):
    """Data files come with an editable install too: setuptools asks for them by another name."""

    def has_data(self) -> bool:
        """Say whether there are any."""
        return bool(self.has_data_files())


def files_in(folder: str) -> list[str]:
    """List the files of a folder, relative to this file's."""
    return sorted(f'{folder}/{path.name}' for path in (ROOT / folder).glob('*') if path.is_file())


setup(
    distclass=WithData,
    name=NAME,
    version='0.1.0',
    description='Lava flow simulation on the GPU as a ROS 2 node',
    long_description=(ROOT / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    author='lava_ros authors',
    maintainer='lava_ros maintainers',
    maintainer_email='maintainers@lava-ros.org',
    license='Apache-2.0',
    keywords=['ROS', 'lava', 'hazard', 'simulation', 'Warp'],
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={
        NAME: ['py.typed'],
        f'{NAME}.scene': ['materials.yaml', 'st_helens.npz'],
        f'{NAME}.pages.report': ['report.css', 'report.html', 'report.js'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'lib/{NAME}', files_in('libexec')),
        (f'share/{NAME}/launch', files_in('launch')),
        (f'share/{NAME}/msg_configs', files_in('msg_configs')),
        (f'share/{NAME}/params', files_in('params')),
        (f'share/{NAME}/rviz', files_in('rviz')),
        (f'share/{NAME}/foxglove', files_in('foxglove')),
        (f'share/{NAME}/examples', files_in('examples')),
        # What `lava report` says a preset errs and costs.
        (f'share/{NAME}/docs/accuracy', ['docs/accuracy/cpu.csv', 'docs/accuracy/h200.csv']),
        (f'share/{NAME}/docs/benchmarks', files_in('docs/benchmarks')),
        # For editors.
        (f'share/{NAME}/schemas', files_in('schemas')),
        (f'share/{NAME}/sros2', files_in('sros2')),
    ],
    zip_safe=False,
    python_requires='>=3.10',
    install_requires=[
        'mcap>=1.5,<2',
        'numpy>=1.26,<3',
        'pyyaml>=6,<7',
        'rich>=13.7,<16',
        'warp-lang>=1.19,<2',
        'zstandard>=0.22,<1',
        'lz4>=4,<5',
    ],
    extras_require=EXTRAS,
    entry_points={
        'console_scripts': [
            f'lava = {NAME}.cli.start:lava',
            f'lava_node = {NAME}.cli.start:lava_node',
        ],
    },
)
