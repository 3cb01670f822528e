# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenes of the members of an ensemble: the common scene with each member's drawn values."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
import math
from typing import Any

from lava_ros.effects import possible
from lava_ros.errors import LavaError
from lava_ros.forecast.sampling import Member, rough_terrain
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.distributions import Displacement, Distribution, Roughness
from lava_ros.scene.lava import Lava
from lava_ros.scene.uncertainty import CONSTANTS
from lava_ros.scene.vents import erupting

#: Maximum number of times that a displacement is halved before the vent is not displaced.
_HALVINGS = 12


def member_scene(scene: Scene, member: Member, *, rough: bool = True) -> Scene:
    """Return the scene of a member.

    ``rough`` adds the errors of the terrain, which is slow. A displacement that would move a vent
    off the terrain is halved until it does not.

    Raises:
        LavaError: If the drawn values do not make a valid scene; the message names the member.
    """
    try:
        roughness = scene.uncertainty.terrain
        if rough and roughness is not None:
            scene = scene.on(lambda terrain: rough_terrain(terrain, roughness, member.seed))
        vents = scene.vents
        if member.eruption is not None:
            vents = erupting(vents, duration=member.eruption[0], volume=member.eruption[1])
        vents = tuple(_member_vent(vent, member, scene.terrain) for vent in vents)
        return replace(scene, vents=vents, lava=_member_lava(scene.lava, member))
    except LavaError as error:
        expected = f'{error.expected}; limit its distribution to such values'
        field = f'{error.field} of member {member.index}'
        raise type(error)(field, error.value, expected) from error


def median_scene(scene: Scene) -> Scene:
    """Return the scene with every uncertain value at its median, except classes of eruptions."""
    uncertainty = scene.uncertainty
    drawn: dict[str, Any] = {
        name: distribution.quantile(0.5)
        for name, distribution in vars(uncertainty).items()
        if isinstance(distribution, Distribution)
    }
    constants = tuple((key, item.quantile(0.5)) for key, item in uncertainty.constants.items())
    return member_scene(scene, Member(0, **drawn, constants=constants), rough=False)


def end_scenes(scene: Scene) -> list[Scene]:
    """Return scenes with one uncertain quantity each at a quantile of 0.1 or 0.9.

    Effects are chosen for these. An effect that only fewer members need would slow down all
    members. It matters little to those few, because effects do not set in abruptly.

    Raises:
        LavaError: If the values do not make a valid scene.
    """
    uncertainty, drawn = scene.uncertainty, list[dict[str, Any]]()
    for fraction in (0.1, 0.9):
        for name, distribution in vars(uncertainty).items():
            if isinstance(distribution, Distribution):
                drawn.append({name: distribution.quantile(fraction)})
        for name, distribution in uncertainty.constants.items():
            drawn.append({'constants': ((name, distribution.quantile(fraction)),)})
        for kind in uncertainty.eruption:
            ends = kind.duration.quantile(fraction), kind.volume.quantile(fraction)
            drawn.append({'eruption': ends})
    return [member_scene(scene, Member(0, **values), rough=False) for values in drawn]


def changes_of(scene: Scene) -> dict[str, tuple[Member, Member]]:
    """Return members that differ in one quantity, at its quantiles of 0.1 and 0.9, by its name.

    Quantities that follow it change with it. For places the change is a displacement along x; for
    the terrain it is a member without and a member with errors.

    Args:
        scene: The scene with its ranges.
    """
    drawn, result = scene.uncertainty.drawn, dict[str, tuple[Member, Member]]()
    for name, item in drawn.items():
        if isinstance(item, Roughness):
            result[name] = Member(0), Member(0, seed=(0, 1))
        elif isinstance(item, Displacement):
            # the quantile of x in a disc with uniform density
            reach = 1.2815515655 * item.deviation or 0.6870 * item.radius
            result[name] = _displaced_by(-reach), _displaced_by(reach)
        elif not item.follows:
            result[name] = _at(drawn, name, 0.1), _at(drawn, name, 0.9)
    return result


def _displaced_by(reach: float) -> Member:
    return Member(0, displacement=(reach, 0.0))


def _at(drawn: Mapping[str, Any], name: str, share: float) -> Member:
    """Return a member with a quantity, and those that follow it, at a quantile."""
    values, constants = dict[str, Any](), []
    for key, item in drawn.items():
        if key != name and getattr(item, 'follows', '').removeprefix('-') != name:
            continue
        is_opposite = key != name and item.follows.startswith('-')
        value = item.quantile(1.0 - share if is_opposite else share)
        if key in CONSTANTS:
            constants.append((key, value))
        else:
            values['discharge' if key == 'effusion_rate' else key] = value
    return Member(0, constants=tuple(constants), **values)


def check_members(scene: Scene, members: Sequence[Member]) -> None:
    """Check the scenes of members before any of them runs.

    Raises:
        LavaError: If a scene is not valid, or members have places and the scene does not have
            exactly one vent.
    """
    if not scene.vents and not scene.emplaced_flows:
        raise LavaError('scene.vents', [], 'a vent: without lava there is nothing to forecast')
    if any(member.place is not None for member in members) and len(scene.vents) != 1:
        expected = 'one vent with a susceptibility map: the vent defines '
        expected += 'the effusion rate, the map its position'
        raise LavaError('scene.vents', len(scene.vents), expected)
    for member in members:
        member_scene(scene, member, rough=False)


def _member_lava(lava: Lava, member: Member) -> Lava:
    if member.constants:
        lava = replace(lava, **dict(member.constants))
    drawn = {'viscosity': lava.viscosity * member.viscosity}
    if lava.is_vft:
        drawn = {'vft_a': lava.vft_a + math.log10(member.viscosity)}
    if 'yielding' in possible(lava):
        drawn['yield_strength'] = lava.yield_strength * member.yield_strength
    return replace(lava, **drawn)


def _member_vent(vent: Vent, member: Member, terrain: Terrain) -> Vent:
    discharge: float | tuple[tuple[float, float], ...]
    if isinstance(vent.discharge, float):
        discharge = vent.discharge * member.discharge
    else:
        discharge = tuple((time, flux * member.discharge) for time, flux in vent.series)
    vent = replace(vent, discharge=discharge, temperature=vent.temperature + member.temperature)
    if member.place is not None:
        vent = _placed(vent, member.place, terrain)
    return _displaced(vent, member.displacement, terrain)


def _placed(vent: Vent, place: tuple[float, float], terrain: Terrain) -> Vent:
    """Move a vent's centre to a place; a fissure is shortened to fit on the terrain."""
    if vent.end is None:
        return replace(vent, position=place)
    half = [0.5 * (end - start) for start, end in zip(vent.position, vent.end, strict=True)]
    for _ in range(_HALVINGS):
        ends = [
            (place[0] + sign * half[0], place[1] + sign * half[1]) for sign in (-1.0, 1.0)
        ]
        if all(terrain.covers(*end) for end in ends):
            return replace(vent, position=ends[0], end=ends[1])
        half = [0.5 * value for value in half]
    return replace(vent, position=place, end=None)


def _displaced(vent: Vent, shift: tuple[float, float], terrain: Terrain) -> Vent:
    if not any(shift):
        return vent
    for halving in range(_HALVINGS):
        dx, dy = (0.5**halving * value for value in shift)
        position = (vent.position[0] + dx, vent.position[1] + dy)
        end = None if vent.end is None else (vent.end[0] + dx, vent.end[1] + dy)
        if terrain.covers(*position) and (end is None or terrain.covers(*end)):
            return replace(vent, position=position, end=end)
    return vent
