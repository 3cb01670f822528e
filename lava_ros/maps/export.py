# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The maps of a bag -> GeoTIFF, and what else GIS programs read."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
import logging
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lava_ros import validation
from lava_ros.bag.description import described, effects_on
from lava_ros.errors import LavaError
from lava_ros.files.optional import require
from lava_ros.files.vectors import WRITTEN
from lava_ros.maps import gis
from lava_ros.maps.arrival import Arrival, check_threshold, rounding, THICKNESS
from lava_ros.maps.frames import Frame, LayerFrame, Progress, Recording, silent
from lava_ros.maps.plot import time_note
from lava_ros.scene import Vent
from lava_ros.scene.projection import coordinate_system, system_name
from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.inundation import inundated_cells, raise_peak

_LOG = logging.getLogger(__name__)

#: What can be exported.
MAPS = ('height', 'temperature', 'hazard', 'arrival', 'peak_height')

#: What maps are written as: GeoTIFF with styles of QGIS, outline and isochrones as vector files,
#: all maps in a NetCDF.
FORMATS = ('tif', *WRITTEN, 'nc')

#: Maps of one frame: what they show.
_SOURCES = {'height': THICKNESS, 'temperature': 'temperature', 'hazard': 'hazard'}

class Placement(NamedTuple):
    """Where the map frame is: easting and northing [m] of its origin; its system if known."""

    epsg: int | None
    offset: tuple[float, float]
    wkt: str | None = None

    @property
    def system(self) -> str | None:
        """The coordinate system as GDAL takes it, None without one."""
        return self.wkt if self.epsg is None else f'EPSG:{self.epsg}'


class Exported(NamedTuple):
    """The files written, and where in the world their maps are."""

    files: tuple[Path, ...]
    placement: Placement


def export_bag(
    path: str | Path,
    directory: str | Path,
    *,
    maps: Collection[str] = MAPS,
    formats: Collection[str] = ('tif',),
    time: float | None = None,
    every: bool = False,
    threshold: float = COVERED,
    epsg: int | None = None,
    offset: tuple[float, float] | None = None,
    progress: Progress = silent,
) -> Exported:
    """Write maps of a bag as GeoTIFF files, north up, with coordinate system, units and nodata.

    Arrival and peak height are those of all maps up to the time. Maps the bag has no layer for
    are left out. The directory is made when it is not there, otherwise it has to be empty.

    Args:
        path: The bag.
        directory: Where the files go.
        maps: What to write, of ``MAPS``.
        formats: What to write it as, of ``FORMATS``; of several frames only GeoTIFF has all.
        time: Simulated time [s] to show the newest maps up to; None for the last ones.
        every: Whether height, temperature and hazard are written for every frame up to the time.
        threshold: Thickness from which on lava has arrived [m].
        epsg: EPSG code, in place of the coordinate system of the bag.
        offset: Easting and northing [m] of the map frame's origin, for a bag without a system, or
            together with ``epsg``.
        progress: Is told what is being done, and the share of the frames that is done.

    Raises:
        LavaError: The bag cannot be read, an argument is not usable or contradicts the bag, or a
            file cannot be written.
    """
    for name in maps:
        validation.choice('maps', name, MAPS)
    for name in formats:
        validation.choice('formats', name, FORMATS)
    threshold = validation.number('threshold', threshold, above=0.0, unit='m')
    require('rasterio', 'GeoTIFF', str(directory))
    target = Path(directory)
    recording = Recording(path)
    placement = placement_of(recording.scene, epsg=epsg, offset=offset)
    run = recording.timeline.last_run
    if time is not None and not (run and run[0].time <= time <= run[-1].time):
        raise LavaError('time', time, recording.timeline.span)
    wants_history = bool({'arrival', 'peak_height'} & set(maps))
    thickness = [item for item in recording.layers.values() if item.source == THICKNESS]
    if wants_history and thickness:
        check_threshold(threshold, min(thickness, key=lambda layer: layer.threshold))
    crs = coordinate_system(placement.epsg, placement.wkt)
    gis.require_formats(formats, target, crs)
    _make_empty(target)
    origin = provenance_of(recording)
    writer = _Writer(
        target, crs, placement.offset, Path(path).name, origin, threshold, formats
    )
    writer.vents = _vents(recording.scene)
    current = [name for name in MAPS if name in maps and name in _SOURCES]
    history = Arrival(threshold)
    last: Frame | None = None
    for index, frame in enumerate(recording.frames()):
        if time is not None and frame.time is not None and frame.time > time:
            break
        progress('maps', recording.share_at(frame))
        if wants_history:
            history.add(frame)
        last = frame
        if every:
            seconds = 'unknown' if frame.time is None else f'{frame.time:.0f}'
            for name in current:
                writer.write_layer(name, frame, f'{name}_{index:04d}_{seconds}s.tif')
    if last is None:
        # nobody looks for what failed in an empty folder
        target.rmdir()
        raise recording.lack(time, 'terrain and a map')
    if note := time_note(None if every else time, last):
        _LOG.warning(note)
    for name in () if every else current:
        writer.write_layer(name, last, f'{name}.tif')
    for name in ('arrival', 'peak_height'):
        if name in maps and history.frame is not None:
            writer.write_history(name, history.frame, history)
    writer.finish(last, history)
    if not writer.written:
        have = sorted({layer.source for layer in recording.layers.values()})
        raise LavaError('maps', ', '.join(maps), f'maps of what the bag has: {", ".join(have)}')
    return Exported(tuple(writer.written), placement)


def placement_of(
    scene: Mapping[str, Any],
    *,
    epsg: int | None = None,
    offset: tuple[float, float] | None = None,
) -> Placement:
    """Where the map frame of a bag is.

    ``epsg``, and ``offset`` [m] beside it, replace what the scene in the bag states. LavaError
    where ``offset`` alone contradicts it, or its own values are not usable.
    """
    terrain = scene.get('terrain')
    terrain = terrain if isinstance(terrain, Mapping) else {}
    known, wkt = terrain.get('epsg'), terrain.get('wkt')
    if known is not None and (isinstance(known, bool) or not isinstance(known, int)):
        raise LavaError("the bag's terrain.epsg", known, 'an EPSG code such as 32633')
    own = validation.pair("the bag's terrain.offset", terrain.get('offset', (0.0, 0.0)))
    if wkt is not None and not isinstance(wkt, str):
        raise LavaError("the bag's terrain.wkt", wkt, 'the definition of a coordinate system')
    stated = Placement(known, own, wkt)
    if epsg in (None, known) and stated.system:
        if offset is not None and offset != own:
            raise LavaError('offset', offset, f'{own}, as the bag states')
        return stated
    if stated.system:
        _LOG.warning(f'EPSG:{epsg} as given, although the bag states {system_name(known, wkt)}')
    return Placement(epsg, own if offset is None else offset)


def _vents(scene: Mapping[str, Any]) -> list[Vent]:
    """The vents that a bag describes; none where it does not, with a warning if it tries to."""
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
    """Return the origin of the maps of a bag, as far as the bag describes it."""
    data = recording.bag.custom_data
    told = described(data)
    parameters = told['parameters'] or {}
    scene = data.get('case') or parameters.get('scene') or recording.bag.path.resolve().name
    return gis.Provenance(
        scene=str(scene),
        effects=effects_on(told),
        preset=str(parameters.get('preset') or 'unknown'),
        version=data.get('version') or 'unknown',
    )


def _make_empty(directory: Path) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
        is_empty = not any(directory.iterdir())
    except OSError as error:
        raise LavaError('output', str(directory), f'a folder to write to ({error})') from error
    if not is_empty:
        raise LavaError('output', str(directory), 'a folder that is new or empty')


@dataclass
class _Writer:
    """Writes the files, and lists them in ``written``."""

    directory: Path
    crs: Any
    offset: tuple[float, float]
    bag: str
    origin: gis.Provenance
    threshold: float
    formats: Collection[str]
    written: list[Path] = field(default_factory=list)
    newest: dict[str, np.ndarray] = field(default_factory=dict)
    place: gis.Place | None = None
    vents: Sequence[Vent] = ()

    def write_layer(self, name: str, frame: Frame, file_name: str) -> None:
        """Write a layer of a frame, when it has it."""
        shown = frame.layers.get(_SOURCES[name])
        if shown is None:
            return
        values = shown.values
        if name == 'hazard':
            # 0 says that there is no lava.
            values = np.nan_to_num(np.clip(np.rint(values), 1, 100))
        values = np.where(np.isfinite(frame.elevation), values, np.float32(np.nan))
        tags = _layer_tags(shown)
        if frame.time is not None:
            tags['simulated_time_s'] = repr(frame.time)
        self._write(name, values, frame, file_name, tags)

    def write_history(self, name: str, frame: Frame, history: Arrival) -> None:
        """Write arrival or peak height."""
        shown = frame.layers[THICKNESS]
        assert history.times is not None and history.peak is not None
        tags = _layer_tags(shown) | {'maps': str(history.frame_count)}
        if frame.time is not None:
            tags['maps_up_to_s'] = repr(frame.time)
        if name == 'arrival':
            tags['threshold_m'] = repr(self.threshold)
            if history.is_noted:
                tags['note'] = 'times are those of the steps of the simulation'
            else:
                tags['longest_time_between_maps_s'] = repr(history.longest_gap)
                tags['note'] = 'lava may have come earlier, by the time between two maps at most'
            values = history.times.astype(np.float32)
        else:
            tags['saturated'] = 'yes' if history.is_saturated else 'no'
            values = history.peak
            if history.is_noted:
                values = raise_peak(values, history.times)
        self._write(name, values, frame, f'{name}.tif', tags)

    def _write(
        self, name: str, values: np.ndarray, frame: Frame, file_name: str, tags: dict[str, str]
    ) -> None:
        corner = (self.offset[0] + frame.origin[0], self.offset[1] + frame.origin[1])
        self.place = gis.Place(corner, frame.resolution, self.crs)
        self.newest[name] = values
        if 'tif' in self.formats:
            path, tags = self.directory / file_name, {'bag': self.bag, **tags}
            files = gis.write_map(path, name, values, self.place, self.origin, tags)
            # the style belongs to its GeoTIFF
            self.written.append(files[0])

    def finish(self, frame: Frame, history: Arrival) -> None:
        """Write the newest maps in the formats that have them in one file.

        The outline is that of the inundated area up to the frame; where the bag does not say, that
        of the lava that stands then.
        """
        if self.place is None:
            return
        layers: dict[str, list[dict[str, Any]]] = {}
        cells, name = frame.inundated, 'inundated area'
        if cells is None and history.times is not None and self.threshold == COVERED:
            cells = inundated_cells(history.times)
        if cells is None:
            cells, name = frame.standing, 'standing lava'
        layers['outline'] = gis.area(cells, self.place, shows=name, from_m=COVERED)
        if 'arrival' in self.newest:
            layers['isochrones'] = gis.isochrones(self.newest['arrival'], self.place)
        layers |= gis.vents(self.vents, self.offset)
        self.written += gis.write_formats(
            self.directory, self.formats, layers, self.newest, self.place,
            f'lava flow of {self.bag}',
        )


def _layer_tags(shown: LayerFrame) -> dict[str, str]:
    """What a file says about the layer it comes from, in the layer's unit."""
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
