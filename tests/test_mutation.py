# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Random changes of the code."""

from mutation import mutants

SOURCE = """
LIMIT = 2.0

@wp.func
def add(a: real, b: real):
    return a + b


def change(values, step=5):
    'Text with 1 number.'
    if 'ä' in values and step > 2:
        values.clear()
    text = f'{step + 1}'
    step += 7
    return True
"""


def test_mutants_change_one_place_outside_kernels_and_texts():
    lines, changed = SOURCE.splitlines(), set()
    for mutant in mutants('a.py', SOURCE.encode()):
        new = mutant.apply(SOURCE.encode()).decode().splitlines()
        (line,) = [one for one, old in zip(new, lines, strict=True) if one != old]
        changed.add(line.strip())
    assert changed == {
        "if ('ä' in values or step > 2):", "if ('ä' not in values) and step > 2:",
        "if 'ä' in values and (step >= 2):", "if 'ä' in values and step > 1:",
        'pass', 'return False',
    }
    assert sum(1 for _ in mutants('a.py', SOURCE.encode())) == 7
