# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenes: terrain, vents, lava, surroundings and uncertainty."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import datetime
from functools import cached_property, partial
from itertools import accumulate
import logging
from typing import Any

from lava_ros import validation
from lava_ros.effects import EFFECTS, possible
from lava_ros.effects.effect import check_fields, join_names, number, with_fields
from lava_ros.errors import LavaError
from lava_ros.scene.distributions import Distribution
from lava_ros.scene.emplaced import EmplacedFlow, flow_to_dict
from lava_ros.scene.events import check_same_grid, event_to_dict, TerrainEvent
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import (
    default_lava,
    lava_from_dict,
    Material,
    material_named,
)
from lava_ros.scene.plausibility import doubts_of_scene, KELVIN, report
from lava_ros.scene.terrain import Terrain
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
            if not getattr(temperature, 'has_unit', False):
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

    def ground_at(self, time: float) -> Terrain:
        """Return the ground of the maps of a simulated time [s].

        An event at that time changes the ground after the maps.
        """
        return self._grounds[sum(event.time < time for event in self.events)]

    @cached_property
    def _grounds(self) -> list[Terrain]:
        """The ground at the start, and after each event."""
        return list(accumulate(
            self.events, lambda ground, event: event.ground(ground), initial=self.terrain
        ))


#: Fields of ``Scene`` that are numbers of the surroundings.
ENVIRONMENT = tuple(item.name for item in fields(Scene) if 'limits' in item.metadata)


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
    return None if text is None else validation.date(f'{label}.onset', text)


def scene_from_dict(data: Mapping[str, Any], terrain: Terrain) -> Scene:
    """Build a scene from plain data, as ``scene_and_material`` does; return only the scene."""
    return scene_and_material(data, terrain)[0]


def scene_and_material(
    data: Mapping[str, Any], terrain: Terrain, *, label: str = 'scene'
) -> tuple[Scene, Material]:
    """Build a scene from the plain data of a YAML file.

    Args:
        data: Mapping with any of ``vents``, ``lava`` (as for ``materials.lava_from_dict``),
            ``ambient_temperature``, ``gravity``, ``uncertainty``, and ``emplaced_flows`` and
            ``events`` as returned by ``read_flows`` and ``read_events``, ``insist``, True to
            accept numbers that cannot be, and ``rate_error``, the distribution of a factor on all
            effusion rates unless ``uncertainty`` has one or takes them as exact.
            The material of the lava is that of the uncertainty, unless this names another.
        terrain: Terrain of the scene.
        label: Name of the data in errors.

    Returns:
        The scene, and the material of its lava with the composition that the data give.

    Raises:
        LavaError: If a field is not valid, or a number cannot be.
    """
    lava, material = lava_from_dict(f'{label}.lava', data.get('lava', {}))
    uncertain = uncertainty_of(data.get('uncertainty', {}), material, data.get('rate_error'))
    scene = Scene(
        terrain=terrain,
        vents=vents_from_list(data.get('vents', []), terrain),
        lava=lava,
        uncertainty=uncertain,
        emplaced_flows=tuple(data.get('emplaced_flows', ())),
        events=tuple(data.get('events', ())),
        onset=onset_from(label, data),
        **{name: data[name] for name in ENVIRONMENT if name in data},
    )
    check_plausible(scene, insist=validation.flag(f'{label}.insist', data.get('insist', False)))
    return scene, material


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
