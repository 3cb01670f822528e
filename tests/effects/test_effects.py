# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Effects as a key; an effect that is off leaves no trace."""

from dataclasses import replace

import pytest

from effects.copies import copy_package, output_of
from lava_ros.effects import EFFECTS, Effects
from lava_ros.effects.effect import Effect, join_names, number
from lava_ros.errors import LavaError

#: An effect that declares a name of the solver.
TOY = """
from lava_ros.effects.effect import Array, Effect, number
EFFECT = Effect(rank=200, title='toy', {})
"""

#: Adds an effect of each text in turn, and prints the error.
ADD_EACH = """
from pathlib import Path
import sys
# two texts of one second and one length would share a cached module
sys.dont_write_bytecode = True
for text in sys.argv[1:]:
    Path('lava_ros/effects/toy.py').write_text(text)
    for name in [name for name in sys.modules if name.startswith('lava_ros')]:
        del sys.modules[name]
    try:
        import lava_ros.simulation.simulation
    except ValueError as error:
        print(error)
"""


@pytest.mark.parametrize(
    'pair',
    [('green', 'helmholtz'), ('arrhenius', 'vft'), ('inertia', 'green'), ('inertia', 'helmholtz')],
)
def test_rejects_effects_that_exclude_each_other(pair):
    with pytest.raises(LavaError, match='effects'):
        Effects(**{'arrhenius': False, **dict.fromkeys(pair, True)})


@pytest.mark.parametrize('part', ['constants', 'environment', 'law', 'heat', 'arrays'])
def test_rejects_a_name_of_another_effect(part):
    names = [(one, key) for one, item in EFFECTS.items() for key in getattr(item, part)]
    for owner, key in names:
        toy = Effect(rank=200, title='toy', **{part: {key: number(0.0, '', 0.0, 1.0)}})
        words = rf"^effects.toy.{part} is '{key}', expected a name that effects.{owner} does not"
        with pytest.raises(LavaError, match=words):
            join_names(part, {**EFFECTS, 'toy': toy})
        assert join_names(part, {**EFFECTS, 'toy': replace(toy, adds_to=(key,))})


#: A name of the solver in each part of an effect, and its value.
TAKEN = {
    'environment': ('gravity', "number(1.0, '', 0.0, 2.0)"),
    'law': ('viscosity', 'lambda lava: 1.0'),
    'heat': ('ambient', 'lambda scene: 1.0'),
    'arrays': ('ground', "Array('real')"),
}


def test_rejects_a_name_of_the_solver(tmp_path):
    copy_package(tmp_path)
    texts = [TOY.format(f"{part}={{'{key}': {item}}}") for part, (key, item) in TAKEN.items()]
    printed = ' '.join(output_of(ADD_EACH, texts, tmp_path))
    for part, (key, _) in TAKEN.items():
        assert f"effects.toy.{part} is '{key}', expected a name" in printed
