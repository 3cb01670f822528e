# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The folder of a run with maps: ``run.json``, a bag, and the state of an interrupted run.

``run.json`` is written before the first map, and again at the end. Maps are flushed before the
checkpoint that includes them. A resumed run copies the maps up to its checkpoint into a new bag.
"""

from collections.abc import Mapping
from pathlib import Path
import shutil
from typing import Any

from lava_ros.bag.run_bag import bag_in, RUN_FILE
from lava_ros.errors import refusing
from lava_ros.runs.map_bag import RunBag, START_NS
from lava_ros.runs.store import numbered, RunStore
from lava_ros.scene import Scene
from lava_ros.simulation.output.checkpoint import Checkpoint

#: Folder of the bag of maps.
MAPS = 'maps'


class RunFolder(RunStore):
    """The folder of one run with maps.

    Attributes:
        bag: The bag of its maps.
    """

    def __init__(
        self, path: Path, scene: Scene, record: Mapping[str, Any], data: Mapping[str, str]
    ) -> None:
        """Create the folder, or resume the interrupted run in it.

        Args:
            path: The folder, as for ``RunStore``.
            scene: The scene of the run.
            record: Contents of ``run.json``, with ``identity``, ``program`` and ``begun``.
            data: Description of the bag in addition to its scene and the date of its begin.

        Raises:
            LavaError: As for ``RunStore``.
        """
        super().__init__(path, record)
        former = bag_in(path)
        with refusing('--output', str(path), 'a writable folder', OSError):
            maps = next(item for item in numbered(path / MAPS) if not item.exists())
            # a resumed run was begun by an earlier command
            self.bag = RunBag(maps, scene, {**data, 'begun': self.record['begun']})
            if self.checkpoint is None:
                self.bag.put_scene(scene, 0.0, START_NS)
            else:
                self.bag.copy(former, self.checkpoint.time)
            self.put({'maps': maps.name})
            if former != path and former.is_dir():
                # the new bag contains its maps up to the checkpoint
                shutil.rmtree(former)

    def keep(self, checkpoint: Checkpoint, **changes: Any) -> None:
        """Store the state, and the maps before it; arguments and errors as for ``RunStore``."""
        with refusing('--output', str(self.path), 'a writable folder', OSError):
            self.bag.flush()
        super().keep(checkpoint, **changes)

    def put(self, changes: Mapping[str, Any]) -> None:
        """Write ``run.json`` with some values changed, and with the topics of the bag."""
        node = {'node': self.bag.node.name, 'topics': self.bag.layer_topics}
        super().put({**changes, **node})

    def finish(self, changes: Mapping[str, Any]) -> None:
        """Close the bag, write ``run.json`` and remove the state; errors as for ``RunStore``."""
        self.close_bag()
        super().finish(changes)

    def close_bag(self) -> None:
        """Close the bag, which can then be read.

        Raises:
            LavaError: If it cannot be written.
        """
        with refusing('--output', str(self.path), 'a writable folder', OSError):
            self.bag.close()

    def discard(self) -> None:
        """Remove the files of a new run that could not start; keep the files of a resumed run.

        Raises:
            LavaError: If they cannot be removed.
        """
        self.close()
        if self.checkpoint is None:
            with refusing('--output', str(self.path), 'a writable folder', OSError):
                shutil.rmtree(self.bag.directory)
                (self.path / RUN_FILE).unlink()
                self.path.rmdir()

    def close(self) -> None:
        """Close the bag, and release the folder for other runs.

        Raises:
            LavaError: If the bag cannot be written.
        """
        super().close()
        if hasattr(self, 'bag'):
            self.close_bag()
