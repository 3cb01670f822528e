# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenes, and their files: terrain, vents, lava, surroundings, and what is uncertain."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
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
from lava_ros.scene.effusion_rates import (
    error_of_rates,
    Interval,
    options_from_dict,
    read_effusion_rates,
    series_of_rates,
)
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import default_lava, lava_from_dict, with_material_in_lava
from lava_ros.scene.terrain import Terrain
from lava_ros.scene.terrain_files import load_terrain, TERRAIN_OPTIONS, terrain_path
from lava_ros.scene.uncertainty import Uncertainty, uncertainty_from_dict, uncertainty_to_dict
from lava_ros.scene.vents import check_vents, Vent, vents_from_list

_LOG = logging.getLogger(__name__)

#: Largest viscosity of lava that comes out of a vent [Pa s], crystals included.
MAX_VENT_VISCOSITY = 1e15

#: Accelerations of gravity there can be [m/s2]: from a small moon to a star.
GRAVITY_RANGE = (1e-3, 1e3)

#: 0 Celsius [K].
KELVIN = 273.15


@dataclass(frozen=True, eq=False)
@with_fields(partial(join_names, 'environment', EFFECTS))
class Scene:
    """Everything a simulation needs to know about the world.

    Attributes:
        terrain: The ground.
        vents: Where lava comes out; may be empty.
        lava: The material, ``materials.default_lava()`` where none is given.
        ambient_temperature: Temperature of the air [K].
        gravity: Acceleration of gravity [m/s2].
        uncertainty: What differs from member to member of an ensemble.

    Numbers of the surroundings that only one effect takes are declared in its file.
    """

    terrain: Terrain
    vents: tuple[Vent, ...] = ()
    lava: Lava = field(default_factory=default_lava)
    ambient_temperature: float = number(300.0, 'Temperature of the air', 100.0, 600.0, 'K')
    gravity: float = number(9.81, 'Acceleration of gravity', *GRAVITY_RANGE, 'm/s2')
    uncertainty: Uncertainty = field(default_factory=Uncertainty)

    def __post_init__(self) -> None:
        """Validate the parts together.

        LavaError where a part is of the wrong kind, a vent is not on the terrain, or its lava is
        solid.
        """
        kinds = (('terrain', Terrain), ('lava', Lava), ('uncertainty', Uncertainty))
        for name, kind in kinds:
            if not isinstance(getattr(self, name), kind):
                raise LavaError(f'scene.{name}', getattr(self, name), f'a {kind.__name__}')
        vents = check_vents(self.vents, self.terrain, self.lava)
        object.__setattr__(self, 'vents', vents)
        if self.uncertainty.yield_strength is not None and 'yielding' not in possible(self.lava):
            right = 'absent: lava.yield_strength is 0'
            raise LavaError('uncertainty.yield_strength', self.uncertainty.yield_strength, right)
        for index, vent in enumerate(self.vents):
            if vent.temperature <= self.lava.solidus:
                right = f'above lava.solidus, {self.lava.solidus:g} K: colder lava is solid'
                right += f' ({vent.temperature:g} Celsius are {vent.temperature + KELVIN:g} K)'
                raise LavaError(f'vents[{index}].temperature', vent.temperature, right)
            viscosity = self.lava.viscosity_at(vent.temperature)
            if viscosity > MAX_VENT_VISCOSITY:
                right = f'hotter lava: at this temperature its viscosity is {viscosity:.3g} Pa s, '
                right += f'above {MAX_VENT_VISCOSITY:g} Pa s nothing comes out'
                raise LavaError(f'vents[{index}].temperature', vent.temperature, right)
        check_fields('scene', self)


#: Fields of ``Scene`` that are numbers of the surroundings.
ENVIRONMENT = tuple(item.name for item in fields(Scene) if 'limits' in item.metadata)

#: Keys of a scene in a file.
SCENE_KEYS = ('terrain', 'vents', 'lava', 'uncertainty', *ENVIRONMENT)


def temperature_doubts(scene: Scene, *, is_celsius: bool = False) -> list[str]:
    """Describe vents whose temperature seems to be in the wrong unit, Celsius or kelvin.

    In the other unit it would be closer to the temperature for which the lava's constants hold.
    ``is_celsius`` says that temperatures were given in Celsius, as in messages, not in kelvin.
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
    """Lava and surroundings of a scene by the names of its fields; without one the usual."""
    if scene is None:
        numbers = {item.name: item.default for item in fields(Scene) if item.name in ENVIRONMENT}
        return {'lava': default_lava(), **numbers}
    return {name: getattr(scene, name) for name in ('lava', *ENVIRONMENT)}


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """Plain data that describes a scene, the elevation itself left out: for logs and bags."""
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
        },
        'vents': [
            {name: value for name, value in asdict(vent).items() if value not in (None, '')}
            for vent in scene.vents
        ],
        'lava': asdict(scene.lava),
        **{name: getattr(scene, name) for name in ENVIRONMENT},
        'uncertainty': uncertainty_to_dict(scene.uncertainty),
    }


def scene_from_yaml(path: str | Path, *, terrain: Terrain | None = None) -> Scene:
    """Read a scene file; ``terrain`` replaces the file's own. LavaError names what is wrong."""
    return scene_from_dict(*read_scene(path, terrain=terrain))


def read_scene(
    path: str | Path, *, terrain: Terrain | None = None, options: Mapping[str, Any] | None = None
) -> tuple[dict[str, Any], Terrain]:
    """Read a scene file without making a scene of it: what ``scene_from_dict`` takes.

    A name for which there is no file is looked for in the package's ``examples/``.

    In the file, the ``effusion_rate`` of a vent may be a mapping: ``file``, a table relative to
    the scene file, and the fields of ``effusion_rates.Options``. The errors of such tables are the
    uncertainty of the effusion rate unless the file has one.

    The file has the keys of ``scene_from_dict`` and ``terrain``, a mapping: ``file``, relative to
    the scene file or ``st_helens.npz`` of the package, and the options of
    ``terrain_files.load_terrain``. Ground in ``terrain`` replaces the file's own; ``options`` of
    ``load_terrain`` replace those of the file. LavaError where the file cannot be read, or has
    other keys, or its ground is not usable.
    """
    path = find_file(path, 'examples', field='scene', expected='a readable YAML file')
    known_keys = [*SCENE_KEYS, 'material']
    data = validation.keys('scene', read_yaml('scene', path), allowed=known_keys)
    data = with_material_in_lava('scene', data)
    ground = data.pop('terrain', None)
    if terrain is None:
        known: dict[str, Any] = validation.keys(
            'scene.terrain',
            ground,
            allowed=['file', *TERRAIN_OPTIONS],
            required=['file'],
        )
        name = known.pop('file')
        if not isinstance(name, str):
            raise LavaError('scene.terrain.file', name, 'the name of a file, text')
        terrain = load_terrain(terrain_path(name, path.parent), **known | dict(options or {}))
    return _with_rates(data, path.parent), terrain


def _with_rates(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Replace the tables of effusion rates of a scene by what they hold, and use their errors."""
    vents = data.get('vents')
    read: list[Interval] = []
    if not isinstance(vents, list):
        return data
    vents = list(vents)
    for index, vent in enumerate(vents):
        rate = vent.get('effusion_rate') if isinstance(vent, Mapping) else None
        if not isinstance(rate, Mapping):
            continue
        label = f'vents[{index}].effusion_rate'
        name = rate.get('file')
        if not isinstance(name, str):
            raise LavaError(f'{label}.file', name, 'the name of a table')
        rest = {key: value for key, value in rate.items() if key != 'file'}
        rates = read_effusion_rates(label, folder / name, options_from_dict(label, rest))
        read += rates
        vents[index] = {**vent, 'effusion_rate': series_of_rates(rates)}
    error, uncertain = error_of_rates(read), data.get('uncertainty', {})
    data = {**data, 'vents': vents}
    if error is not None and isinstance(uncertain, Mapping) and not (
        {'discharge', 'effusion_rate'} & uncertain.keys()
    ):
        known = uncertainty_to_dict(Uncertainty(discharge=error))
        data['uncertainty'] = {**uncertain, **known}
    return data


def scene_from_dict(data: Mapping[str, Any], terrain: Terrain) -> Scene:
    """Build a scene from the plain data of a YAML file; LavaError names a field that is wrong.

    They are ``vents``, ``lava`` (fields of ``Lava``, and maybe ``material``, a name of ``lava
    materials`` whose constants they replace; ``materials.DEFAULT`` where it is absent),
    ``ambient_temperature``, ``gravity`` and ``uncertainty``; all may be left out.
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
