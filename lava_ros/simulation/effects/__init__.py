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

"""The effects: one module each, named as in ``lava_ros.effects.Effects``, loaded when switched on.

A module holds the effect's equation, its device code and its launches. What a module may define,
and who calls it:

    viscosity(real)      mu(T) of the law            simulation/rheology.py
    stiffening(real, mu) mu(T) with more in the lava simulation/rheology.py
    speed(real, mu, ...) u of thickness and slope    simulation/rheology.py
    terms(real)          heat gained and lost        simulation/heat.py
    relaxed(real)        what a step makes of them   simulation/heat.py
    factor(real)         what scales the mobility    simulation/flow.py
    AfterStep            a pass at the step's end    simulation/simulation.py
"""

from importlib import import_module
from types import ModuleType

from lava_ros.effects import Effects

#: Effects that make a pass over the particles at the end of a step, in this order. Their class
#: ``AfterStep(scene, accuracy, terrain, state)`` has a method ``apply(state, neighbors)``, called
#: after the motion in every stage: its kernels return at once unless ``counts[IS_LAST]`` is 1, and
#: the step is ``clock[STEP]``. ``state.ordered`` holds the particles before the motion, and
#: ``state.particle`` the same ones in the same order after it. One with arrays of its own has
#: ``save() -> arrays by name`` and ``load(arrays)`` for checkpoints.
AFTER_STEP = ('conduction', 'solidification', 'merging')


def load(name: str) -> ModuleType:
    """Import the module of an effect."""
    return import_module(f'{__name__}.{name}')


def after_step(effects: Effects) -> dict[str, ModuleType]:
    """The modules of the effects that are on and make a pass at the end of a step, by name."""
    return {name: load(name) for name in AFTER_STEP if getattr(effects, name, False)}
