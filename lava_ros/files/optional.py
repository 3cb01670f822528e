# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Optional packages and the extras that install them."""

from importlib import import_module

from lava_ros.errors import RefusalError

#: Extra that installs a package.
_EXTRAS = {
    'viser': 'watch',
    'distributed': 'ensemble',
    'jinja2': 'plot',
    'matplotlib': 'plot',
    'mcap_ros2': 'plot',
    'pyogrio': 'terrain',
    'rasterio': 'terrain',
    'scipy': 'hindcast',
}


def is_installed(package: str) -> bool:
    """Return True if a package can be imported."""
    try:
        import_module(package)
    except ImportError:
        return False
    return True


def installation(extra: str) -> str:
    """Return the command that installs an extra from the source: lava_ros is in no registry."""
    return f"pip install '.[{extra}]' in the folder of the source"


def require(package: str, field: str, value: object = None) -> None:
    """Raise LavaError with the command for installation if a package is missing."""
    if not is_installed(package):
        name = package.partition('.')[0]
        what = field if value is None else f'{field} ({value})'
        remedy = f'Run {installation(_EXTRAS[name])}'
        raise RefusalError(field, f'{what} needs {name}, which is not installed', remedy)
