# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
