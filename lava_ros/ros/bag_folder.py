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

"""Where bags may be written: what comes over the graph stays inside one folder."""

from itertools import chain, count
import os
from pathlib import Path
import time

from lava_ros.errors import LavaError

#: The node's name unless it is run under another.
DEFAULT_NODE = '/lava'


class BagFolder:
    """Turns names of bags into paths.

    The bag that the user names at the start may be anywhere. A name that is set while the node
    runs comes from whoever is in the graph: the bag has to lie inside the root, also after
    symbolic links and ``..`` are followed.
    """

    def __init__(self, root: str, given: str, *, node: str = DEFAULT_NODE) -> None:
        """Take what the user said at the start.

        Args:
            root: Folder of all bags; empty: the one that holds ``given``, else ``bags``.
            given: The bag named at the start, empty for none.
            node: Name of the node, with its namespace. Any but the usual one is part of a bag's
                name: several nodes may share a folder.
        """
        self._given = given
        self._suffix = '' if node == DEFAULT_NODE else node.replace('/', '_')
        self._root = Path(root) if root else Path(given).parent if given else Path('bags')

    def path(self, name: str) -> Path:
        """The bag of a name; one named by the time for an empty name.

        Raises:
            LavaError: It lies outside the root.
        """
        if not name:
            return self._unused(time.strftime('%Y-%m-%dT%H-%M-%S') + self._suffix)
        if name == self._given:
            return Path(name)
        try:
            root, path = self._root.resolve(), Path(name).resolve()
        except (OSError, RuntimeError, ValueError) as error:
            raise LavaError('bag_directory', name, f'a path ({error})') from error
        if root not in path.parents:
            raise LavaError('bag_directory', name, f'a new folder inside {root} (bag_root)')
        return Path(name)

    def _unused(self, name: str) -> Path:
        names = chain([name], (f'{name}_{number}' for number in count(2)))
        paths = map(self._root.joinpath, names)
        # Where nobody may look, there is nothing to be seen: opening the bag says why.
        return next(path for path in paths if not os.path.exists(path))
