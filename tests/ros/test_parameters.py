# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Descriptors of parameters, and the settings they give."""

from contextlib import ExitStack
from functools import partial

import pytest
import rclpy
from rclpy.parameter import Parameter
import yaml

from lava_ros.errors import LavaError
from lava_ros.ros import node_parameters, parameters
from lava_ros.ros.executor import start_ros
from lava_ros.ros.startup_inputs import make_simulation
from lava_ros.scene import constants_of, Lava
from lava_ros.scene.onset import Onset
from ros_domain import own_domain
from slope_scenes import uncertain_scene


def _specs():
    return parameters.PARAMETERS + parameters.constant_parameters(constants_of(None))


def _values(**changes):
    return {**{spec.name: spec.default for spec in _specs()}, **changes}


def test_defaults_are_those_of_settings_and_material():
    assert parameters.settings_from(_values()) == parameters.Settings()
    values = parameters.constant_values({**constants_of(None), 'lava': Lava.paper(density=2000.0)})
    assert values['lava.density'] == 2000.0


def test_number_has_a_range_with_its_default():
    for spec in (*parameters.SOURCES, *_specs()):
        descriptor = spec.descriptor()
        assert all(choice in descriptor.additional_constraints for choice in spec.choices)
        assert (parameters.WHEN in descriptor.additional_constraints) is spec.read_only
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        is_number = isinstance(spec.default, int | float) and not isinstance(spec.default, bool)
        assert len(ranges) == is_number, spec.name
        for limits in ranges:
            assert limits.from_value <= spec.default <= limits.to_value, spec.name


@pytest.mark.parametrize(('field', 'value', 'method'), [
    ('spacing', 1e-4, 'particles'), ('spacing', 1e-4, 'cells'), ('device', 'cuda:99', 'particles'),
])
def test_refusal_of_a_scene_names_the_parameter(field, value, method):
    settings = parameters.Settings(**{'device': 'cpu', 'method': method, field: value})
    with pytest.raises(LavaError, match=f'^{field} is {value!r}, expected '):
        make_simulation(uncertain_scene(1.0), settings)


def test_zero_and_empty_mean_automatic():
    given = {'end_time': 9.0, 'spacing': 2.0, 'device': 'cpu', 'epsg': 32633}
    settings = parameters.settings_from(_values(**given, offset_easting=5e5))
    assert {name: getattr(settings, name) for name in given} == given
    assert settings.offset == (5e5, 0.0)
    settings = parameters.settings_from(_values())
    assert {getattr(settings, name) for name in given} == {None}


def test_lists_of_effects_become_one_mapping():
    settings = parameters.settings_from(
        _values(
            effects_on=['inertia', 'merging'], effects_off=['', 'steep'], layers_on=['', 'a'],
            horizon=2.0,
        )
    )
    assert settings.layers_on == ('a',)
    assert settings.forced == {'inertia': True, 'merging': True, 'steep': False}
    assert settings.horizon == 7200.0
    for empty in ([], ['']):
        assert parameters.settings_from(_values(effects_on=empty)).forced == {}


@pytest.fixture
def node_with():
    """Return a function that makes a node with ROS arguments."""
    with ExitStack() as made:

        def make(*words):
            context = rclpy.Context()
            start_ros(['--ros-args', *words], context=context, domain_id=own_domain('graph'))
            made.callback(rclpy.shutdown, context=context)
            node = rclpy.create_node('lava', context=context)
            made.callback(node.destroy_node)
            node_parameters.declare(node, _specs())
            node.add_pre_set_parameters_callback(partial(node_parameters.with_types, node))
            return node

        yield make


LISTS = [spec.name for spec in _specs() if spec.is_list]


@pytest.mark.parametrize('text', ['[]', 'null', '~', "['']", "''", 'None'])
def test_empty_lists_survive_a_dump(node_with, tmp_path, text):
    file = tmp_path / 'dump.yaml'
    values = ', '.join(f'{name}: {text}' for name in LISTS)
    file.write_text(f'/lava: {{ros__parameters: {{{values}}}}}')
    words = [word for name in LISTS for word in ('-p', f'{name}:={text}')]
    for given in (words, ('--params-file', str(file))):
        node = node_with(*given)
        assert [node.get_parameter(name).value for name in LISTS] == [['']] * len(LISTS)


def test_empty_list_can_be_set_and_loaded(node_with):
    """``ros2 param load`` sends null as a text, and ``ros2 param set`` an empty list of bytes."""
    node = node_with()
    for value in ([], [''], '', 'None', 'null', None):
        for given, expected in ((['cooling'], ['cooling']), (value, [''])):
            (done,) = node.set_parameters([Parameter('effects_off', value=given)])
            assert done.successful, done.reason
            assert node.get_parameter('effects_off').value == expected


@pytest.mark.parametrize(('value', 'is_valid'), [
    (30, True), ('3e1', True), (30.0, True), (True, False), ('fast', False),
])
def test_numbers_of_any_type_can_be_set(node_with, value, is_valid):
    node = node_with()
    (done,) = node.set_parameters([Parameter('time_scale', value=value)])
    assert done.successful is is_valid
    assert node.get_parameter('time_scale').value == (30.0 if is_valid else 1.0)


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        ({'layers_on': 'lava_points'}, "layers_on is 'lava_points', expected a list of layers"),
        ({'effects_on': ['slope']}, "effects_on is 'slope', expected one of steep, yielding"),
        ({'effects_off': ['Steep']}, "effects_off is 'Steep', expected one of steep"),
        ({'quantities_exact': ['colour']}, "quantities_exact is 'colour', expected one of all, "),
        ({'effects_on': 'steep'}, "effects_on is 'steep', expected a list of effects"),
        ({'effects_on': [1]}, 'effects_on is 1, expected one of'),
        (
            {'effects_on': ['steep'], 'effects_off': ['steep']},
            'steep in effects_on and steep in effects_off exclude each other',
        ),
        (
            {'effects_on': ['green', 'inertia']},
            "effects_on is ['green', 'inertia'], expected green false with inertia",
        ),
        ({'effects_on': ['vft']}, "effects_on is 'vft', expected an effect for which lava"),
        ({'effects_on': ['arrhenius'], 'lava.vft_b': 5000.0}, "effects_on is 'arrhenius'"),
        # combinations that ranges cannot express
        ({'frame_id': ''}, 'frame_id is'),
        ({'lava.density': -1.0}, 'lava.density is'),
        ({'preset': 'best'}, 'preset is'),
        ({'method': 'cell'}, "method is 'cell', expected one of particles, cells, auto"),
        (
            {'method': 'cells', 'effects_on': ['inertia']},
            "effects_on is 'inertia', expected an effect that cells have, or method particles",
        ),
    ],
)
def test_rejects_wrong_values(changes, sentence):
    with pytest.raises(LavaError) as caught:
        parameters.settings_from(_values(**changes))
    assert str(caught.value).startswith(sentence)


@pytest.mark.parametrize('text', [
    '2026-11-27T05:30:00Z', '2026-11-27T05:30Z', '2026-11-27T05:30:07Z',
    '2026-11-27T05:30:07.5+01:00', '2026-11-27T05:30:00-09:30', '2026-11-27T05:30', '2026-11-27',
])
def test_onset_is_a_text_to_the_tools_of_ros(text):
    """``ros2 param load`` fails for all parameters if YAML reads one as a date."""
    value = parameters.onset_value(text)
    assert yaml.safe_load(value) == value
    first, second = (Onset.from_text(item).start for item in (text, value))
    assert (first, first.utcoffset()) == (second, second.utcoffset())
