# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Usual distributions of the uncertain input that a scene neither gives nor fixes.

Constants of the lava and the temperature of the vents have the published ranges of the material,
with uniform values or, for ``LOGARITHMIC`` ones, logarithms. Effusion rates and the terrain have
the errors of their measurement (``measurements``), and vents an uncertain place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
import math
import re
from typing import Any, TYPE_CHECKING

from lava_ros.effects import EFFECTS, possible
from lava_ros.scene.distributions import Displacement, Distribution, Roughness
from lava_ros.scene.lava import constant_units, Lava
from lava_ros.scene.materials import ANY_BASALT, Constant, Material, material_named
from lava_ros.scene.measurements import RATE_ERRORS, usual_errors, USUAL_RATE
from lava_ros.scene.uncertainty import CONSTANTS, QUANTITIES

if TYPE_CHECKING:
    from lava_ros.scene.scene import Scene

#: Constants whose logarithm is distributed uniformly over a range.
LOGARITHMIC = ('viscosity', 'yield_strength', 'crust_strength')

#: Error of an eruption temperature without a published range [K].
THERMOMETER = Constant(
    10.0,
    'Helz, R. T. and Thornber, C. R. (1987). Geothermometry of Kilauea Iki lava lake, Hawaii. '
    'Bulletin of Volcanology 49, 651-668: 10 K',
)

#: Maximum radius of the disc in which a vent lies [m]: a vent is mapped to about its own size, and
#: at least to a pixel.
PIXEL = Constant(
    30.0, 'the size of the vent, at most a pixel of the thermal images of Landsat and ASTER'
)

#: Minimum difference of the temperature of erupting lava from the solidus [K].
ABOVE_SOLIDUS = 1.0

#: Reason for which a quantity is not drawn.
FIXED, UNPUBLISHED = 'fixed by the user', 'no published range'

#: Constants of the lava that define a law or are not measured: their error is that of others.
_LAWS = ('reference_temperature', 'vft_a', 'vft_b', 'vft_c')

_LIMITS = {
    item.name: item.metadata['limits'] for item in fields(Lava) if 'limits' in item.metadata
}

#: Effect to which a constant of the lava belongs.
_OWNERS = {key: name for name, effect in EFFECTS.items() for key in effect.constants}

#: A distribution, or the reason for which there is none.
Found = Distribution | Displacement | Roughness | str


def with_ranges(scene: Scene) -> Scene:
    """Return the scene with the usual distribution of each quantity that it leaves open.

    A scene whose uncertainty has no material is returned unchanged.
    """
    found = {name: item for name, item in _usual(scene).items() if not isinstance(item, str)}
    if not found:
        return scene
    known, values = scene.uncertainty, dict[str, Any]()
    constants = dict(known.constants)
    for name, item in found.items():
        if name in CONSTANTS and isinstance(item, Distribution):
            constants[name] = item
        else:
            values['discharge' if name == 'effusion_rate' else name] = item
    return replace(scene, uncertainty=replace(known, constants=constants, **values))


def exact_quantities(scene: Scene) -> dict[str, str]:
    """Return the quantities that are not drawn, with the reason."""
    if not scene.uncertainty.material:
        given = scene.uncertainty.drawn
        return {name: FIXED for name in QUANTITIES if name not in given and name not in CONSTANTS}
    return {name: item for name, item in _usual(scene).items() if isinstance(item, str)}


def describe_inputs(scene: Scene) -> dict[str, Any]:
    """Return the drawn and the exact quantities of a scene as plain data.

    ``drawn`` has ``distribution``, a text, and ``source`` by quantity, and ``exact`` the reason by
    quantity. Classes of eruptions have their names in ``distribution``.
    """
    whole = with_ranges(scene)
    units = {**constant_units(), 'temperature': 'K'}
    drawn = {}
    for name, item in whole.uncertainty.drawn.items():
        text = item.text()
        if isinstance(item, Distribution):
            text = item.text(units[name]) if name in CONSTANTS or name == 'temperature' else (
                f'times {text}'
            )
            leader = item.follows.removeprefix('-')
            if leader:
                order = 'opposite to' if item.follows.startswith('-') else 'with'
                text += f', {order} {leader.replace("_", " ")}'
        drawn[name] = {'distribution': text, 'source': item.source or 'given by the scene'}
    if scene.uncertainty.eruption:
        names = [item.name or 'without a name' for item in scene.uncertainty.eruption]
        drawn['eruption'] = {
            'distribution': f'classes: {", ".join(names)}', 'source': 'given by the scene'
        }
    return {'drawn': drawn, 'exact': exact_quantities(whole)}


def short_citation(source: str) -> str:
    """Return author and year of the first reference in a source, or the source without one."""
    found = re.search(r"([A-Z][\w-]+)(?:, [A-Z]\.[^()]*)? \((\d{4})\)", source)
    return f'{found[1]} {found[2]}' if found else source


def _usual(scene: Scene) -> dict[str, Found]:
    """Return the usual distribution of each quantity without one, or the reason for none."""
    known = scene.uncertainty
    if not known.material:
        return {}
    material, found = material_named(known.material), dict[str, Found]()
    constants = [
        name for name in CONSTANTS if name in material.constants and name not in _LAWS
    ]
    for name in ('effusion_rate', 'temperature', 'viscosity', 'yield_strength', 'position',
                 'terrain', *constants):
        if known.is_exact(name):
            found[name] = FIXED
        elif known.distribution_of(name) is None:
            find = _FINDERS.get(name)
            found[name] = find(scene, material) if find else _constant(name, scene, material)
    leaders = {
        name for name, item in {**known.drawn, **found}.items()
        if isinstance(item, Distribution) and not item.follows
    }
    for name, item in found.items():
        if isinstance(item, Distribution) and item.follows.removeprefix('-') not in leaders:
            found[name] = replace(item, follows='')
    return found


def _rate(scene: Scene, _: Material) -> Found:
    if not scene.vents:
        return 'no vents'
    if scene.uncertainty.eruption:
        return 'the classes of eruptions have volumes'
    usual = RATE_ERRORS[USUAL_RATE]
    return replace(usual, source=f'method not stated, as {usual.source}')


def _temperature(scene: Scene, material: Material) -> Found:
    """Return the offset of the temperature, which keeps all vents above the solidus."""
    temperatures = [vent.temperature for vent in scene.vents]
    if not temperatures:
        return 'no vents'
    hottest, usual = max(temperatures), material.vent_temperature
    if usual.range is None:
        low, high = hottest - THERMOMETER.value, hottest + THERMOMETER.value  # type: ignore[operator]
        source = THERMOMETER.source
    else:
        low, high = span_of(usual.range, hottest, is_log=False)
        source = _cited(usual, material, 'K')
    coldest = min(temperatures)
    low = max(low, hottest - coldest + scene.lava.solidus + ABOVE_SOLIDUS)
    if not low < high:
        return 'the lava is close to its solidus'
    return Distribution('uniform', (low - hottest, high - hottest), source=source)


def _position(scene: Scene, _: Material) -> Found:
    if not scene.vents:
        return 'no vents'
    radius = max(vent.radius for vent in scene.vents)
    return Displacement(radius=min(radius, float(PIXEL.value)), source=PIXEL.source)


def _terrain(scene: Scene, _: Material) -> Found:
    terrain = scene.terrain
    if not terrain.has_system:
        return 'no coordinate system, so no survey with known errors'
    found, reason = usual_errors(terrain.source, terrain.resolution)
    return replace(found, source=f'survey {reason}: {found.source}')


def _viscosity(scene: Scene, material: Material) -> Found:
    """Return the factor on the viscosity; of a VFT law by the range of its constant A."""
    lava = scene.lava
    if not lava.is_vft:
        return _factor('viscosity', scene, material)
    if 'vft_a' not in material.constants:
        # a law that the scene gives
        material = material_named(ANY_BASALT)
    usual = material.constants['vft_a']
    if usual.range is None:
        return UNPUBLISHED
    low, high = (10.0 ** (value - float(usual.value)) for value in usual.range)
    source = _cited(usual, material, '', 'the logarithm of the viscosity')
    return Distribution('loguniform', (low, high), source=source)


def _yield_strength(scene: Scene, material: Material) -> Found:
    if 'yielding' not in possible(scene.lava):
        return 'the lava has none'
    return _factor('yield_strength', scene, material)


def _factor(name: str, scene: Scene, material: Material) -> Found:
    found, value = _constant(name, scene, material), getattr(scene.lava, name)
    if not isinstance(found, Distribution):
        return found
    return replace(found, numbers=tuple(end / value for end in found.numbers))


def _constant(name: str, scene: Scene, material: Material) -> Found:
    """Return the distribution of a constant of the lava."""
    usual, value = material.constants.get(name), getattr(scene.lava, name)
    if usual is None or usual.range is None:
        return UNPUBLISHED
    if not value and usual.range[0] > 0.0:
        # a value of 0 switches an effect off
        return '0 in the scene'
    if _OWNERS.get(name, name) not in (name, *possible(scene.lava)):
        return 'without effect in this lava'
    is_log = name in LOGARITHMIC
    low, high = span_of(usual.range, value, is_log=is_log)
    low, high = max(low, _LIMITS[name][0]), min(high, _LIMITS[name][1])
    if not low < high:
        return 'at the end of its possible values'
    source = _cited(usual, material, constant_units()[name])
    if not usual.range[0] <= value <= usual.range[1]:
        source = f'as wide as the {source}, about the value of the scene'
    kind = 'loguniform' if is_log else 'uniform'
    return Distribution(kind, (low, high), source=source, follows=usual.follows)


def span_of(
    published: tuple[float, float], value: float, *, is_log: bool
) -> tuple[float, float]:
    """Return the published range or, if the value is outside of it, one as wide about it."""
    low, high = published
    if low <= value <= high:
        return published
    if is_log:
        half = math.sqrt(high / low)
        return value / half, value * half
    half = 0.5 * (high - low)
    return value - half, value + half


def _cited(usual: Constant, material: Material, unit: str, of: str = '') -> str:
    assert usual.range is not None
    span = '{:g} to {:g}'.format(*usual.range) + (f' {unit}' if unit else '')
    what = f'published range of {of + " of " if of else ""}{material.name}'
    return f'{what}, {span}: {usual.range_source}'


_FINDERS: Mapping[str, Callable[[Scene, Material], Found]] = {
    'effusion_rate': _rate,
    'temperature': _temperature,
    'viscosity': _viscosity,
    'yield_strength': _yield_strength,
    'position': _position,
    'terrain': _terrain,
}
