# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Changes of the ground during an eruption: a new elevation, or barriers."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files.keys import Check, either, FILE_NAME, Key, Keys
from lava_ros.scene.projection import system_name
from lava_ros.scene.reshaping import Barrier, BARRIER_KEYS, read_barriers, with_barriers
from lava_ros.scene.terrain import Terrain
from lava_ros.scene.terrain_files import load_terrain

#: Keys of a change in an event; an event in a file has one of them.
CHANGES = ('terrain', 'barrier', 'barriers')


def event_keys(time: Check) -> Keys:
    """Return the keys of an event in a file, with a check of its time."""
    return Keys({
        'time': Key(time, 'Time of the change [s]', True),
        'terrain': Key(FILE_NAME, 'File of the new elevation; relative to this file'),
        'barrier': Key(BARRIER_KEYS.as_schema(), 'A barrier that is built'),
        'barriers': Key(FILE_NAME, 'Vector file of lines with height and width [m]'),
    }, (either(*CHANGES),))


#: Keys of an event of a scene, and of a case, whose clock may begin before the simulation.
SCENE_EVENT_KEYS = event_keys(partial(validation.number, at_least=0.0, unit='s'))
CASE_EVENT_KEYS = event_keys(partial(validation.number, unit='s'))


@dataclass(frozen=True, eq=False)
class TerrainEvent:
    """A change of the ground.

    Attributes:
        time: Simulated time of the change [s].
        text: Short description.
        terrain: New terrain; None: only the barriers change the ground.
        barriers: Barriers built on the terrain.
    """

    time: float
    text: str
    terrain: Terrain | None = None
    barriers: tuple[Barrier, ...] = ()

    def ground(self, before: Terrain, *, is_told: bool = False) -> Terrain:
        """Return the ground after the event, with warnings of widened crests if ``is_told``."""
        return with_barriers(self.terrain or before, self.barriers, is_told=is_told)


def event_to_dict(event: TerrainEvent) -> dict[str, Any]:
    """Return plain data that describes an event without its elevation, for logs and bags."""
    plain: dict[str, Any] = {'time': event.time, 'text': event.text}
    if event.barriers:
        plain['barriers'] = [
            asdict(item) | {'line': [list(place) for place in item.line]}
            for item in event.barriers
        ]
    if event.terrain is not None:
        digest = hashlib.blake2b(event.terrain.elevation.tobytes(), digest_size=16)
        plain |= {'source': event.terrain.source, 'digest': digest.hexdigest()}
    return plain


def read_events(
    label: str, items: object, folder: Path, ground: Terrain, options: Mapping[str, Any]
) -> list[TerrainEvent]:
    """Read the changes of the ground of a scene or a case.

    Args:
        label: Name of the events in errors.
        items: List of mappings with ``time`` [s] and one of ``CHANGES``: ``terrain``, a file of
            the new elevation, ``barrier``, the fields of a ``Barrier``, or ``barriers``, a vector
            file of lines with ``height``, ``width`` and optionally ``slope``.
        folder: Folder to which file names are relative.
        ground: Terrain before the events.
        options: Options of ``load_terrain`` for a new elevation; its offset is that of ``ground``.

    Raises:
        LavaError: If a value or a file cannot be used, times do not increase, or an elevation is
            not on the grid of the ground.
    """
    events: list[TerrainEvent] = []
    for where, item in validation.items(label, items, 'a list of changes of the ground'):
        data = CASE_EVENT_KEYS(where, item)
        time = data.pop('time')
        if events and time <= events[-1].time:
            expected = f'a time after the event before, {events[-1].time:g} s'
            raise LavaError(f'{where}.time', time, expected)
        if len(data) != 1:
            raise LavaError(where, sorted(data), f'one of {", ".join(CHANGES)}')
        (kind, change), = data.items()
        if kind == 'barrier':
            barrier = Barrier.from_dict(f'{where}.barrier', change)
            text = f'a barrier {barrier.height:g} m high'
            event = TerrainEvent(time, text, barriers=(barrier,))
        else:
            path = folder / change
            if kind == 'barriers':
                built = tuple(read_barriers(f'{where}.barriers', path, ground))
                event = TerrainEvent(time, f'{len(built)} barriers from {change}', barriers=built)
            else:
                terrain = load_terrain(path, **{**options, 'offset': ground.offset})
                if not terrain.has_system:
                    # a raster without a system is in that of the terrain
                    terrain = replace(terrain, epsg=ground.epsg, wkt=ground.wkt)
                check_same_grid(f'{where}.terrain', terrain, ground)
                event = TerrainEvent(time, f'new ground from {change}', terrain)
        # a barrier that touches no cell
        try:
            ground = event.ground(ground, is_told=True)
        except LavaError as error:
            raise error.named(f'{where}.{error.field}') from None
        events.append(event)
    return events


def check_same_grid(field: str, terrain: Terrain, ground: Terrain) -> None:
    """Raise LavaError, which names ``field``, for a terrain on a grid other than the ground's."""
    place, other = ((*one.extent, *one.offset) for one in (terrain, ground))
    is_near = np.allclose(place, other, rtol=0.0, atol=1e-3 * ground.resolution)
    systems = terrain.georeference.system, ground.georeference.system
    if is_near and terrain.shape == ground.shape and systems[0] == systems[1]:
        return
    shown, expected = (
        '{} x {} cells of {:.9g} m from easting {:.9g}, northing {:.9g}'.format(
            *one.shape, one.resolution, *one.corner
        )
        for one in (terrain, ground)
    )
    x, y = ground.offset
    west, south, east, north = ground.extent
    cell = ground.resolution
    options = f'-tr {cell:g} {cell:g} -te {west + x:.10g} {south + y:.10g} '
    options += f'{east + x:.10g} {north + y:.10g}'
    if systems[0] != systems[1]:
        options = f'-t_srs EPSG:{ground.epsg} {options}' if ground.epsg else options
        shown += f', {system_name(terrain.epsg, terrain.wkt)}'
        expected += f', {system_name(ground.epsg, ground.wkt)}'
    expected = f'the grid of the previous ground: {expected} (gdalwarp {options})'
    raise LavaError(field, shown, expected)
