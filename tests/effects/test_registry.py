# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Every effect has an exact case, a test, a heading in the model, and a measured cost."""

from pathlib import Path
import re

import pytest

from deleted_effects import NAMES, names_effect
from lava_ros.cli.effects import step_costs
from lava_ros.effects import EFFECTS
from lava_ros.verification.cases import CASES

HERE = Path(__file__).parent
CPU_COSTS = HERE.parents[1] / 'docs/benchmarks/effects_cpu.csv'
MODEL = (HERE.parents[1] / 'docs/MODEL.md').read_text(encoding='utf-8')

#: The names of the effects that have each part, by its description.
COMPLETE = {
    'a case that switches it on, or no_case':
        {name for case in CASES.values() for name in case.effects}
        | {name for name, effect in EFFECTS.items() if effect.no_case},
    'a test, tests/effects/test_NAME.py':
        {path.stem.removeprefix('test_') for path in HERE.glob('test_*.py')},
    'a heading in docs/MODEL.md':
        {name for line in re.findall('^#+ .*', MODEL, re.MULTILINE)
         for name in re.findall('`(.+?)`', line)},
    # on a GPU, or if that has not been measured, on a CPU
    'a row in a table of lava check speed effects':
        {*step_costs()} | {line.split(',')[0] for line in CPU_COSTS.read_text().splitlines()},
}


def missing_parts(name: str, complete: dict[str, set[str]] = COMPLETE) -> list[str]:
    """Return the parts that an effect lacks."""
    return [part for part, names in complete.items() if name not in names]


@pytest.mark.parametrize('name', EFFECTS)
def test_effect_is_complete(name):
    assert missing_parts(name) == []


@pytest.mark.parametrize('part', COMPLETE)
def test_effect_without_a_part_is_incomplete(part):
    complete = {
        other: names if other == part else names | {'made_up'} for other, names in COMPLETE.items()
    }
    assert missing_parts('made_up', complete) == [part]


def test_effect_has_either_a_case_or_a_reason():
    names = {name for case in CASES.values() for name in case.effects}
    assert names.isdisjoint(name for name, effect in EFFECTS.items() if effect.no_case)


@pytest.mark.parametrize('name', sorted(EFFECTS.keys() & NAMES.keys()))
def test_constants_by_which_tests_name_an_effect_are_its_own(name):
    assert {name, *NAMES[name]} >= {*EFFECTS[name].constants, *EFFECTS[name].environment}
    assert names_effect(HERE / f'test_{name}.py', name)
