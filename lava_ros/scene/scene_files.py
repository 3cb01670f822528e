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

"""Scenes from files and from plain data."""

from collections.abc import Mapping
import logging
from pathlib import Path
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files.yaml import read_yaml
from lava_ros.scene.materials import lava_from_dict
from lava_ros.scene.scene import ENVIRONMENT, Scene, temperature_doubts
from lava_ros.scene.terrain import Terrain
from lava_ros.scene.terrain_files import DEMO, load_terrain
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.scene.vents import vents_from_list

_LOG = logging.getLogger(__name__)

#: Keys of a scene beside its ground.
SCENE_KEYS = ('vents', 'lava', 'uncertainty', *ENVIRONMENT)


def scene_from_yaml(path: str | Path, *, terrain: Terrain | None = None) -> Scene:
    """Read a scene file; ``terrain`` replaces the file's own.

    Raises:
        LavaError: The file cannot be read, or one of its fields is not usable.
    """
    return scene_from_dict(*read_scene(path, terrain=terrain))


def read_scene(
    path: str | Path, *, terrain: Terrain | None = None, fill_holes: bool = False
) -> tuple[dict[str, Any], Terrain]:
    """Read a scene file without making a scene of it.

    The file has the keys of ``scene_from_dict`` and ``terrain``, a mapping: ``file``, relative to
    the scene file or ``st_helens.npz`` of the package, and the options of
    ``terrain_files.load_terrain``.

    Args:
        path: The YAML file.
        terrain: Ground to use in place of the file's own.
        fill_holes: Fill the holes of the file's own ground, whatever the file says.

    Returns:
        What ``scene_from_dict`` takes.

    Raises:
        LavaError: The file cannot be read, or has other keys, or its ground is not usable.
    """
    path = Path(path)
    data = validation.keys('scene', read_yaml('scene', path), allowed=['terrain', *SCENE_KEYS])
    ground = data.pop('terrain', None)
    if terrain is None:
        options: dict[str, Any] = validation.keys(
            'scene.terrain',
            ground,
            allowed=['file', 'epsg', 'resolution', 'offset', 'window', 'fill_holes'],
            required=['file'],
        )
        name = options.pop('file')
        if not isinstance(name, str):
            raise LavaError('scene.terrain.file', name, 'the name of a file, text')
        if fill_holes:
            options['fill_holes'] = True
        is_demo = name == DEMO.name and not (path.parent / name).exists()
        terrain = load_terrain(DEMO if is_demo else path.parent / name, **options)
    return data, terrain


def scene_from_dict(data: Mapping[str, Any], terrain: Terrain) -> Scene:
    """Build a scene from the plain data of a YAML file.

    Args:
        data: ``vents``, ``lava`` (fields of ``Lava``, and maybe ``material``, a name of ``lava
            materials`` whose constants they replace; ``materials.DEFAULT`` where it is absent),
            ``ambient_temperature``, ``gravity`` and ``uncertainty``; all may be left out.
        terrain: The ground.

    Raises:
        LavaError: A field is not usable.
    """
    lava, material = lava_from_dict('scene.lava', data.get('lava', {}))
    scene = Scene(
        terrain=terrain,
        vents=vents_from_list(
            data.get('vents', []), terrain, temperature=material.vent_temperature.value
        ),
        lava=lava,
        uncertainty=uncertainty_from_dict(data.get('uncertainty', {})),
        **{name: data[name] for name in ENVIRONMENT if name in data},
    )
    warn_of_celsius(scene)
    return scene


def warn_of_celsius(scene: Scene) -> None:
    """Warn of temperatures that were given in kelvin and make more sense in Celsius."""
    for text in temperature_doubts(scene):
        _LOG.warning(text)
