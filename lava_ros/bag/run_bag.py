# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The bag in the folder of a run, so that readers of bags also read runs."""

import os
from pathlib import Path

from lava_ros.errors import LavaError, refusing
from lava_ros.files import open_input
from lava_ros.files.yaml import parse_json

#: Folder of the bag by the file that describes a run of version 0.1.0.
EARLIER = {'hindcast.json': 'bag', 'ensemble.json': 'atlas'}

#: File that identifies the folder of a run; its key ``maps`` names the folder of the bag.
RUN_FILE = 'run.json'


def bag_in(path: str | Path) -> Path:
    """Return the path of a bag: the bag of the maps if the path is the folder of a run.

    Raises:
        LavaError: If the file of a run is damaged.
    """
    path = Path(path)
    file = path / RUN_FILE
    if not os.path.isfile(file):
        names = [name for other, name in EARLIER.items() if os.path.isfile(path / other)]
        return path / names[0] if names else path
    expected = 'the folder of a run with an undamaged run.json'
    with refusing('bag', str(path), expected, OSError, KeyError, TypeError, ValueError):
        with open_input(file) as stream:
            name = parse_json(RUN_FILE, stream.read())['maps']
        # a name from a file must not lead out of the folder
        if not isinstance(name, str) or name == '..' or Path(name).name != name:
            raise LavaError(f'maps of {file}', name, 'the name of a folder')
        return path / name
