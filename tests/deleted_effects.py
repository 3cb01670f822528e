# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tests to leave out of a package from which the files of an effect have been deleted."""

from functools import cache
from pathlib import Path
import re

from lava_ros.effects import EFFECTS

TESTS = Path(__file__).parent

#: Effects that tests of other parts name, and their constants.
NAMES = {
    'steep': (), 'yielding': ('yield_strength', 'yield_rate'),
    'crust_strength': ('crust_diffusivity',), 'power_law': ('flow_index',), 'arrhenius': (),
    'vft': ('vft_a', 'vft_b', 'vft_c'), 'crystals': ('crystal_law', 'packing'), 'inertia': (),
    'green': (), 'helmholtz': (), 'cooling': (),
    'cover': ('crust_cover', 'crust_cover_decay', 'crust_temperature'), 'crust': (),
    'wind': ('wind_speed',), 'ground': ('ground_conductivity', 'ground_diffusivity'),
    'viscous_heating': (), 'latent_heat': (), 'conduction': (), 'solidification': (),
    'insulation': (), 'merging': (),
}

#: Effects that have been deleted.
DELETED = NAMES.keys() - EFFECTS.keys()


@cache
def text_of(path: Path) -> str:
    """Return the code of a file of tests and of all helpers that it imports."""
    read: dict[Path, str] = {}
    waiting = {path, *(folder / 'conftest.py' for folder in path.parents if folder != TESTS)}
    while waiting:
        one = waiting.pop()
        if one not in read and one.is_file() and TESTS in one.parents:
            read[one] = one.read_text(encoding='utf-8')
            modules = re.findall(r'^(?:from|import) ([\w.]+)', read[one], re.MULTILINE)
            waiting |= {TESTS / f'{module.replace(".", "/")}.py' for module in modules}
    return '\n'.join(read.values())


def names_effect(path: Path, effect: str) -> bool:
    """Return True if a test names an effect, or one of its constants, in its code."""
    names = '|'.join((effect, *NAMES[effect]))
    words = rf"'(?:[\w ]+ )?(?:{names})(?: [\w ]+)?'|\b(?:{names})=|\.(?:{names})\b"
    keys = '|'.join(rf'\b{name}: ' for name in NAMES[effect]) or '(?!)'
    return bool(re.search(f'{words}|{keys}', text_of(path)))


def is_left_out(path: Path) -> bool:
    """Return True if a file of tests names an effect that has been deleted."""
    return path.suffix == '.py' and any(names_effect(path, effect) for effect in DELETED)
