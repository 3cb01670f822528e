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

from pathlib import Path
import time

from lava_ros.errors import LavaError


class BagFolder:
    """Turns names of bags into paths.

    The bag that the user names at the start may be anywhere. A name that is set while the node
    runs comes from whoever is in the graph: the bag has to lie inside the root, also after
    symbolic links and ``..`` are followed.
    """

    def __init__(self, root: str, given: str) -> None:
        """Take what the user said at the start.

        Args:
            root: Folder of all bags; empty: the one that holds ``given``, else ``bags``.
            given: The bag named at the start, empty for none.
        """
        self._given = given
        self._root = Path(root) if root else Path(given).parent if given else Path('bags')

    def path(self, name: str) -> Path:
        """The bag of a name; one named by the time for an empty name.

        Raises:
            LavaError: It lies outside the root.
        """
        if not name:
            return self._root / time.strftime('%Y-%m-%dT%H-%M-%S')
        if name == self._given:
            return Path(name)
        try:
            root, path = self._root.resolve(), Path(name).resolve()
        except (OSError, RuntimeError, ValueError) as error:
            raise LavaError('bag_directory', name, f'a path ({error})') from error
        if root not in path.parents:
            raise LavaError('bag_directory', name, f'a new folder inside {root} (bag_root)')
        return Path(name)
