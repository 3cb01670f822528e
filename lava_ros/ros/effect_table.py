# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The table of effects that diagnostics and bags have: what is on or off, and why."""

from collections.abc import Iterable
from dataclasses import asdict

from lava_ros.choice import Decision
from lava_ros.effects import Effects


def effect_table(effects: Effects, decisions: Iterable[Decision]) -> dict[str, str]:
    """Say of every effect whether it is on, and why.

    Args:
        effects: What is on.
        decisions: What decided.

    Returns:
        Texts such as ``on: slope = 0.82 > 0.12`` by the name of the effect.
    """
    decided = {item.criterion.effect: item for item in decisions}
    return {
        name: f'{"on" if is_on else "off"}: {_reason(name, effects, decided.get(name))}'
        for name, is_on in asdict(effects).items()
    }


def is_on(text: str) -> bool:
    """Whether a text of the table says that the effect is on."""
    return text.startswith('on:')


def _reason(name: str, effects: Effects, decision: Decision | None) -> str:
    if decision is None:
        return 'forced' if getattr(effects, name) else 'never chosen, only forced'
    if decision.is_on == getattr(effects, name):
        return decision.reason
    return f'{decision.reason}, but what has frozen stays'
