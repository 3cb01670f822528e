# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Data files that ROS expects below share/ and lib/, which pyproject.toml cannot list.

colcon requires this file.
"""

from pathlib import Path

from setuptools import Distribution, setup
from setuptools.config.pyprojecttoml import apply_configuration

NAME = 'lava_ros'

# colcon runs a link to this file in another folder.
ROOT = Path(__file__).resolve().parent


class LavaDistribution(Distribution):
    """Distribution that colcon can read, and that installs data files in every mode."""

    def parse_config_files(self, *args: object, **options: object) -> None:
        """Read the metadata in the folder of this file, also if colcon runs a link to it.

        colcon evaluates the attributes of the distribution and of its metadata as Python literals.
        """
        super().parse_config_files(*args, **options)
        if not Path('pyproject.toml').exists():
            apply_configuration(self, ROOT / 'pyproject.toml')
        for item in (self, self.metadata):
            item.python_requires = str(self.python_requires)

    def has_data(self) -> bool:
        """Return True if there are data files; editable installs call this method."""
        return bool(self.has_data_files())


def files_in(folder: str) -> list[str]:
    """List the files of a folder, relative to the folder of this file."""
    return sorted(f'{folder}/{path.name}' for path in (ROOT / folder).glob('*') if path.is_file())


setup(
    distclass=LavaDistribution,
    # A path, not a finder: in the folder that holds a clone called lava_ros the clone itself would
    # be found first. In pyproject.toml this option would make setuptools print a warning.
    options={'editable_wheel': {'mode': 'compat'}},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'lib/{NAME}', files_in('libexec')),
        # The costs that `lava effects` prints.
        (f'share/{NAME}/docs/benchmarks', ['docs/benchmarks/effects_h200.csv']),
        *(
            (f'share/{NAME}/{folder}', files_in(folder))
            for folder in (
                'examples', 'foxglove', 'launch', 'msg_configs', 'params', 'rviz', 'schemas',
            )
        ),
    ],
)
