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

"""Where the package's data files are: msg_configs/, examples/, launch/."""

import os
from pathlib import Path
import sys

from lava_ros.errors import LavaError

PACKAGE = 'lava_ros'


def share_path(relative: str) -> Path:
    """Return the path of a data file or folder of this package.

    ``msg_configs/default.yaml``, for example, is looked for in the checkout the package runs from,
    then in each ament prefix (``AMENT_PREFIX_PATH``), then where pip puts data files
    (``sys.prefix``). A LavaError lists these places.
    """
    candidates = _candidates(relative)
    for candidate in candidates:
        if candidate.exists():
            return candidate
    right = f'a file of {PACKAGE}; looked for {_listed(candidates)}'
    raise LavaError('share path', relative, right)


def find_file(name: str | Path, folder: str, *, field: str, expected: str) -> Path:
    """Find a file by its path, or else by its name in a folder of this package.

    Args:
        name: The path, or the name.
        folder: The folder of this package, such as ``msg_configs``.
        field: What an error calls it.
        expected: What would be right, as an error says it.

    Raises:
        LavaError: There is no such file; lists where it was looked for.
    """
    path = Path(name)
    # a name alone: no path may lead out of the folder
    own = _candidates(f'{folder}/{name}') if path.name == str(name) else []
    for candidate in (path, *own):
        if os.path.lexists(candidate):
            return candidate
    places = _listed([path.absolute(), *own])
    raise LavaError(field, str(name), f'{expected}; looked for {places}')


def _candidates(relative: str) -> list[Path]:
    return [root / relative for root in _roots()]


def _listed(paths: list[Path]) -> str:
    return ', '.join(str(path) for path in paths)


def _roots() -> list[Path]:
    checkout = Path(__file__).resolve().parents[2]
    manifest = checkout / 'package.xml'
    is_checkout = manifest.is_file() and f'<name>{PACKAGE}</name>' in manifest.read_text('utf-8')
    ament = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    prefixes = [*(Path(item) for item in ament if item), Path(sys.prefix)]
    return [checkout] * is_checkout + [prefix / 'share' / PACKAGE for prefix in prefixes]
