# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Description of a recording in the ``custom_data`` of its bag."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
import math
from typing import Any

from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import LavaError
from lava_ros.files.yaml import parse_json, parse_yaml
from lava_ros.scene import Vent
from lava_ros.simulation.selection import Decision


def described(custom_data: Mapping[str, str]) -> dict[str, Any]:
    """Parse the node's description of a recording; a missing or malformed part is None.

    ``scene`` is the result of scene_to_dict, ``parameters`` the parameters of the node,
    ``effects`` the effects (texts that begin with ``on`` or ``off``) and the times of their
    changes, ``resumed_from`` the bag and time of the checkpoint from which the run was resumed,
    and ``topics`` the full names of the node's topics by the names in the layer files and in
    ROS.md.
    """
    found: dict[str, Any] = {}
    for name, (parse, is_valid) in _KNOWN.items():
        try:
            value = parse(name, custom_data.get(name, ''))
        except LavaError:
            value = None
        found[name] = value if is_valid(value) else None
    return found


def effects_on(description: Mapping[str, Any]) -> tuple[str, ...] | None:
    """Return the names of the effects that were on at the end, None if they are unknown.

    ``description`` is the result of ``described``.
    """
    if description['effects'] is None:
        return None
    states: dict[str, object] = {}
    for change in description['effects']:
        states |= change['effects']
    return tuple(name for name, text in states.items() if str(text).startswith('on'))


def effect_table(effects: Effects, decisions: Iterable[Decision]) -> dict[str, str]:
    """Return the state of each effect with the reason, such as ``on: slope = 0.82 > 0.12``."""
    decided = {item.name: item for item in decisions}
    return {
        name: f'{"on" if is_on else "off"}: {_reason(name, effects, decided.get(name))}'
        for name, is_on in asdict(effects).items()
    }


def is_on(text: str) -> bool:
    """Return True if a text of the table describes an active effect."""
    return text.startswith('on:')


def unused_velocities(vents: Iterable[Vent], table: Mapping[str, str]) -> list[str]:
    """Return a warning if vents have a velocity, and no effect of the table that is on uses it."""
    moving = [vent.name or 'a vent' for vent in vents if any(vent.velocity)]
    users = [name for name, effect in EFFECTS.items() if effect.needs_velocity and name in table]
    if not moving or any(is_on(table[name]) for name in users):
        return []
    reasons = ''.join(f': {name} is {table[name]}' for name in users)
    return [f'the velocity of {", ".join(moving)} has no effect{reasons}']


def _reason(name: str, effects: Effects, decision: Decision | None) -> str:
    if decision is None:
        return 'forced' if name in effects else 'never chosen automatically'
    is_needed = decision.value > decision.effect.threshold
    is_switched_on = not math.isnan(decision.since)
    is_fixed = decision.is_forced or bool(decision.formulation)
    if name in effects and not (is_needed or is_switched_on or is_fixed):
        return f'{decision.reason}, but an effect stays on during a run'
    return decision.reason


def _has(value: object, **types: Any) -> bool:
    return isinstance(value, dict) and all(
        isinstance(value.get(name), of) for name, of in types.items()
    )


def _are_changes(value: object) -> bool:
    return isinstance(value, list) and all(
        _has(entry, time=int | float, effects=dict) and math.isfinite(entry['time'])
        for entry in value
    )


def _are_names(value: object) -> bool:
    return isinstance(value, dict) and all(isinstance(item, str) for item in value.values())


#: Parser of each text of the description, and check of its result, by name.
_KNOWN: dict[str, tuple[Callable[[str, str], Any], Callable[[object], bool]]] = {
    'scene': (parse_yaml, _has),
    'parameters': (parse_yaml, _has),
    'effects': (parse_json, _are_changes),
    'topics': (parse_json, _are_names),
    'resumed_from': (parse_json, lambda value: _has(value, bag=str, time=int | float)),
}
