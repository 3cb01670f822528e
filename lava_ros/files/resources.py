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

"""Where the package's data files are: msg_configs/, launch/."""

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
    candidates = [root / relative for root in _roots()]
    for candidate in candidates:
        if candidate.exists():
            return candidate
    tried = ', '.join(str(candidate) for candidate in candidates)
    raise LavaError('share path', relative, f'a file of {PACKAGE}; looked for {tried}')


def find_file(name: str, folder: str) -> Path:
    """A file by its path, or else by its name in a folder of this package; LavaError if none."""
    path = Path(name)
    return path if path.is_file() else share_path(f'{folder}/{name}')


def _roots() -> list[Path]:
    checkout = Path(__file__).resolve().parents[2]
    manifest = checkout / 'package.xml'
    is_checkout = manifest.is_file() and f'<name>{PACKAGE}</name>' in manifest.read_text('utf-8')
    ament = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    prefixes = [*(Path(item) for item in ament if item), Path(sys.prefix)]
    return [checkout] * is_checkout + [prefix / 'share' / PACKAGE for prefix in prefixes]
