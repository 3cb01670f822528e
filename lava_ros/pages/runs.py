# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What was computed and lies on disk, a bag or an ensemble -> maps and facts for people."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime, timezone
import logging
import math
from pathlib import Path
from typing import Any

import numpy as np

import lava_ros
from lava_ros.bag.description import described, effects_on
from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import LavaError
from lava_ros.files import open_input
from lava_ros.files.optional import require
from lava_ros.files.rasters import opened_raster
from lava_ros.files.yaml import parse_json
from lava_ros.forecast.ensemble import MANIFEST
from lava_ros.forecast.members import Plan
from lava_ros.forecast.picture import frame_of
from lava_ros.forecast.sentinels import CalledEffect
from lava_ros.maps.arrival import Arrival
from lava_ros.maps.frames import Frame, Recording
from lava_ros.maps.plot import area_words, duration, STYLES, time_note, titles
from lava_ros.maps.sheet import Panel
from lava_ros.scene import MAX_ELEVATION, Scene, scene_from_dict, Terrain
from lava_ros.scene.projection import coordinate_system, system_name
from lava_ros.simulation.accuracy import Accuracy, COVERED
from lava_ros.simulation.budget import VolumeBudget

_LOG = logging.getLogger(__name__)

#: Maps of an ensemble: file, what is drawn of it, title.
ENSEMBLE_MAPS = {
    'probability': ('inundation_probability', 'probability', STYLES['probability'].title),
    **{
        name: (f'arrival_time_p{share}', 'arrival', words)
        for name, share, words in (
            ('arrival_p10', 10, 'Early arrival (1 run in 10)'),
            ('arrival', 50, 'Median arrival (1 run in 2)'),
            ('arrival_p90', 90, 'Late arrival (9 runs in 10)'),
        )
    },
    'thickness': ('expected_peak_thickness', 'thickness', 'Expected peak thickness of the lava'),
}

#: Maps that are drawn by default, of a bag and of an ensemble.
_USUAL = (
    ('thickness', 'temperature', 'hazard'),
    ('probability', 'arrival_p10', 'arrival', 'arrival_p90'),
)


@dataclass(frozen=True, eq=False)
class Members:
    """The members of an ensemble: their plan and number, and the effective number by weight."""

    plan: Plan
    count: int
    effective: float


@dataclass(frozen=True, eq=False)
class Run:
    """A bag or an ensemble: its maps by name, its facts by term, and the ground.

    ``end`` is the simulated time of a bag's maps, or the horizon of an ensemble [s]; None where it
    is unknown. ``ensemble`` is None for a bag.
    """

    name: str
    title: str
    summary: str
    panels: Mapping[str, Panel]
    facts: Mapping[str, str]
    terrain: Terrain
    is_ensemble: bool
    end: float | None
    ensemble: Members | None = None

    @property
    def usual(self) -> list[str]:
        """Names of the maps that are drawn by default."""
        return [name for name in _USUAL[self.is_ensemble] if name in self.panels]


def is_ensemble(path: str | Path) -> bool:
    """Whether a path is the folder of an ensemble."""
    return (Path(path) / MANIFEST).is_file()


def read_run(path: str | Path, *, time: float | None = None, wanted: Collection[str] = ()) -> Run:
    """Read a bag's directory, an .mcap file, or the output of ``lava ensemble``.

    ``time`` is the simulated time of a bag's maps [s], None for the last ones. The map of arrival,
    which takes long, is only made if it is ``wanted``.

    Raises:
        LavaError: The run cannot be read, lacks a wanted map, or is an ensemble and ``time`` is
            set.
    """
    if not is_ensemble(path):
        return _bag(Path(path), time, wanted)
    if time is not None:
        raise LavaError('--time', time, f'no --time for {path}, an ensemble')
    return _ensemble(Path(path))


def _bag(path: Path, time: float | None, wanted: Collection[str]) -> Run:
    recording = Recording(path)
    frame = recording.frame_at(time)
    scene = _scene(frame)
    if scene is not None and not len(frame.vents):
        # after the end of the emission the page still shows where the lava came from
        frame = replace(frame, vents=frame_of(scene).vents)
    fissures = _fissures(scene)
    maps = {
        name: Panel(frame, name, item.values, '', item.is_saturated, fissures)
        for name, item in frame.layers.items()
        if name in STYLES
    }
    if 'arrival' in wanted:
        times = _arrival(recording, frame)
        if times is not None:
            title = f'Time of arrival of the lava, {COVERED:g} m thick'
            maps['arrival'] = Panel(frame, 'arrival', times, title, fissures=fissures)
    terrain = frame.scene.get('terrain') or {}
    note = time_note(time, frame)
    if note:
        _LOG.warning(f'{path.resolve().name}: {note}')
    return Run(
        path.resolve().name,
        *titles(frame),
        maps,
        {
            **({'time': note} if note else {}),
            **_emitted(recording, frame, scene),
            **_model(recording),
            **_ground(frame),
        },
        Terrain(
            frame.elevation, frame.resolution, frame.origin, terrain.get('epsg'),
            terrain.get('offset', (0.0, 0.0)), wkt=terrain.get('wkt'),
        ),
        is_ensemble=False,
        end=frame.time,
    )


def _scene(frame: Frame) -> Scene | None:
    """The scene of a recording, None where its description is not one."""
    terrain = Terrain(frame.elevation, frame.resolution, frame.origin)
    try:
        return scene_from_dict(frame.scene, terrain) if frame.scene else None
    except LavaError:
        return None


def _fissures(scene: Scene | None) -> np.ndarray:
    vents = scene.vents if scene is not None else ()
    ends = [(vent.position, vent.end) for vent in vents if vent.end is not None]
    return np.array(ends).reshape(-1, 2, 2)


def _arrival(recording: Recording, frame: Frame) -> np.ndarray | None:
    if frame.arrived is not None and np.isfinite(frame.arrived).any():
        return frame.arrived
    # a simulation that does not note the times publishes a map without any
    history = Arrival(COVERED)
    for item in recording.frames():
        if frame.time is None or item.time is None or item.time <= frame.time:
            history.add(item)
    return history.times


def _day(seconds: float) -> str:
    return f'{datetime.fromtimestamp(seconds, timezone.utc):%Y-%m-%d}'


def _emitted(recording: Recording, frame: Frame, scene: Scene | None) -> dict[str, str]:
    begun = (recording.bag.start_ns or 0) / 1e9
    # a simulation's clock gives no date
    facts = ({'computed': _day(begun)} if begun > 1e9 else {}) | _vents(scene)
    at = [item for item in recording.timeline.last_run if item.time <= (frame.time or math.inf)]
    budget = VolumeBudget.from_texts(at[-1].values) if at else None
    if budget is not None:
        value = budget.emitted
        text = f'{value / 1e6:.3g} million m³' if value >= 1e5 else f'{value:.3g} m³'
        facts['volume emitted'] = text
        if budget.warnings():
            facts['warning'] = '; '.join(budget.warnings())
    return facts


def _vents(scene: Scene | None) -> dict[str, str]:
    if scene is None or not scene.vents:
        return {}
    count = len(scene.vents)
    flux = f'{sum(vent.peak for vent in scene.vents):.4g} m³/s'
    if any(len(vent.series) > 1 for vent in scene.vents):
        flux += ' at most'
    return {'effusion rate': flux + (f' from {count} vents' if count > 1 else '')}


def _model(recording: Recording) -> dict[str, str]:
    told = described(recording.bag.custom_data)
    version = recording.bag.custom_data.get('version') or 'of unknown version'
    moments = recording.timeline.last_run
    words = [f'lava_ros {version}, depth-averaged lava as particles']
    preset = (told['parameters'] or {}).get('preset')
    if isinstance(preset, str):
        words.append(f'preset {preset}')
    if moments:
        values = moments[-1].values
        if 'spacing_m' in values:
            words[0] += f' {values["spacing_m"]} m apart'
        error = moments[-1].number('footprint_error')
        if math.isfinite(error):
            words.append(f'expected error of the footprint {100.0 * error:.2g} %')
    return {'model': ', '.join(words), **_processes(effects_on(told) or ())}


def _processes(effects: Iterable[str]) -> dict[str, str]:
    """The effects that are on, in plain words."""
    words = [_plain(name) for name in effects]
    return {'processes included': ', '.join(words)} if words else {}


def _plain(effect: str) -> str:
    return EFFECTS[effect].title if effect in EFFECTS else effect.replace('_', ' ')


def _ground(frame: Frame) -> dict[str, str]:
    terrain = frame.scene.get('terrain') or {}
    source = terrain.get('source')
    cells = f'maps in cells of {frame.resolution:g} m'
    return {
        'elevation': f'{source}, {cells}' if source else cells,
        'coordinates': system_words(terrain.get('epsg'), terrain.get('wkt')),
    }


def system_words(epsg: int | None, wkt: str | None) -> str:
    """The coordinate system by its code, and by its name where GDAL is installed."""
    if not epsg:
        return system_name(None, wkt) if wkt else 'of the map frame: no coordinate system'
    try:
        known = coordinate_system(epsg).to_wkt()
    except LavaError:
        return f'EPSG:{epsg}'
    return f'{known.split(chr(34))[1]} (EPSG:{epsg})'


def _ensemble(folder: Path) -> Run:
    require('rasterio', 'GeoTIFF', str(folder))
    try:
        with open_input(folder / MANIFEST) as file:
            manifest: Any = parse_json(MANIFEST, file.read())
        known, plan = manifest['scene'], manifest['plan']
        reviewed = map(CalledEffect.from_dict, plan['switched_on'])
        place = dict(known['terrain'])
        shape = tuple(place.pop('shape'))
        terrain = Terrain(_raster(folder / 'elevation.tif', shape)[0], **place)
        scene = scene_from_dict(known, terrain)
        maps: dict[str, Panel] = {}
        tags: dict[str, str] = {}
        frame = frame_of(scene)
        for name, (stem, source, title) in ENSEMBLE_MAPS.items():
            most = {'probability': 100.0, 'arrival': float(plan['horizon_s'])}.get(source)
            values, tags = _raster(folder / f'{stem}.tif', shape, 0.0, most or MAX_ELEVATION)
            values = np.where(values > 0.0, values, np.nan)
            maps[name] = Panel(frame, source, values, title, fissures=_fissures(scene))
        horizon, threshold = float(tags['horizon_s']), float(tags['threshold_m'])
        members, effective = tags['members'], float(tags['effective_members'])
        observation = tags.get('observation', 'none')
        # an ensemble that runs again may still have the maps of before
        on = tags.get('effects', '').split()
        reasons = [
            f'{_plain(item.effect)}: {item.reason}' for item in reviewed if item.effect in on
        ]
        ran = Plan(
            scene, horizon, Accuracy(**plan['accuracy']), Effects(**plan['effects']), threshold,
            int(plan['looks']),
        )
    except (OSError, KeyError, TypeError, ValueError) as error:
        right = f'an ensemble whose maps are finished and undamaged ({error})'
        raise LavaError('ensemble', str(folder), right) from error
    likely = np.nan_to_num(maps['probability'].values)
    cell = terrain.resolution**2
    areas = [
        f'{area_words(float((likely >= least).sum()) * cell)} at {least} % or more'
        for least in (10, 50, 90)
    ]
    preset = f', preset {tags["preset"]}' if 'preset' in tags else ''
    facts = {
        'computed': _day((folder / 'inundation_probability.tif').stat().st_mtime),
        **_vents(scene),
        'runs': f'{members}'
        + (f', which count like {effective:.3g} of equal weight' if observation != 'none' else '')
        + f'; a probability of 50 % is known to {50.0 / effective**0.5:.2g} percentage points '
        '(standard error)',
        'inundation': f'lava of {threshold:g} m or more within {duration(horizon)}',
        **({'weighted by': observation} if observation != 'none' else {}),
        'uncertain': ', '.join(sorted(known.get('uncertainty') or {})) or 'nothing of the scene',
        'model': f'lava_ros {manifest.get("lava_ros", lava_ros.__version__)}, depth-averaged lava '
        f'as particles {float(plan["accuracy"]["spacing"] or 0.0):.3g} m apart{preset}',
        **_processes(on),
        **({'switched on': '; '.join(reasons)} if reasons else {}),
        **_ground(frame),
    }
    title = f'Lava within {duration(horizon)}, {members} runs'
    if observation != 'none':
        title += ' weighted by observed lava'
    return Run(
        folder.resolve().name, title, '  ·  '.join(areas), maps, facts, terrain, is_ensemble=True,
        end=horizon, ensemble=Members(ran, int(members), effective),
    )


def _raster(
    path: Path, shape: tuple[int, ...], least: float = -MAX_ELEVATION, most: float = MAX_ELEVATION
) -> tuple[np.ndarray, dict[str, str]]:
    """A map of an ensemble, NaN without data, and what is noted with it."""
    with opened_raster('a map', path) as source:
        values = np.flipud(source.read(1, masked=True).astype(np.float64).filled(np.nan))
        tags = dict(source.tags())
    if values.shape != shape:
        raise ValueError(f'{path.name} has other cells than {MANIFEST} says')
    wrong = values[(values < least) | (values > most)]
    if wrong.size:
        raise ValueError(f'{path.name} has {wrong[0]:g}, expected {least:g} to {most:g}')
    return values, tags
