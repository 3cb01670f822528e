# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs on disk (bags and ensembles) as maps and facts for people."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone, tzinfo
import logging
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.bag.decoding import Moment
from lava_ros.bag.description import described, effects_on
from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import LavaError
from lava_ros.files.optional import require
from lava_ros.files.rasters import read_raster
from lava_ros.forecast.members import Plan
from lava_ros.forecast.sentinels import CalledEffect
from lava_ros.forecast.store import ensemble_record, is_ensemble
from lava_ros.layers.arrival import Arrival
from lava_ros.layers.frame import Frame, frame_of
from lava_ros.layers.numbers import area_words, duration
from lava_ros.layers.recording import Recording
from lava_ros.products.colours import STYLES
from lava_ros.products.ensemble_facts import describe_influence, describe_uncertain, Missing
from lava_ros.products.gis import PROBABILITIES
from lava_ros.products.plot import time_note, titles
from lava_ros.products.run_warnings import (
    error_of_moment,
    method_of,
    warnings_of_plan,
    warnings_of_recording,
)
from lava_ros.products.sheet import Panel
from lava_ros.scene import MAX_ELEVATION, Scene, scene_from_dict, Terrain
from lava_ros.scene.erupting_lava import EruptingLava
from lava_ros.scene.onset import Onset, recorded_onset, stated_onset
from lava_ros.scene.projection import system_words
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import describe_carriers, METHODS
from lava_ros.simulation.numerical_error import brief_text, NOT_MEASURED
from lava_ros.simulation.output.budget import LABEL_OF_SEA, VolumeBudget

_LOG = logging.getLogger(__name__)

#: Maps of an ensemble: file, style and title. The keys are the names of the files, except where a
#: single run has the same kind of map.
ENSEMBLE_MAPS = {
    'inundation_probability': (
        'inundation_probability', 'probability', STYLES['probability'].title
    ),
    **{
        name: (f'arrival_time_p{percent}', 'arrival', words)
        for name, percent, words in (
            ('arrival_time_p10', 10, 'Early arrival (lava comes earlier in {} % of cases)'),
            ('arrival', 50, 'Median arrival (lava comes earlier in {} % of cases)'),
            ('arrival_time_p90', 90, 'Late arrival (lava comes earlier in {} % of cases)'),
        )
    },
    'arrival_time_earliest': (
        'arrival_time_earliest', 'arrival', 'Earliest arrival (earlier in less than {} % of cases)'
    ),
    'largest_thickness': (
        'largest_peak_thickness', 'thickness', 'Largest thickness of any run'
    ),
    'thickness': ('expected_peak_thickness', 'thickness', 'Expected peak thickness of the lava'),
}


@dataclass(frozen=True, eq=False)
class Members:
    """Members of an ensemble: their plan, their number, and the effective number by weight.

    ``areas`` are those that at least a percentage of the members inundate [m2], by percentage.
    """

    plan: Plan
    count: int
    effective: float
    areas: Mapping[float, float]


@dataclass(frozen=True, eq=False)
class Run:
    """A bag or an ensemble: its maps by name, its facts by term, and the ground.

    ``end`` is the simulated time of a bag's maps, or the horizon of an ensemble [s]; None if it is
    unknown. ``onset`` is the date of simulated time 0; None if it is unknown. ``lava`` is the lava
    of the vents, None if it is unknown. ``error`` is the numerical error as plain data, None if it
    is not measured. ``ensemble`` is None for a bag.
    """

    name: str
    title: str
    summary: str
    panels: Mapping[str, Panel]
    facts: Mapping[str, str]
    terrain: Terrain
    end: float | None
    onset: Onset | None
    lava: EruptingLava | None = None
    error: Mapping[str, Any] | None = None
    warnings: Sequence[str] = ()
    ensemble: Members | None = None

    def quality(self) -> dict[str, Any]:
        """Return lava, numerical error and warnings as plain data for JSON."""
        return {
            'erupting_lava': None if self.lava is None else self.lava.as_dict(),
            'numerical_error': self.error,
            'warnings': list(self.warnings),
        }

    @property
    def usual(self) -> list[str]:
        """Names of the default maps."""
        names = ['thickness', 'temperature', 'hazard']
        if self.ensemble is not None:
            names = ['inundation_probability', 'arrival_time_p10', 'arrival', 'arrival_time_p90']
        return [name for name in names if name in self.panels]


def dated(given: Onset | None, zone: tzinfo | None, runs: Sequence[Run]) -> Onset | None:
    """Return the given or common onset of runs, with the zone of local times.

    Raises:
        LavaError: If there is a zone and no onset.
    """
    known = {run.onset for run in runs}
    onset = given or (known.pop() if len(known) == 1 else None)
    if onset is None and zone is not None:
        raise validation.dependence('--timezone', '--start')
    return None if onset is None else replace(onset, zone=zone)


def read_run(
    path: str | Path, *, node: str | None = None, time: float | None = None,
    wanted: Collection[str] = (),
) -> Run:
    """Read a bag's directory, an .mcap file, or the output of ``lava run --members``.

    ``node`` is the full name or the namespace of a node of a bag, None for the only one. ``time``
    is the simulated time of a bag's maps [s], None for the last ones. The map of arrival times is
    slow and is only computed if it is ``wanted``.

    Raises:
        LavaError: If the run cannot be read, or is an ensemble and ``node`` or ``time`` is set.
    """
    if not is_ensemble(path):
        return _bag(Path(path), node, time, wanted)
    for name, value in (('--node', node), ('--at', time)):
        if value is not None:
            raise validation.conflict(name, f'an ensemble ({path})')
    return _ensemble(Path(path))


def _bag(path: Path, node: str | None, time: float | None, wanted: Collection[str]) -> Run:
    recording = Recording(path, node=node)
    frame = recording.frame_at(time)
    scene = _scene(frame)
    if scene is not None:
        known = frame_of(scene)
        # the page also shows vents that no longer emit lava
        vents = frame.vents if len(frame.vents) else known.vents
        frame = replace(frame, vents=vents, fissures=known.fissures)
    maps = {
        name: Panel(frame, name, item.values, '', item.is_saturated)
        for name, item in frame.layers.items()
        if name in STYLES
    }
    if 'arrival' in wanted:
        times = _arrival(recording, frame)
        if times is not None:
            title = f'Time of arrival of the lava, {frame.threshold:g} m thick'
            maps['arrival'] = Panel(frame, 'arrival', times, title)
    at = [item for item in recording.timeline.last_run if item.time <= (frame.time or math.inf)]
    warnings = warnings_of_recording(recording, at)
    note = time_note(time, frame)
    if note:
        _LOG.warning(f'{path.resolve().name}: {note}')
    return Run(
        path.resolve().name,
        *titles(frame),
        maps,
        {
            **({'time': note} if note else {}),
            **_emitted(recording, frame, scene, at),
            **_warning(warnings),
            **_model(recording),
            **_ground(frame),
        },
        frame.terrain,
        frame.time,
        recorded_onset(recording.bag.custom_data),
        None if scene is None else EruptingLava.of(scene),
        error_of_moment(recording.timeline.last_run[-1] if recording.timeline.last_run else None),
        warnings,
    )


def _scene(frame: Frame) -> Scene | None:
    """Return the scene of a recording; None if its description is not valid."""
    terrain = Terrain(frame.elevation, frame.resolution, frame.origin)
    try:
        return _described(frame.scene, terrain) if frame.scene else None
    except LavaError:
        return None


def _described(known: Mapping[str, Any], terrain: Terrain) -> Scene:
    """Return the scene of a description, which lacks the grids of emplaced flows and of events."""
    kept = {key: item for key, item in known.items() if key not in ('emplaced_flows', 'events')}
    return scene_from_dict(kept, terrain)


def _changes(known: Mapping[str, Any]) -> dict[str, str]:
    """Describe the flows emplaced at the start and the later changes of the ground."""
    flows = [
        f'{item["source"]}, {item["volume"]:,.0f} m³ of lava'
        for item in known.get('emplaced_flows') or ()
    ]
    events = [f'{item["text"]} at {duration(item["time"])}' for item in known.get('events') or ()]
    facts = {'emplaced at the start': '; '.join(flows), 'changes of the ground': '; '.join(events)}
    return {term: text for term, text in facts.items() if text}


def _arrival(recording: Recording, frame: Frame) -> np.ndarray | None:
    if frame.arrived is not None and np.isfinite(frame.arrived).any():
        return frame.arrived
    # a simulation without arrival times publishes an empty map
    history = Arrival(frame.threshold)
    for item in recording.frames():
        if frame.time is None or item.time is None or item.time <= frame.time:
            history.add(item)
    return history.times


def _day(seconds: float) -> str:
    return f'{datetime.fromtimestamp(seconds, timezone.utc):%Y-%m-%d}'


def _warning(warnings: Sequence[str]) -> dict[str, str]:
    return {'warning': ' '.join(warnings)} if warnings else {}


def _emitted(
    recording: Recording, frame: Frame, scene: Scene | None, at: Sequence[Moment]
) -> dict[str, str]:
    begun = (recording.bag.start_ns or 0) / 1e9
    # the clock of a simulation does not have a date
    computed = recording.bag.custom_data.get('begun', _day(begun) if begun > 1e9 else '')[:10]
    facts = {
        **({'computed': computed} if computed else {}), **_vents(scene),
        **_changes(frame.scene),
    }
    budget = VolumeBudget.from_texts(at[-1].values) if at else None
    if budget is not None:
        value = budget.emitted
        in_millions, rounded = f'{value / 1e6:.3g} million m³', float(f'{value:.3g}')
        facts['volume emitted'] = in_millions if value >= 1e5 else f'{rounded:,g} m³'
        if budget.lost_in_sea:
            lost = dict(budget.rows())[LABEL_OF_SEA]
            facts[f'volume {LABEL_OF_SEA}'] = lost.replace('m3', 'm³')
    return facts


def _vents(scene: Scene | None) -> dict[str, str]:
    if scene is None or not scene.vents:
        return {}
    count = len(scene.vents)
    flux = f'{sum(vent.peak for vent in scene.vents):.4g} m³/s'
    if any(len(vent.series) > 1 for vent in scene.vents):
        flux += ' at most'
    return {
        'effusion rate': flux + (f' from {count} vents' if count > 1 else ''),
        'lava': EruptingLava.of(scene).text(),
    }


def _model(recording: Recording) -> dict[str, str]:
    description = described(recording.bag.custom_data)
    version = recording.bag.custom_data.get('version') or 'of unknown version'
    moments = recording.timeline.last_run
    chosen = description['parameters'] or {}
    spacing = moments[-1].values.get('spacing_m', '') if moments else ''
    # a parameter of a node may ask for the choice by the flow
    method = method_of(moments[-1]) if moments else METHODS[0]
    carriers = describe_carriers(method, spacing)
    words, preset = [f'lava_ros {version}, {carriers}'], chosen.get('preset')
    if isinstance(preset, str):
        words.append(f'preset {preset}')
    if moments:
        errors = (
            moments[-1].number(f'numerical_error_{name}') for name in ('inundated', 'standing')
        )
        words.append(f'numerical error {brief_text(*errors)}')
    return {'model': ', '.join(words), **_processes(effects_on(description) or ())}


def _processes(effects: Iterable[str]) -> dict[str, str]:
    words = [_plain(name) for name in effects]
    return {'processes included': ', '.join(words)} if words else {}


def _plain(effect: str) -> str:
    return EFFECTS[effect].title if effect in EFFECTS else effect.replace('_', ' ')


def _ground(frame: Frame) -> dict[str, str]:
    terrain = frame.scene.get('terrain') or {}
    source = terrain.get('source')
    cells = f'maps in cells of {frame.resolution:.4g} m'
    return {
        'elevation': f'{source}, {cells}' if source else cells,
        'coordinates': system_words(terrain.get('epsg'), terrain.get('wkt')),
    }


def _ensemble(folder: Path) -> Run:
    require('rasterio', 'GeoTIFF', str(folder))
    missing, manifest = Missing(), ensemble_record(folder)
    try:
        known, plan = manifest['scene'], manifest['plan']
        reviewed = map(CalledEffect.from_dict, missing.get(plan, 'switched_on') or ())
        place = dict(known['terrain'])
        shape = tuple(place.pop('shape'))
        terrain = Terrain(_raster(folder / 'elevation.tif', shape)[0], **place)
        scene = _described(known, terrain)
        maps: dict[str, Panel] = {}
        tags: dict[str, str] = {}
        frame = frame_of(scene)
        for name, (stem, source, title) in ENSEMBLE_MAPS.items():
            if not missing.has_map(folder, stem):
                continue
            most = {'probability': 100.0, 'arrival': float(plan['horizon_s'])}.get(source)
            values, tags = _raster(folder / f'{stem}.tif', shape, 0.0, most or MAX_ELEVATION)
            values = np.where(values > 0.0, values, np.nan)
            if source == 'probability':
                limit = missing.get(tags, 'unseen_percent')
                below = 'no lava in any run' if limit is None else f'below {float(limit):.2g} %'
                title = f'{title} (no colour: {below})'
            elif source == 'arrival':
                is_first = stem == 'arrival_time_earliest'
                tag = 'unseen' if is_first else f'arrives_before_{stem[-3:]}'
                part = missing.get(tags, f'{tag}_percent')
                words, _, _ = title.partition(' (')
                title = words if part is None else title.format(f'{float(part):.2g}')
            maps[name] = Panel(frame, source, values, title)
        horizon, threshold = float(tags['horizon_s']), float(tags['inundation_threshold_m'])
        members, effective = tags['members'], float(tags['effective_members'])
        observation = tags.get('observation', 'none')
        onset = stated_onset(tags.get('onset', 'unknown'), str(folder))
        # a repeated ensemble may still have its previous maps
        on = tags.get('effects', '').split()
        reasons = [
            f'{_plain(item.effect)}: {item.reason}' for item in reviewed if item.effect in on
        ]
        accuracy = Accuracy(**{**plan['accuracy'], 'threshold': threshold})
        ran = Plan(
            scene, horizon, accuracy, Effects(**plan['effects']), int(plan['looks']),
            forced=missing.get(plan, 'forced') or {},
        )
        # version 0.1.0 did not keep it
        measured = manifest.get('numerical_error')
        found = {
            least: missing.get(tags, f'inundated_area_p{least:.0f}_m2') for least in PROBABILITIES
        }
        areas = {least: float(area) for least, area in found.items() if area is not None}
        worst = missing.get(tags, 'inundated_area_worst_m2')
        texts = [] if worst is None else [f'{area_words(float(worst))} in any run']
        limits = [] if limit is None else [f'no lava in any run means below {float(limit):.2g} %']
        spacing_error = missing.get(tags, 'spacing_error') or 'missing'
        is_unusable = missing.get(tags, 'is_usable') == 'false'
        inputs = missing.get(manifest, 'quantities')
    except (OSError, KeyError, TypeError, ValueError) as error:
        expected = f'an ensemble whose maps are finished and undamaged ({error})'
        raise LavaError('ensemble', str(folder), expected) from error
    texts += [f'{area_words(area)} at {least:g} % or more' for least, area in areas.items()]
    version = manifest['program']['lava_ros']
    preset = f', preset {tags["preset"]}' if 'preset' in tags else ''
    carriers = describe_carriers(
        ran.accuracy.method, f'{float(plan["accuracy"]["spacing"] or 0.0):.3g}'
    )
    # an earlier version recorded none of the inputs
    warnings = list(map(str, manifest.get('warnings') or warnings_of_plan(ran)))
    facts = {
        'computed': _day((folder / 'inundation_probability.tif').stat().st_mtime),
        **_vents(scene),
        **_changes(known),
        'runs': f'{members}'
        + (f', which count like {effective:.3g} of equal weight' if observation != 'none' else '')
        + f'; a probability of 50 % is known to {50.0 / effective**0.5:.2g} percentage points '
        + ', and '.join(['(standard error)', *limits]),
        'inundation': f'lava of {threshold:g} m or more within {duration(horizon)}',
        **({'weighted by': observation} if observation != 'none' else {}),
        **_warning(warnings),
        **({} if inputs is None else describe_uncertain(inputs)),
        **describe_influence(tags),
        'model': f'lava_ros {version}, {carriers}{preset}, '
        f'numerical error {tags.get("numerical_error", NOT_MEASURED)}',
        'warning' if is_unusable else 'error of the spacing': spacing_error,
        **_processes(on),
        **({'switched on': '; '.join(reasons)} if reasons else {}),
        **_ground(frame),
        **missing.facts(version),
    }
    title = f'Lava within {duration(horizon)}, {members} runs'
    if is_unusable:
        title += ', not usable'
    if observation != 'none':
        title += ' weighted by observed lava'
    return Run(
        folder.resolve().name, title, '  ·  '.join(texts), maps, facts, terrain, horizon, onset,
        EruptingLava.of(scene), measured, warnings, Members(ran, int(members), effective, areas),
    )


def _raster(
    path: Path, shape: tuple[int, ...], least: float = -MAX_ELEVATION, most: float = MAX_ELEVATION
) -> tuple[np.ndarray, dict[str, str]]:
    """Return a map of an ensemble, NaN without data, and its tags."""
    source = read_raster('a map', path, kind=np.float64)
    values, tags = np.flipud(source.values[0].filled(np.nan)), dict(source.tags)
    if values.shape != shape:
        raise ValueError(f'the grid of {path.name} differs from that of the ensemble')
    wrong = values[(values < least) | (values > most)]
    if wrong.size:
        raise ValueError(f'{path.name} has {wrong[0]:g}, expected {least:g} to {most:g}')
    return values, tags
