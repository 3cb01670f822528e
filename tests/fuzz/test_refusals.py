# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""One LavaError names the field of any invalid value in a scene, a file or a parameter.

Each example replaces every value of a valid set in turn.
"""

from dataclasses import asdict, fields
from datetime import datetime
import math
from typing import Any

from hypothesis import given, note, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.layers.layer_files import layers_from_dict
from lava_ros.ros import parameters
from lava_ros.scene import (
    constants_of,
    MAX_ELEVATION,
    Scene,
    Terrain,
    Vent,
    vents_from_list,
)
from lava_ros.scene.lava import Lava
from lava_ros.simulation.accuracy import Accuracy, accuracy_from_dict
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.selection import decide

#: Values that are not finite numbers.
NOT_NUMBERS = (
    None, 'warm', '', [], {}, [1.0], True, False, object(), b'1', 1j, math.nan, math.inf,
    -math.inf, 'nan', 'inf', '1_0_', np.array([1.0, 2.0]), np.array([]), np.nan, 10**400, {1: 2},
)

#: Values that are not pairs of numbers.
NOT_PAIRS = (
    None, 1.0, 'ab', [], [1.0], [1.0, 2.0, 3.0], [1.0, None], ['x', 'y'], {}, {1: 2, 3: 4}, True,
    [math.nan, 0.0], [0.0, math.inf], [[1.0], [2.0]], np.zeros(3), np.zeros((2, 2)), {1.0, 2.0},
    np.array(1.0), (True, 1.0), [1e300, 0.0], range(3), b'ab', iter([1.0, 2.0]),
)

#: Values that are not booleans.
NOT_SWITCHES = (None, 0, 1, 'true', 'on', [], 1.0, np.array([True]))

#: Values that are not text.
NOT_TEXTS = (None, 1, 1.0, [], {}, b'x', True)


def no_number(
    minimum: float | None = None, maximum: float | None = None
) -> st.SearchStrategy[Any]:
    """Return anything but a finite number within limits."""
    result: st.SearchStrategy[Any] = st.sampled_from(NOT_NUMBERS)
    if minimum is not None:
        result |= st.floats(max_value=minimum, exclude_max=True, allow_infinity=False)
    if maximum is not None:
        result |= st.floats(min_value=maximum, exclude_min=True, allow_infinity=False)
    return result


def no_choice(words: tuple[str, ...]) -> st.SearchStrategy[Any]:
    """Return anything but one of the words."""
    texts = st.text(max_size=20).filter(lambda text: text not in words)
    return texts | st.sampled_from(NOT_TEXTS) | st.just([words[0]])


def is_given(value: Any) -> bool:
    """Return True if a value is not left to the default."""
    return value is not None


def described_fields(kind: Any) -> dict[str, st.SearchStrategy[Any]]:
    """Return invalid values of the fields with limits, choices or text."""
    result: dict[str, st.SearchStrategy[Any]] = {}
    for item in fields(kind):
        if 'limits' in item.metadata:
            wrong = no_number(*item.metadata['limits'])
            result[item.name] = wrong if item.default is not None else wrong.filter(is_given)
        elif 'choices' in item.metadata:
            result[item.name] = no_choice(item.metadata['choices'])
        elif 'text' in item.metadata:
            result[item.name] = st.sampled_from(NOT_SWITCHES)
    return result


def any_yaml() -> st.SearchStrategy[Any]:
    """Return data of any shape that a YAML file may contain."""
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


GROUND = Terrain(np.zeros((4, 5)), 10.0)

VALID: dict[type, dict[str, Any]] = {
    Terrain: {'elevation': np.zeros((4, 5)), 'resolution': 10.0},
    Vent: {'position': (25.0, 15.0), 'discharge': 2.0},
    Lava: {},
    Scene: {'terrain': GROUND, 'vents': (Vent((25.0, 15.0), 2.0),)},
    Accuracy: {},
    Effects: {},
}

#: Invalid elevations, and invalid series of discharge.
NOT_GROUNDS = (
    None, 1.0, 'ground', [], [[]], [1.0, 2.0], [[1.0]], [[1.0, 2.0]], [[1.0], [2.0]],
    [[1.0, 2.0], [3.0]], [[[1.0, 2.0]] * 2] * 2, [['a', 'b'], ['c', 'd']],
    [[None, None], [None, None]], [[math.nan] * 3] * 3, [[0.0, math.inf], [0.0, 0.0]],
    [[0.0, -math.inf], [0.0, 0.0]], [[0.0, 1e38], [0.0, 0.0]], [[0.0, 1e300], [0, 0]],
    np.zeros((0, 5)), np.zeros((2, 2, 2)), np.zeros((2, 40_000)), np.zeros((2, 2), 'c16'),
    np.array([[object()] * 2] * 2), np.zeros((2, 2), 'M8[s]'), {1: 2}, {1.0, 2.0},
    np.full((3, 3), 10**400, dtype=object), b'....',
)
NOT_SERIES = (
    [], [1.0, 2.0], [(0.0,)], [(0.0, 1.0), (0.0, 2.0)], [(1.0, 1.0), (0.5, 1.0)], [(0.0, -1.0)],
    [(0.0, math.nan)], [(math.inf, 1.0)], [(0.0, 1e300)], [None], ['ab'], [(0.0, 1.0, 2.0)],
    np.zeros((2, 3)), np.zeros((2, 2)), np.zeros((0, 2)), [[[0.0, 1.0]]],
)

WRONG: dict[type, dict[str, st.SearchStrategy[Any]]] = {
    Terrain: {
        'elevation': st.sampled_from(NOT_GROUNDS),
        'resolution': no_number(1e-4, 1e5) | st.just(0.0),
        'origin': st.sampled_from(NOT_PAIRS),
        'offset': st.sampled_from(NOT_PAIRS),
        'sea_level': no_number(-MAX_ELEVATION, MAX_ELEVATION).filter(is_given),
        'epsg': st.sampled_from((0, -1, 1023, 1.5, '32633', True, [], math.nan, 10**30)),
        'barriers': st.sampled_from(
            (1.0, [1.0], 'barrier', [[(1.0, 2.0)]], [[(math.nan, 0.0), (1.0, 1.0)]])
        ),
        'wkt': st.sampled_from(('', 0, 1.5, True, [], b'PROJCS[]', 'x' * 100_001)),
    },
    Vent: {
        'position': st.sampled_from(NOT_PAIRS),
        'discharge': no_number(0.0, 1e8) | st.sampled_from(NOT_SERIES),
        # None is the temperature of the scene's lava
        'temperature': no_number(700.0, 2000.0).filter(is_given),
        'radius': no_number(0.0, 1e5) | st.just(0.0),
        'end': st.sampled_from(NOT_PAIRS).filter(is_given),
        'velocity': st.sampled_from(NOT_PAIRS),
        'name': st.sampled_from(NOT_TEXTS),
    },
    Lava: described_fields(Lava),
    Scene: {
        'terrain': st.sampled_from((None, 1.0, 'ground', {}, np.zeros((3, 3)), Terrain)),
        'vents': st.sampled_from((None, 1.0, 'vents', [None], ['vent'], [{}], [[]], {1: 2}, b'v')),
        'lava': st.sampled_from((None, 1.0, 'lava', {}, Lava)),
        'uncertainty': st.sampled_from((None, 1.0, 'uncertainty', {}, [])),
        'emplaced_flows': st.sampled_from((None, 1.0, 'flow', [None], [{}], [GROUND], {1: 2})),
        'events': st.sampled_from((None, 1.0, 'event', [None], [{}], [GROUND], {1: 2})),
        'onset': st.sampled_from((1.0, '2021-09-19', [], datetime(2021, 9, 19), b'x', {})),
        **described_fields(Scene),
    },
    Accuracy: described_fields(Accuracy),
    Effects: described_fields(Effects),
}

#: Examples of tests that try every field in each of them.
every = settings(max_examples=max(3, settings.default.max_examples // 50))


def test_every_field_is_tried():
    for kind, names in WRONG.items():
        # the source of a terrain is free text
        assert set(names) == {item.name for item in fields(kind)} - {'source'}


@pytest.mark.parametrize('kind', WRONG)
@every
@given(data=st.data())
def test_names_the_field_of_an_invalid_value(kind, data):
    for name, values in WRONG[kind].items():
        wrong = data.draw(values)
        note(f'{kind.__name__}.{name} = {wrong!r}')
        with pytest.raises(LavaError) as caught:
            kind(**{**VALID[kind], name: wrong})
        assert name in caught.value.field or name in str(caught.value)
        assert len(str(caught.value)) < 400


def lavas():
    """Return materials with any constants within their limits."""
    limits = {one.name: one.metadata['limits'] for one in fields(Lava) if 'limits' in one.metadata}
    values = {name: st.floats(*both) | st.sampled_from(both) for name, both in limits.items()}
    return st.fixed_dictionaries(
        {}, optional={**values, 'crystal_law': st.sampled_from(('none', 'maron-pierce'))}
    )


@given(
    lava=lavas(), temperature=st.floats(700.0, 2000.0) | st.none(), discharge=st.floats(0.0, 1e8),
    ambient=st.floats(100.0, 600.0), gravity=st.floats(1e-3, 1e3),
    steps=st.lists(st.floats(-1e5, 1e5, width=32), min_size=4, max_size=4),
    resolution=st.floats(1e-4, 1e5), horizon=st.floats(1.0, 1e9),
    preset=st.sampled_from(('draft', 'standard', 'reference')),
)
def test_extreme_scenes_are_decided_or_refused(
    lava, temperature, discharge, ambient, gravity, steps, resolution, horizon, preset
):
    ground = Terrain(np.array(steps).reshape(2, 2), resolution)
    middle = (resolution, resolution)
    try:
        vents = [] if temperature is None else [Vent(middle, discharge, temperature)]
        scene = Scene(ground, vents, Lava.paper(**lava), ambient, gravity)
        decisions = decide(scene, accuracy=preset_accuracy(preset), horizon=horizon)
    except LavaError as error:
        assert error.field
    else:
        Effects(**{item.name: item.is_on for item in decisions})
        assert all(item.reason for item in decisions)


@given(data=any_yaml())
def test_yaml_of_any_shape_is_read_or_refused(data):
    for read in (
        lambda: vents_from_list(data, GROUND),
        lambda: vents_from_list([data], GROUND),
        lambda: vents_from_list([{'discharge': data, 'position': [25.0, 15.0]}], GROUND),
        lambda: vents_from_list([{'discharge': 1.0, 'projected': data}], GROUND),
        lambda: layers_from_dict(data),
        lambda: layers_from_dict({'layers': data}),
        lambda: layers_from_dict({'layers': {'a': data}}),
        lambda: accuracy_from_dict(data),
        lambda: decide(Scene(GROUND, lava=Lava.paper()), data),
    ):
        try:
            read()
        except LavaError as error:
            assert error.field


PARAMETERS = {
    item.name: item
    for item in parameters.PARAMETERS
    + parameters.constant_parameters({**constants_of(None), 'lava': Lava.paper()})
}


def within_limits(spec: parameters.ParameterSpec) -> st.SearchStrategy[Any]:
    """Return values of a parameter, within its limits if it is a number."""
    if spec.is_list:
        names = st.sampled_from(('inertia', 'green', 'vft', 'crust', '', 'x'))
        return st.lists(names, max_size=4) | st.sampled_from(
            (None, [1], [b'x'], [None], 'inertia', [['inertia']])
        )
    if isinstance(spec.default, bool):
        return st.booleans()
    if isinstance(spec.default, str):
        return st.text(max_size=20) | st.sampled_from(('draft', '../x', '/', 'cuda:99'))
    low, high = spec.limits
    if isinstance(spec.default, int):
        return st.integers(int(low), int(high))
    return st.floats(low, high) | st.sampled_from((low, high))


@every
@given(data=st.data())
def test_parameters_within_their_limits_are_accepted_or_refused(data):
    usual = {name: spec.default for name, spec in PARAMETERS.items()}
    for name, spec in PARAMETERS.items():
        try:
            found = parameters.settings_from({**usual, name: data.draw(within_limits(spec))})
        except LavaError as error:
            assert error.field
        else:
            lava = found.constants['lava']
            assert lava == Lava.paper(**asdict(lava))
