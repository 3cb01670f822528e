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

"""Plain data for scenes, layers and parameters with one thing wrong, and the field that is wrong.

Each is a valid set of values with one replaced by something that is not allowed there, whatever
the others are.
"""

import math
from typing import Any

from hypothesis import strategies as st
import numpy as np

from lava_ros.scene import Scene, Terrain
from lava_ros.scene.lava import Lava

#: No number at all.
NOT_NUMBERS = (
    None, 'warm', '', [], {}, [1.0], True, False, object(), b'1', 1j, math.nan, math.inf,
    -math.inf, 'nan', 'inf', '1_0_', np.array([1.0, 2.0]), np.array([]), np.nan, 10**400, {1: 2},
)

#: No pair of numbers.
NOT_PAIRS = (
    None, 1.0, 'ab', [], [1.0], [1.0, 2.0, 3.0], [1.0, None], ['x', 'y'], {}, {1: 2, 3: 4}, True,
    [math.nan, 0.0], [0.0, math.inf], [[1.0], [2.0]], np.zeros(3), np.zeros((2, 2)), {1.0, 2.0},
    np.array(1.0), (True, 1.0), [1e300, 0.0], range(3), b'ab', iter([1.0, 2.0]),
)

#: No truth value.
NOT_SWITCHES = (None, 0, 1, 'true', 'on', [], 1.0, np.array([True]))

#: No text.
NOT_TEXTS = (None, 1, 1.0, [], {}, b'x', True)


def below(least: float) -> st.SearchStrategy[float]:
    """Finite numbers under a limit."""
    return st.floats(max_value=least, exclude_max=True, allow_infinity=False)


def above(most: float) -> st.SearchStrategy[float]:
    """Finite numbers over a limit."""
    return st.floats(min_value=most, exclude_min=True, allow_infinity=False)


def no_number(least: float | None = None, most: float | None = None) -> st.SearchStrategy[Any]:
    """Anything but a finite number within limits."""
    result: st.SearchStrategy[Any] = st.sampled_from(NOT_NUMBERS)
    if least is not None:
        result |= below(least)
    if most is not None:
        result |= above(most)
    return result


def no_choice(words: tuple[str, ...]) -> st.SearchStrategy[Any]:
    """Anything but one of the words."""
    texts = st.text(max_size=20).filter(lambda text: text not in words)
    return texts | st.sampled_from(NOT_TEXTS) | st.just([words[0]])


def terrain_fields() -> dict[str, st.SearchStrategy[Any]]:
    """What each field of a terrain cannot be."""
    arrays = st.sampled_from(
        (
            None, 1.0, 'ground', [], [[]], [1.0, 2.0], [[1.0]], [[1.0, 2.0]], [[1.0], [2.0]],
            [[1.0, 2.0], [3.0]], [[[1.0, 2.0]] * 2] * 2, [['a', 'b'], ['c', 'd']],
            [[None, None], [None, None]], [[math.nan] * 3] * 3, [[0.0, math.inf], [0.0, 0.0]],
            [[0.0, -math.inf], [0.0, 0.0]], [[0.0, 1e38], [0.0, 0.0]], [[0.0, 1e300], [0, 0]],
            np.zeros((0, 5)), np.zeros((2, 2, 2)), np.zeros((2, 40_000)), np.zeros((2, 2), 'c16'),
            np.array([[object()] * 2] * 2), np.zeros((2, 2), 'M8[s]'), {1: 2}, {1.0, 2.0},
            np.full((3, 3), 10**400, dtype=object), b'....',
        )
    )
    return {
        'elevation': arrays,
        'resolution': no_number(1e-4, 1e5) | st.just(0.0),
        'origin': st.sampled_from(NOT_PAIRS),
        'offset': st.sampled_from(NOT_PAIRS),
        'epsg': st.sampled_from((0, -1, 1023, 1.5, '32633', True, [], math.nan, 10**30)),
    }


def vent_fields() -> dict[str, st.SearchStrategy[Any]]:
    """What each field of a vent cannot be."""
    series = st.sampled_from(
        (
            [], [1.0, 2.0], [(0.0,)], [(0.0, 1.0), (0.0, 2.0)], [(1.0, 1.0), (0.5, 1.0)],
            [(0.0, -1.0)], [(0.0, math.nan)], [(math.inf, 1.0)], [(0.0, 1e300)], [None], ['ab'],
            [(0.0, 1.0, 2.0)], np.zeros((2, 3)), np.zeros((2, 2)), np.zeros((0, 2)),
            [[[0.0, 1.0]]],
        )
    )
    return {
        'position': st.sampled_from(NOT_PAIRS),
        'discharge': st.sampled_from(NOT_NUMBERS) | below(0.0) | above(1e8) | series,
        'temperature': no_number(700.0, 2000.0),
        'radius': no_number(0.0, 1e5) | st.just(0.0),
        'end': st.sampled_from([item for item in NOT_PAIRS if item is not None]),
        'velocity': st.sampled_from(NOT_PAIRS),
        'name': st.sampled_from(NOT_TEXTS),
    }


def lava_fields() -> dict[str, st.SearchStrategy[Any]]:
    """What each constant of a material cannot be."""
    result: dict[str, st.SearchStrategy[Any]] = {}
    for name, item in Lava.__dataclass_fields__.items():
        if 'limits' in item.metadata:
            result[name] = no_number(*item.metadata['limits'])
        elif 'choices' in item.metadata:
            result[name] = no_choice(item.metadata['choices'])
        else:
            result[name] = st.sampled_from(NOT_SWITCHES)
    return result


def scene_fields() -> dict[str, st.SearchStrategy[Any]]:
    """What each field of a scene cannot be."""
    return {
        'terrain': st.sampled_from((None, 1.0, 'ground', {}, np.zeros((3, 3)), Terrain)),
        'vents': st.sampled_from((None, 1.0, 'vents', [None], ['vent'], [{}], [[]], {1: 2}, b'v')),
        'lava': st.sampled_from((None, 1.0, 'lava', {}, Lava)),
        'uncertainty': st.sampled_from((None, 1.0, 'uncertainty', {}, [])),
        **{
            name: no_number(*item.metadata['limits'])
            for name, item in Scene.__dataclass_fields__.items()
            if 'limits' in item.metadata
        },
    }


def any_yaml() -> st.SearchStrategy[Any]:
    """Data that a YAML file may hold, of any shape."""
    leaves = (
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
        | st.dates() | st.sampled_from(('nan', '1e4', '.inf', 'file', 'vents', 'position'))
    )
    return st.recursive(
        leaves,
        lambda inner: st.lists(inner, max_size=4)
        | st.dictionaries(st.text(max_size=8) | st.integers() | st.none(), inner, max_size=4),
        max_leaves=12,
    )
