# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Export of the maps of a bag as GeoTIFF and other GIS files."""

from collections.abc import Collection, Mapping
from dataclasses import fields
import logging
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lava_ros import validation
from lava_ros.bag.description import described, effects_on
from lava_ros.errors import LavaError, RefusalError, refusing
from lava_ros.files.optional import require
from lava_ros.files.vectors import WRITTEN
from lava_ros.layers.arrival import Arrival, check_threshold, rounding, THICKNESS
from lava_ros.layers.frame import Frame, LayerFrame
from lava_ros.layers.layer import SOURCES
from lava_ros.layers.numbers import duration
from lava_ros.layers.recording import Progress, Recording, silent
from lava_ros.products import gis
from lava_ros.products.plot import time_note
from lava_ros.scene import Georeference, Terrain, Vent
from lava_ros.scene.onset import Onset, recorded_onset
from lava_ros.scene.projection import coordinate_system, system_name
from lava_ros.scene.terrain import check_epsg
from lava_ros.simulation.output.inundation import raise_peak, reached_cells

_LOG = logging.getLogger(__name__)

#: Maps for export: maps of a frame, and maps accumulated over all frames up to it.
MAPS = (*SOURCES, 'arrival', 'inundated', 'peak_thickness')

#: File formats: GeoTIFF with QGIS styles, vector files of outline and isochrones, and NetCDF.
FORMATS = ('tif', *WRITTEN, 'nc')


class Exported(NamedTuple):
    """The written files, and the georeference of the files of the last frame."""

    files: tuple[Path, ...]
    georeference: Georeference


def export_bag(
    path: str | Path,
    directory: str | Path,
    *,
    node: str | None = None,
    maps: Collection[str] = MAPS,
    formats: Collection[str] = ('tif',),
    time: float | None = None,
    every: bool = False,
    threshold: float | None = None,
    epsg: int | None = None,
    offset: tuple[float, float] | None = None,
    progress: Progress = silent,
) -> Exported:
    """Write maps of a bag as GeoTIFF, north up, and in other formats.

    Maps without a layer in the bag are left out.

    Args:
        path: The bag.
        directory: Folder of the files, which is created if it does not exist. It must be empty.
        node: Full name or namespace of the node whose maps to write; None for the only one.
        maps: Maps to write, of ``MAPS``.
        formats: File formats, of ``FORMATS``. Only GeoTIFF can contain several frames.
        time: Simulated time [s] of the newest frame to read; None for the end of the bag.
        every: True to write thickness, temperature and hazard of each frame up to the time.
        threshold: Lava has arrived where its thickness is at or above this value [m]; None for
            the threshold of the simulation. With another one, arrival times and the outline are
            those of the maps in the bag, and ``inundated`` is left out.
        epsg: EPSG code that replaces the coordinate system of the bag.
        offset: Easting and northing [m] of the map frame's origin, for a bag without a coordinate
            system, or together with ``epsg``.
        progress: Called with the activity and its completed fraction.

    Raises:
        LavaError: If the bag cannot be read, an argument is not valid or contradicts the bag, or a
            file cannot be written.
    """
    for name in maps:
        validation.choice('maps', name, MAPS)
    for name in formats:
        validation.choice('formats', name, FORMATS)
    if every and 'tif' not in formats:
        problem = 'Only GeoTIFF files can contain every frame'
        raise RefusalError('formats', problem, 'Add tif to the formats')
    if threshold is not None:
        threshold = validation.number('threshold', threshold, above=0.0, unit='m')
    require('rasterio', 'GeoTIFF', str(directory))
    target = Path(directory)
    recording = Recording(path, node=node)
    own = recording.inundation_threshold
    threshold = own if threshold is None else threshold
    known: dict[str, Georeference] = {}

    def georeference_in(scene: Mapping[str, Any]) -> Georeference:
        # a replaced coordinate system gives a warning; all frames have the same scene
        stated = repr([scene.get('terrain', {}).get(name) for name in Georeference._fields])
        if stated not in known:
            known[stated] = georeference_of(scene, epsg=epsg, offset=offset)
        return known[stated]

    end = georeference_in(recording.scene)
    asked, time = time, recording.shown_time(time)
    wants_history = threshold != own or bool({'arrival', 'peak_thickness'} & set(maps))
    thickness = [item for item in recording.layers.values() if item.source == THICKNESS]
    if wants_history and thickness:
        check_threshold(threshold, min(thickness, key=lambda layer: layer.threshold))
    gis.require_formats(formats, target, coordinate_system(end.epsg, end.wkt))
    with refusing('output', str(target), 'a writable folder', OSError):
        target.mkdir(parents=True, exist_ok=True)
        if any(target.iterdir()):
            raise LavaError('output', str(target), 'a folder that is new or empty')
    origin = provenance_of(recording)
    written: list[Path] = []
    newest: dict[str, gis.Made] = {}

    def write(name: str, frame: Frame, made: gis.Made, file_name: str) -> None:
        newest[name] = values, tags = made[0], {'bag': Path(path).name, **made[1]}
        if 'tif' in formats:
            terrain = _terrain_of(frame, georeference_in(frame.scene))
            files = gis.write_grid(target / file_name, name, values, terrain, origin, tags)
            # the style file is not listed
            written.append(files[0])

    def write_layers(frame: Frame, suffix: str = '') -> None:
        for name in SOURCES:
            if name in maps and name in frame.layers:
                write(name, frame, _layer_map(name, frame, origin.onset), f'{name}{suffix}.tif')

    history = Arrival(threshold)
    last: Frame | None = None
    for index, frame in enumerate(recording.frames()):
        if time is not None and frame.time is not None and frame.time > time:
            break
        progress('maps', recording.progress_at(frame))
        if wants_history:
            history.add(frame)
        last = frame
        if every:
            seconds = 'unknown' if frame.time is None else f'{frame.time:.0f}'
            write_layers(frame, f'_{index:04d}_{seconds}s')
    if last is None:
        target.rmdir()
        raise recording.missing_error(asked, 'terrain and a map')
    if note := time_note(None if every else asked, last):
        _LOG.warning(note)
    observed = {'peak_thickness'} if history.is_noted else {'arrival', 'peak_thickness'}
    if history.begins_late and (incomplete := sorted(observed & set(maps))):
        _LOG.warning(
            f'the maps begin at {duration(history.first_time)}: lava before that is not in '
            f'{" and ".join(incomplete)}'
        )
    if not every:
        write_layers(last)
    for name in ('arrival', 'inundated', 'peak_thickness'):
        if name not in maps:
            continue
        if name == 'inundated' and last.inundated is not None and threshold != own:
            _LOG.warning(
                f'inundated is left out: the bag has it for lava of {own:g} m or more, not of '
                f'{threshold:g} m'
            )
        elif name == 'inundated' and last.inundated is not None:
            made = last.inundated, _inundated_tags(last, origin.onset)
            write(name, last, made, f'{name}.tif')
        elif name != 'inundated' and history.frame is not None:
            write(name, history.frame, _history_map(name, history), f'{name}.tif')
    end = georeference_in(last.scene)
    if newest:
        terrain = _terrain_of(last, end)
        layers = _shapes(last, history, newest, terrain, origin.onset)
        layers |= gis.vents(_vents(recording.scene), end.offset)
        title = f'lava flow of {Path(path).name}'
        written += gis.write_formats(
            target, formats, layers, newest, terrain, title, origin
        )
    if not written:
        have = sorted({layer.source for layer in recording.layers.values()})
        raise LavaError('maps', ', '.join(maps), f'maps of layers in the bag: {", ".join(have)}')
    return Exported(tuple(written), end)


def georeference_of(
    scene: Mapping[str, Any],
    *,
    epsg: int | None = None,
    offset: tuple[float, float] | None = None,
) -> Georeference:
    """Return the georeference of a bag from its scene.

    ``epsg``, and ``offset`` [m] together with it, replace the values of the scene.

    Raises:
        LavaError: If ``offset`` alone contradicts the scene, or the scene is not valid.
    """
    terrain = scene.get('terrain', {})
    known, wkt = terrain.get('epsg'), terrain.get('wkt')
    check_epsg("the bag's terrain.epsg", known)
    own = validation.pair("the bag's terrain.offset", terrain.get('offset', (0.0, 0.0)))
    if wkt is not None and not isinstance(wkt, str):
        raise LavaError("the bag's terrain.wkt", wkt, 'the definition of a coordinate system')
    stated = Georeference(known, own, wkt)
    if epsg in (None, known) and stated.system:
        if offset is not None and offset != own:
            raise LavaError('offset', offset, f'{own}, as the bag states')
        return stated
    if stated.system:
        # an unknown code is refused without a warning
        coordinate_system(epsg)
        _LOG.warning(f'EPSG:{epsg} as given, although the bag states {system_name(known, wkt)}')
    return Georeference(epsg, own if offset is None else offset)


def _vents(scene: Mapping[str, Any]) -> list[Vent]:
    """Return the vents of a scene; none, with a warning, if they are not valid."""
    names = {item.name for item in fields(Vent)}
    items = scene.get('vents', [])
    try:
        return [
            Vent(**{name: value for name, value in item.items() if name in names})
            for item in items
        ]
    except (AttributeError, TypeError, LavaError) as error:
        _LOG.warning(f'the vents of the bag are left out: {error}')
        return []


def provenance_of(recording: Recording) -> gis.Provenance:
    """Return the origin of the maps of a bag."""
    data = recording.bag.custom_data
    description = described(data)
    parameters = description['parameters'] or {}
    scene = data.get('case') or parameters.get('scene') or recording.bag.path.resolve().name
    return gis.Provenance(
        scene=str(scene),
        effects=effects_on(description),
        preset=str(parameters.get('preset') or 'unknown'),
        version=data.get('version') or 'unknown',
        onset=recorded_onset(data),
    )


def _terrain_of(frame: Frame, georeference: Georeference) -> Terrain:
    return Terrain(
        frame.elevation, frame.resolution, frame.origin, **georeference._asdict()
    )


def _layer_map(name: str, frame: Frame, onset: Onset | None) -> gis.Made:
    """Return the values of a layer of a frame, and tags."""
    shown = frame.layers[name]
    values = shown.values
    if name == 'hazard':
        # 0 is the value of cells without lava
        values = np.nan_to_num(np.clip(np.rint(values), 1, 100))
    values = np.where(np.isfinite(frame.elevation), values, np.float32(np.nan))
    return values, _layer_tags(shown) | gis.time_tags(frame.time, onset)


def _inundated_tags(frame: Frame, onset: Onset | None) -> dict[str, str]:
    """Return tags of the inundated fractions of a frame."""
    assert frame.inundated is not None
    return {
        'inundation_threshold_m': repr(frame.threshold),
        'inundated_area_m2': repr(frame.area(frame.inundated)),
        **gis.time_tags(frame.time, onset),
    }


def _history_map(name: str, history: Arrival) -> gis.Made:
    """Return the arrival times or the peak thickness, and tags."""
    frame = history.frame
    assert frame is not None and history.times is not None and history.peak is not None
    tags = _layer_tags(frame.layers[THICKNESS]) | {'maps': str(history.frame_count)}
    if frame.time is not None:
        tags |= {'maps_from_s': repr(history.first_time), 'maps_up_to_s': repr(frame.time)}
    if name == 'peak_thickness':
        tags['saturated'] = 'yes' if history.is_saturated else 'no'
        is_noted = history.is_noted
        least = history.threshold
        return raise_peak(history.peak, history.times, least) if is_noted else history.peak, tags
    tags['inundation_threshold_m'] = repr(history.threshold)
    if history.is_noted:
        tags['note'] = 'times are exact to a time step of the simulation'
    else:
        tags['longest_time_between_maps_s'] = repr(history.longest_gap)
        tags['note'] = 'lava may have arrived earlier, by at most the time between two maps'
    return history.times.astype(np.float32), tags


def _shapes(
    frame: Frame, history: Arrival, newest: Mapping[str, gis.Made], terrain: Terrain,
    onset: Onset | None,
) -> dict[str, list[dict[str, Any]]]:
    """Return the outline and the isochrones as layers of features.

    The outline surrounds the footprint so far, and states the inundated area; the cells that lava
    has reached in the maps for another threshold; or standing lava if the bag has no thickness.
    """
    cells, name, threshold = frame.footprint, 'inundated area', frame.threshold
    known: dict[str, float] = {}
    if history.times is not None and (cells is None or history.threshold != threshold):
        cells, threshold = reached_cells(history.times), history.threshold
    elif frame.inundated is not None:
        known = {'inundated_area_m2': frame.area(frame.inundated)}
    if cells is None:
        cells, name = frame.standing, 'standing lava'
    known['inundation_threshold_m'] = threshold
    layers = {'outline': gis.area(cells, terrain, shows=name, **known)}
    if 'arrival' in newest:
        layers['isochrones'] = gis.isochrones(
            newest['arrival'][0], terrain, onset, inundation_threshold_m=history.threshold
        )
    return layers


def _layer_tags(shown: LayerFrame) -> dict[str, str]:
    """Return tags that describe the recorded layer of a map, in the layer's unit."""
    layer = shown.layer
    half = rounding(layer)
    tags = {
        'layer': layer.name,
        'thinnest_lava_shown_m': repr(layer.threshold),
        'quantisation': 'none: recorded as float32',
    }
    if half and layer.range is not None:
        low, high = layer.range
        tags['quantisation'] = (
            f'recorded in steps of {2.0 * half:g} from {low:g} to {high:g}, true to {half:g}; '
            'values beyond are at the ends'
        )
        if layer.source != 'hazard':
            tags['saturated'] = 'yes' if shown.is_saturated else 'no'
    return tags
