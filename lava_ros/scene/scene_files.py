# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scene files: YAML, and the tables, rasters and outlines that it names."""

from collections.abc import Mapping
from dataclasses import replace
import logging
from pathlib import Path
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files.resources import find_file
from lava_ros.files.yaml import read_yaml
from lava_ros.scene.effusion_rates import (
    check_start,
    error_of_rates,
    Interval,
    Options,
    RATE_KEYS,
    read_effusion_rates,
    series_of_rates,
)
from lava_ros.scene.emplaced import read_flows
from lava_ros.scene.events import read_events
from lava_ros.scene.file_keys import SCENE_KEYS
from lava_ros.scene.materials import with_material_in_lava
from lava_ros.scene.scene import date_text, onset_from
from lava_ros.scene.terrain import Terrain
from lava_ros.scene.terrain_files import load_terrain, TERRAIN_KEYS, terrain_path

_LOG = logging.getLogger(__name__)


def read_scene(
    path: str | Path, *, terrain: Terrain | None = None, options: Mapping[str, Any] | None = None
) -> tuple[dict[str, Any], Terrain]:
    """Read a scene file, and return the arguments of ``scene_from_dict``.

    The file has the keys of ``scene_from_dict`` and ``terrain``, a mapping: ``file``, relative to
    the scene file or ``st_helens.npz`` of the package, and the options of
    ``terrain_files.load_terrain``. The ``effusion_rate`` of a vent may be a mapping: ``file``, a
    table relative to the scene file, and the fields of ``effusion_rates.Options``. The errors in
    such tables are the uncertainty of the effusion rate unless the file has one. The date of their
    time 0 is the ``onset`` of the scene.

    Args:
        path: Path of the file, or its name in the package's ``examples/``.
        terrain: Terrain that replaces that of the file. It gets the ``offset`` in the file, so
            that positions in the map frame remain; without one a warning states that they do not.
        options: Options of ``load_terrain`` that replace those of the file.

    Returns:
        Plain data with the contents of all files, and the terrain raised by flows that are ground.

    Raises:
        LavaError: If the file cannot be read or has unknown keys, or a value cannot be used.
    """
    name, path = path, find_file(path, 'examples', field='scene', expected='a readable YAML file')
    if path != Path(name):
        _LOG.info(f'{name}: no such file here, so that of the package, {path}')
    content = read_yaml('scene', path)
    if content is None:
        expected = f'a mapping with keys {", ".join(SCENE_KEYS.keys)}; the file is empty'
        raise LavaError('scene', str(path), expected)
    data = with_material_in_lava('scene', SCENE_KEYS.names('scene', content))
    ground = data.pop('terrain', None)
    insist = validation.flag('scene.insist', data.get('insist', False))
    if terrain is None:
        known = TERRAIN_KEYS.names('scene.terrain', ground)
        name = validation.text('scene.terrain.file', known.pop('file'), 'the name of a file')
        options = {'insist': insist} | known | dict(options or {})
        terrain = load_terrain(terrain_path(name, path.parent), **options)
    elif isinstance(ground, Mapping) and 'offset' in ground:
        # positions remain those of the map frame of the scene
        offset = validation.pair('scene.terrain.offset', ground['offset'])
        corner = terrain.corner
        origin = (corner[0] - offset[0], corner[1] - offset[1])
        terrain = replace(terrain, origin=origin, offset=offset)
    elif isinstance(vents := data.get('vents'), list) and any(
        isinstance(vent, Mapping) and 'position' in vent for vent in vents
    ):
        _LOG.warning(
            f'{path}: positions of vents are now counted from the lower-left corner of '
            f'{terrain.source}; projected places do not depend on the terrain'
        )
    if isinstance(ground, Mapping) and 'sea_level' in ground and terrain.sea_level is None:
        terrain = replace(terrain, sea_level=ground['sea_level'])
    data, terrain = _with_changes(data, path.parent, terrain, options or {})
    return _with_rates(data, path.parent), terrain


def _with_changes(
    data: dict[str, Any], folder: Path, terrain: Terrain, options: Mapping[str, Any]
) -> tuple[dict[str, Any], Terrain]:
    """Replace emplaced flows and events by the contents of their files, and raise the terrain."""
    if 'emplaced_flows' in data:
        terrain, data['emplaced_flows'] = read_flows(
            'scene.emplaced_flows', data['emplaced_flows'], folder, terrain
        )
    if 'events' in data:
        data['events'] = read_events('scene.events', data['events'], folder, terrain, options)
    return data, terrain


def _with_rates(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Replace the names of effusion-rate tables by their series, and add error and onset.

    Raises:
        LavaError: If a table cannot be read, or its time 0 is not that of the scene.
    """
    vents, onset, source = data.get('vents'), onset_from('scene', data), 'scene.onset'
    read: list[Interval] = []
    measured: str | None = None
    if not isinstance(vents, list):
        return data
    vents = list(vents)
    for index, vent in enumerate(vents):
        rate = vent.get('effusion_rate') if isinstance(vent, Mapping) else None
        if not isinstance(rate, Mapping):
            continue
        label = f'vents[{index}].effusion_rate'
        name = validation.text(f'{label}.file', rate.get('file'), 'the name of a table')
        rest = {key: value for key, value in rate.items() if key != 'file'}
        options = validation.build(Options, label, RATE_KEYS.names(label, rest))
        if options.start is None and onset is not None:
            options = replace(options, start=date_text(onset))
        rates, origin = read_effusion_rates(label, folder / name, options)
        if origin is not None and onset not in (None, origin):
            assert onset is not None
            expected = f'{date_text(onset)}, the time 0 of {source}'
            raise LavaError(f'{label}.start', date_text(origin), expected)
        if onset is None:
            onset, source = origin, label
        check_start(label, rates)
        read += rates
        measured = measured or options.measured
        vents[index] = {**vent, 'effusion_rate': series_of_rates(rates)}
    error = error_of_rates(read, measured)
    dated = {} if onset is None else {'onset': date_text(onset)}
    return {**data, 'vents': vents, 'rate_error': error, **dated}
