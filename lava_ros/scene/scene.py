# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenes and scene files: terrain, vents, lava, surroundings and uncertainty."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import datetime
from functools import partial
import logging
from pathlib import Path
from typing import Any

from lava_ros import validation
from lava_ros.effects import EFFECTS, possible
from lava_ros.effects.effect import check_fields, join_names, number, with_fields
from lava_ros.errors import LavaError
from lava_ros.files.resources import find_file
from lava_ros.files.yaml import read_yaml
from lava_ros.scene.distributions import Distribution
from lava_ros.scene.effusion_rates import (
    check_start,
    date_in_utc,
    error_of_rates,
    Interval,
    Options,
    read_effusion_rates,
    series_of_rates,
)
from lava_ros.scene.emplaced import EmplacedFlow, flow_to_dict, read_flows
from lava_ros.scene.events import check_same_grid, event_to_dict, read_events, TerrainEvent
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import (
    default_lava,
    lava_from_dict,
    Material,
    material_named,
    with_material_in_lava,
)
from lava_ros.scene.plausibility import doubts_of_scene, KELVIN, report
from lava_ros.scene.terrain import Terrain
from lava_ros.scene.terrain_files import load_terrain, TERRAIN_OPTIONS, terrain_path
from lava_ros.scene.uncertainty import Uncertainty, uncertainty_from_dict, uncertainty_to_dict
from lava_ros.scene.vents import check_vents, Vent, vents_from_list

_LOG = logging.getLogger(__name__)

#: Maximum viscosity of erupting lava [Pa s], including the effect of crystals.
MAX_VENT_VISCOSITY = 1e15


@dataclass(frozen=True, eq=False)
@with_fields(partial(join_names, 'environment', EFFECTS))
class Scene:
    """Physical input of a simulation.

    Attributes:
        terrain: Elevation of the ground.
        vents: Vents; may be empty.
        lava: Material constants; default: ``materials.default_lava()``.
        ambient_temperature: Temperature of the air [K].
        gravity: Acceleration of gravity [m/s2].
        uncertainty: Distributions from which the members of an ensemble draw.
        emplaced_flows: Lava on the terrain at the start.
        events: Changes of the ground in order of time, starting at or after time 0.
        onset: Date and time of time 0, with a time zone; None if it is unknown.

    Numbers of the surroundings that only one effect uses are declared in the file of the effect.
    """

    terrain: Terrain
    vents: tuple[Vent, ...] = ()
    lava: Lava = field(default_factory=default_lava)
    ambient_temperature: float = number(300.0, 'Temperature of the air', 100.0, 600.0, 'K')
    # from a small moon to a star
    gravity: float = number(9.81, 'Acceleration of gravity', 1e-3, 1e3, 'm/s2')
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    emplaced_flows: tuple[EmplacedFlow, ...] = ()
    events: tuple[TerrainEvent, ...] = ()
    onset: datetime | None = None

    def __post_init__(self) -> None:
        """Validate the parts and their combinations; raise LavaError for an invalid one."""
        kinds = (('terrain', Terrain), ('lava', Lava), ('uncertainty', Uncertainty))
        for name, kind in kinds:
            if not isinstance(getattr(self, name), kind):
                raise LavaError(f'scene.{name}', getattr(self, name), f'a {kind.__name__}')
        for name, part in (('emplaced_flows', EmplacedFlow), ('events', TerrainEvent)):
            items = getattr(self, name)
            if not isinstance(items, list | tuple) or not all(
                isinstance(item, part) for item in items
            ):
                raise LavaError(f'scene.{name}', items, f'a list of {part.__name__}')
            object.__setattr__(self, name, tuple(items))
        onset = self.onset
        if onset is not None and not (isinstance(onset, datetime) and onset.tzinfo):
            raise LavaError('scene.onset', onset, 'a date and time with a time zone, or None')
        vents = check_vents(self.vents, self.terrain, self.lava)
        object.__setattr__(self, 'vents', vents)
        if self.uncertainty.yield_strength is not None and 'yielding' not in possible(self.lava):
            name, reason = 'uncertainty.yield_strength', 'because lava.yield_strength is 0'
            raise validation.surplus(name, reason)
        for index, vent in enumerate(self.vents):
            self._check_temperature(f'vents[{index}]', vent.temperature)
        flows, hot = list(self.emplaced_flows), self.lava.reference_temperature
        for index, flow in enumerate(flows):
            temperature = hot if flow.temperature is None else flow.temperature
            self._check_temperature(f'emplaced_flows[{index}]', temperature)
            flows[index] = replace(flow, temperature=temperature)
        object.__setattr__(self, 'emplaced_flows', tuple(flows))
        events = list(self.events)
        for index, event in enumerate(events):
            least = self.events[index - 1].time if index else 0.0
            validation.number(f'events[{index}].time', event.time, at_least=least, unit='s')
            if event.terrain is not None:
                check_same_grid(f'events[{index}].terrain', event.terrain, self.terrain)
                ground = event.terrain
                if ground.sea_level != self.terrain.sea_level:
                    # the sea stays at its level
                    ground = replace(ground, sea_level=self.terrain.sea_level)
                    events[index] = replace(event, terrain=ground)
                check_vents(self.vents, ground, self.lava)
        object.__setattr__(self, 'events', tuple(events))
        check_fields('scene', self)

    def _check_temperature(self, name: str, temperature: float) -> None:
        """Raise LavaError if lava of a temperature is solid or too viscous to erupt."""
        if temperature <= self.lava.solidus:
            expected = f'above lava.solidus, {self.lava.solidus:g} K: colder lava is solid'
            expected += f' ({temperature:g} Celsius are {temperature + KELVIN:g} K)'
            raise LavaError(f'{name}.temperature', temperature, expected)
        viscosity = self.lava.viscosity_at(temperature)
        if viscosity > MAX_VENT_VISCOSITY:
            expected = f'hotter lava: the viscosity is {viscosity:.3g} Pa s here, and lava above '
            expected += f'{MAX_VENT_VISCOSITY:g} Pa s cannot erupt'
            raise LavaError(f'{name}.temperature', temperature, expected)

    def on(self, change: Callable[[Terrain], Terrain]) -> 'Scene':
        """Return the scene with a change, such as refinement, of each of its terrains."""
        return replace(
            self,
            terrain=change(self.terrain),
            events=tuple(
                replace(event, terrain=event.terrain and change(event.terrain))
                for event in self.events
            ),
        )


#: Fields of ``Scene`` that are numbers of the surroundings.
ENVIRONMENT = tuple(item.name for item in fields(Scene) if 'limits' in item.metadata)

#: Keys of a scene in a file.
SCENE_KEYS = (
    'terrain', 'vents', 'lava', 'uncertainty', 'emplaced_flows', 'events', 'onset', 'insist',
    *ENVIRONMENT,
)


def suspicious_temperatures(scene: Scene, *, is_celsius: bool = False) -> list[str]:
    """Describe the vents whose temperature is probably in the wrong unit, Celsius or kelvin.

    In the other unit it would be closer to the temperature at which the lava's constants hold.
    ``is_celsius`` is True if temperatures were given in Celsius, as in messages.
    """
    lava = scene.lava
    name = 'liquidus' if lava.is_vft else 'reference_temperature'
    usual = getattr(lava, name)
    shift, unit, other = (-KELVIN, 'Celsius', 'K') if is_celsius else (KELVIN, 'K', 'Celsius')
    result = []
    for index, vent in enumerate(scene.vents):
        read, away = vent.temperature + shift, vent.temperature - usual
        if abs(read - usual) < abs(away):
            given, meant = vent.temperature + min(shift, 0.0), read + min(shift, 0.0)
            result.append(
                f'vents[{index}].temperature is {given:g} {unit}, {abs(away):.0f} K '
                f'{"below" if away < 0.0 else "above"} lava.{name}: '
                f'{given:g} {other} would be {meant:g} {unit}'
            )
    return result


def constants_of(scene: Scene | None) -> dict[str, Any]:
    """Return the lava and surroundings of a scene by field name; without a scene, the defaults."""
    if scene is None:
        numbers = {item.name: item.default for item in fields(Scene) if item.name in ENVIRONMENT}
        return {'lava': default_lava(), **numbers}
    return {name: getattr(scene, name) for name in ('lava', *ENVIRONMENT)}


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """Return plain data that describes a scene without its elevation, for logs and bags."""
    terrain = scene.terrain
    barriers = [[list(place) for place in crest] for crest in terrain.barriers]
    return {
        'terrain': {
            'shape': list(terrain.shape),
            'resolution': terrain.resolution,
            'origin': list(terrain.origin),
            'epsg': terrain.epsg,
            'offset': list(terrain.offset),
            **({'source': terrain.source} if terrain.source else {}),
            **({'barriers': barriers} if barriers else {}),
            **({'wkt': terrain.wkt} if terrain.wkt else {}),
            **({} if terrain.sea_level is None else {'sea_level': terrain.sea_level}),
        },
        'vents': [
            {name: value for name, value in asdict(vent).items() if value not in (None, '')}
            for vent in scene.vents
        ],
        'lava': asdict(scene.lava),
        **{name: getattr(scene, name) for name in ENVIRONMENT},
        'uncertainty': uncertainty_to_dict(scene.uncertainty),
        **({'emplaced_flows': [flow_to_dict(item) for item in scene.emplaced_flows]}
           if scene.emplaced_flows else {}),
        **({'events': [event_to_dict(item) for item in scene.events]} if scene.events else {}),
        **({'onset': date_text(scene.onset)} if scene.onset else {}),
    }


def date_text(date: datetime) -> str:
    """Format a date in ISO 8601, with Z for UTC."""
    return date.isoformat().replace('+00:00', 'Z')


def onset_from(label: str, known: Mapping[str, Any]) -> datetime | None:
    """Return the ``onset`` of plain data; None without one.

    Raises:
        LavaError: If it is not a date. The error names ``label``.
    """
    text = known.get('onset')
    return None if text is None else date_in_utc(f'{label}.onset', text)


def scene_from_yaml(path: str | Path, *, terrain: Terrain | None = None) -> Scene:
    """Read a scene file; ``terrain`` replaces that of the file. Errors are those of both steps."""
    return scene_from_dict(*read_scene(path, terrain=terrain))


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
    known_keys = [*SCENE_KEYS, 'material']
    data = validation.keys('scene', read_yaml('scene', path), allowed=known_keys)
    data = with_material_in_lava('scene', data)
    ground = data.pop('terrain', None)
    insist = validation.flag('scene.insist', data.get('insist', False))
    if terrain is None:
        known: dict[str, Any] = validation.keys(
            'scene.terrain',
            ground,
            allowed=['file', *TERRAIN_OPTIONS],
            required=['file'],
        )
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
    data, terrain = with_changes(data, path.parent, terrain, options or {})
    return _with_rates(data, path.parent), terrain


def with_changes(
    data: dict[str, Any], folder: Path, terrain: Terrain, options: Mapping[str, Any],
    *, prefix: str = 'scene.',
) -> tuple[dict[str, Any], Terrain]:
    """Replace emplaced flows and events by the contents of their files.

    Args:
        data: Plain data of a scene.
        folder: Folder to which file names are relative.
        terrain: Terrain before the flows.
        options: Options of ``load_terrain`` for the files of events.
        prefix: Prefix of the keys in errors.

    Returns:
        Data for ``scene_from_dict``, and the terrain raised by flows that are ground.

    Raises:
        LavaError: If a file or a value cannot be used.
    """
    data = dict(data)
    if 'emplaced_flows' in data:
        terrain, data['emplaced_flows'] = read_flows(
            f'{prefix}emplaced_flows', data['emplaced_flows'], folder, terrain
        )
    if 'events' in data:
        # the grid of an event has to be that of the terrain
        read = partial(load_terrain, **{**options, 'offset': terrain.offset})
        data['events'] = read_events(f'{prefix}events', data['events'], folder, terrain, read)
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
        options = validation.build(Options, label, rest)
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


def scene_from_dict(data: Mapping[str, Any], terrain: Terrain) -> Scene:
    """Build a scene from the plain data of a YAML file.

    Args:
        data: Mapping with any of ``vents``, ``lava`` (as for ``materials.lava_from_dict``),
            ``ambient_temperature``, ``gravity``, ``uncertainty``, and ``emplaced_flows`` and
            ``events`` as returned by ``with_changes``, ``insist``, True to accept numbers that
            cannot be, and ``rate_error``, the distribution of a
            factor on all effusion rates unless ``uncertainty`` has one or takes them as exact.
            The material of the lava is that of the uncertainty, unless this names another.
        terrain: Terrain of the scene.

    Raises:
        LavaError: If a field is not valid, or a number cannot be.
    """
    lava, material = lava_from_dict('scene.lava', data.get('lava', {}))
    uncertain = uncertainty_of(data.get('uncertainty', {}), material, data.get('rate_error'))
    scene = Scene(
        terrain=terrain,
        vents=vents_from_list(data.get('vents', []), terrain),
        lava=lava,
        uncertainty=uncertain,
        emplaced_flows=tuple(data.get('emplaced_flows', ())),
        events=tuple(data.get('events', ())),
        onset=onset_from('scene', data),
        **{name: data[name] for name in ENVIRONMENT if name in data},
    )
    check_plausible(scene, insist=validation.flag('scene.insist', data.get('insist', False)))
    return scene


def uncertainty_of(
    data: object, material: Material, rate_error: Distribution | None
) -> Uncertainty:
    """Read the uncertainty of a scene or case of a material.

    Args:
        data: Plain data for ``uncertainty_from_dict``.
        material: Material of the lava, whose ranges are those of quantities that are left open.
        rate_error: Error of the effusion rates, used unless the data have another.

    Raises:
        LavaError: If the data are not valid.
    """
    found = uncertainty_from_dict(data)
    if found.discharge is None and not found.is_exact('effusion_rate') and not found.eruption:
        found = replace(found, discharge=rate_error)
    if not found.material:
        found = replace(found, material=material.name)
    return replace(found, material=material_named(found.material).name)


def check_plausible(scene: Scene, *, insist: bool = False) -> None:
    """Log a warning for each number that is hard to believe, with the likely slip.

    Raises:
        LavaError: If a number cannot be, unless the user insists.
    """
    for text in suspicious_temperatures(scene):
        _LOG.warning(text)
    report(doubts_of_scene(scene), insist=insist)
