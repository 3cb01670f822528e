# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Packages that only some tasks need."""

from importlib import import_module

from lava_ros.errors import RefusalError

#: Command that installs ROS 2 without apt: the package itself is in no registry.
INSTALL_ROS = "pip install '.[ros]' in the folder of the source"


def is_installed(package: str) -> bool:
    """Return True if a package can be imported."""
    try:
        import_module(package)
    except ImportError:
        return False
    return True


def require(package: str, field: str, value: object = None) -> None:
    """Raise LavaError with the command for installation if a package is missing."""
    if not is_installed(package):
        what = field if value is None else f'{field} ({value})'
        problem = f'{what} needs {package}, which is not installed'
        raise RefusalError(field, problem, f'Run pip install {package}')
