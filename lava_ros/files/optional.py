# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Packages that not every installation has: which extra of this one brings them."""

from importlib import import_module

from lava_ros.errors import LavaError

#: The extra that brings a package.
_EXTRAS = {
    'bokeh': 'watch',
    'distributed': 'ensemble',
    'matplotlib': 'plot',
    'mcap_ros2': 'plot',
    'pyogrio': 'terrain',
    'rasterio': 'terrain',
    'scipy': 'hindcast',
    'shtab': 'completion',
    'xarray': 'gis',
}


def is_installed(package: str) -> bool:
    """Whether a package can be imported."""
    try:
        import_module(package)
    except ImportError:
        return False
    return True


def require(package: str, field: str, value: object = None) -> None:
    """Raise LavaError, which says how to install it, for a package that is missing."""
    if not is_installed(package):
        name = package.partition('.')[0]
        right = f"an installation with {name}: pip install 'lava_ros[{_EXTRAS[name]}]'"
        raise LavaError(f'{name} for {field}' if value is None else field, value, right)
