# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""LavaError, and the checks of values that raise it."""

import math
import pickle

import numpy as np
import pytest

from lava_ros import validation
from lava_ros.errors import (
    LavaError,
    MAX_EXPECTED_LENGTH,
    MAX_FIELD_LENGTH,
    MAX_VALUE_LENGTH,
    refusing,
)
from lava_ros.scene.distributions import Displacement, Roughness


def test_error_names_field_value_and_expectation():
    error = LavaError('vents[0].discharge', -1.0, 'at least 0 m3/s')
    assert str(error) == 'vents[0].discharge is -1.0, expected at least 0 m3/s'


@pytest.mark.parametrize(('value', 'shown'), [
    (np.float64(-1.5), '-1.5'), (np.float32(0.5), '0.5'), (np.int64(7), '7'), (np.uint8(7), '7'),
    (np.bool_(True), 'True'), (np.str_('a'), "'a'"), (np.array(2.0), '2.0'),
    ((np.float64(1.0), np.float64(2.0)), '(1.0, 2.0)'), ([np.int32(3)], '[3]'),
    (-5.0, '-5.0'), (1e-5, '1e-05'), (math.inf, 'inf'), ('-5.0', "'-5.0'"),
])
def test_error_shows_numbers_of_numpy_as_a_user_types_them(value, shown):
    assert str(LavaError('x', value, 'less')) == f'x is {shown}, expected less'


def test_long_values_are_shortened():
    text = str(LavaError('terrain', 'a' + 300 * '/x' + 'z', 'a file'))
    assert "'a/x" in text and "/xz'" in text and '...' in text
    assert len(text) < MAX_VALUE_LENGTH + len('terrain is , expected a file') + 1
    text = str(LavaError('x', list(range(1000)), 'less'))
    assert text.startswith('x is [0, 1, 2')
    assert text.endswith(', ...], expected less')
    value = ['x']
    for _ in range(100):
        value = [value] * 10
    for shown in (value, {1: value}, (value, value), 1 << 10**6, [[10**5000]], b'x' * 10**6):
        text = str(LavaError('gravity', shown, 'a number'))
        assert len(text) <= MAX_VALUE_LENGTH + len('gravity is , expected a number')


def test_error_is_one_line():
    text = str(LavaError('scene.\x1b[31m\n' + 'k' * 10**6, 'a\nb', 'one\nof ' + 'x' * 10**6))
    assert text.isprintable()
    words = len(' is , expected ')
    assert len(text) <= MAX_FIELD_LENGTH + MAX_VALUE_LENGTH + MAX_EXPECTED_LENGTH + words


def test_pickled_error_keeps_its_parts():
    error = LavaError('members', (1, 'two'), 'at least 1')
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again)) == (LavaError, str(error))
    assert (again.field, again.value, again.expected) == ('members', (1, 'two'), 'at least 1')


def test_numbers_and_pairs_are_converted():
    assert [validation.number('x', item) for item in (3, np.float32(0.5), '1e4')] == [3, 0.5, 1e4]
    assert validation.pair('p', [1, '2']) == (1.0, 2.0)
    assert validation.pair('p', np.array([1.0, 2.0])) == (1.0, 2.0)


@pytest.mark.parametrize('value', [None, 'hot', math.nan, math.inf, True, [1.0], -1.0, 11.0])
def test_number_names_field_and_limits(value):
    with pytest.raises(LavaError, match=r'^lava\.density is .*at least 0 m and at most 10 m') as e:
        validation.number('lava.density', value, at_least=0.0, at_most=10.0, unit='m')
    assert e.value.field == 'lava.density'


@pytest.mark.parametrize('value', ['12', 3.0, [1.0], [1.0, 2.0, 3.0], [1.0, math.nan], None])
def test_pair_refuses_other_values(value):
    with pytest.raises(LavaError, match='^p'):
        validation.pair('p', value)


def test_items_and_texts_are_checked():
    assert validation.items('a', [1, 'b'], 'a list') == [('a[0]', 1), ('a[1]', 'b')]
    for value, least, most in (('ab', 0, None), ({}, 0, None), ([1], 2, None), ([1, 2, 3], 0, 2)):
        with pytest.raises(LavaError, match='^a is .*, expected a list'):
            validation.items('a', value, 'a list', least=least, most=most)
    assert validation.text('a', 'b') == 'b'
    with pytest.raises(LavaError, match='^a is 3, expected text'):
        validation.text('a', 3)


def test_keys_names_unknown_and_missing_keys():
    with pytest.raises(LavaError, match='vent.flux: unknown key, expected one of a, b'):
        validation.keys('vent', {'flux': 1.0}, allowed=['a', 'b'])
    with pytest.raises(LavaError, match='vent.a is missing'):
        validation.keys('vent', {'b': 1.0}, allowed=['a', 'b'], required=['a'])
    with pytest.raises(LavaError, match='vent is 3'):
        validation.keys('vent', 3, allowed=['a'])


def test_refusing_turns_exceptions_of_some_kinds_into_lava_errors():
    with (
        pytest.raises(LavaError, match='^x is 1, expected a file .no such bit.$') as caught,
        refusing('x', 1, 'a file', ValueError, OSError),
    ):
        raise OSError('no such bit')
    assert isinstance(caught.value.__cause__, OSError)
    with (
        pytest.raises(LavaError, match='expected a file .KeyError.$'),
        refusing('x', 1, 'a file'),
    ):
        raise KeyError
    for error in (LavaError('y', 2, 'less'), MemoryError(), TypeError()):
        with pytest.raises(type(error)) as other, refusing('x', 1, 'a file', ValueError):
            raise error
        assert other.value is error


def test_build_names_the_key_of_a_bad_field():
    data = {'deviation': 2, 'correlation': '50'}
    assert validation.build(Roughness, 'ground', data) == Roughness(2.0, 50.0)
    with pytest.raises(LavaError, match='^ground.deviation is -1, expected a finite number above'):
        validation.build(Roughness, 'ground', {**data, 'deviation': -1})
    with pytest.raises(LavaError, match='^ground.correlation is missing'):
        validation.build(Roughness, 'ground', {'deviation': 2})
    with pytest.raises(LavaError, match='^ground.height: unknown key'):
        validation.build(Roughness, 'ground', {**data, 'height': 5})
    # an error about all fields together
    with pytest.raises(LavaError, match='^place is .0.0, 0.0., expected either deviation'):
        validation.build(Displacement, 'place', {})
