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

"""Finished members on disk: whatever ends a run, the next one goes on from there."""

from collections.abc import Iterator
from dataclasses import asdict
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

import lava_ros
from lava_ros.errors import LavaError
from lava_ros.files import replacing, write_output
from lava_ros.files.npz import read_arrays
from lava_ros.forecast.members import Plan
from lava_ros.forecast.probability import Footprint
from lava_ros.forecast.sampling import Susceptibility
from lava_ros.scene import scene_to_dict

#: Version of the format of a folder.
VERSION = 2

#: What says whose members they are.
MANIFEST = 'ensemble.json'

_MEMBERS = 'members'

_KEYS = ('look', 'millimetres', 'corner', 'left')


class Store:
    """A folder with the members of one ensemble, a file each."""

    def __init__(
        self,
        folder: str | Path,
        plan: Plan,
        *,
        seed: int = 0,
        susceptibility: Susceptibility | None = None,
    ) -> None:
        """Create the folder of an ensemble, or reopen it.

        Raises:
            LavaError: The folder cannot be written, or holds another ensemble or other files.
        """
        self.folder = Path(folder)
        self._plan = plan
        manifest = _manifest(plan, seed, susceptibility)
        path = self.folder / MANIFEST
        try:
            if path.exists():
                _check_same(json.loads(path.read_text(encoding='utf-8')), manifest, path)
            elif self.folder.exists() and any(self.folder.iterdir()):
                right = 'a folder that is new, empty, or of this ensemble'
                raise LavaError('--output', str(folder), right)
            (self.folder / _MEMBERS).mkdir(parents=True, exist_ok=True)
            write_output('--output', path, json.dumps(manifest, indent=1) + '\n')
        except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
            raise LavaError(
                '--output', str(folder), f'a folder to write to ({error})'
            ) from error

    def write(self, footprint: Footprint) -> None:
        """Keep a member.

        Raises:
            LavaError: It cannot be written.
        """
        path = self._path(footprint.index)
        try:
            with replacing(path) as partial, partial.open('wb') as file:
                np.savez_compressed(
                    file,
                    look=footprint.look,
                    millimetres=footprint.millimetres,
                    corner=np.array(footprint.corner, dtype=np.int32),
                    left=np.array([footprint.left]),
                )
        except OSError as error:
            raise LavaError('--output', str(path), f'a file to write ({error})') from error

    def read(self, index: int) -> Footprint | None:
        """Read a member; None where it is missing or its file damaged."""
        try:
            stored = read_arrays('member', self._path(index))
            look, millimetres, corner, left = (stored[key] for key in _KEYS)
        except (LavaError, KeyError):
            return None
        is_whole = look.dtype == np.uint16 and millimetres.dtype == np.uint32
        is_whole &= look.shape == millimetres.shape and corner.shape == (2,) and left.shape == (1,)
        if not is_whole:
            return None
        place = int(corner[0]), int(corner[1])
        return Footprint(index, place, look, millimetres, float(left[0]))

    def finished(self, count: int) -> Iterator[Footprint]:
        """Read those of the first members that are there, in order."""
        for index in range(count):
            footprint = self.read(index)
            if footprint is not None:
                yield footprint

    def _path(self, index: int) -> Path:
        return self.folder / _MEMBERS / f'{index:07d}.npz'


def _manifest(plan: Plan, seed: int, susceptibility: Susceptibility | None) -> dict[str, Any]:
    elevation = np.ascontiguousarray(plan.scene.terrain.elevation)
    manifest = {
        'version': VERSION,
        'lava_ros': lava_ros.__version__,
        'scene': scene_to_dict(plan.scene),
        'elevation': hashlib.blake2b(elevation.tobytes(), digest_size=16).hexdigest(),
        'plan': {
            'horizon_s': plan.horizon,
            'accuracy': asdict(plan.accuracy),
            'effects': asdict(plan.effects),
            'threshold_m': plan.threshold,
            'looks': plan.looks,
            'start_s': None if plan.start is None else plan.start.time,
        },
        'seed': seed,
        'susceptibility': None if susceptibility is None else susceptibility.digest,
    }
    # as it will be read back
    return json.loads(json.dumps(manifest))


def _check_same(found: Any, wanted: dict[str, Any], path: Path) -> None:
    """Refuse a folder whose members are of another ensemble, and say in what."""
    for name, old, new in _differences(found, wanted, ''):
        right = f'{old!r}, of which {path.parent} has members; another folder takes others'
        raise LavaError(name, new, right)


def _differences(old: Any, new: Any, name: str) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(old, dict) and isinstance(new, dict):
        for key in {**old, **new}:
            inner = f'{name}.{key}' if name else key
            yield from _differences(old.get(key), new.get(key), inner)
    elif old != new:
        yield name, old, new
