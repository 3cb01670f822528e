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

"""Parameters: descriptors and the settings they make."""

import pytest

from lava_ros.errors import LavaError
from lava_ros.ros import parameters
from lava_ros.scene import constants_of, Lava


def _specs():
    return parameters.PARAMETERS + parameters.constant_parameters(constants_of(None))


def _values(**changes):
    return {**{spec.name: spec.default for spec in _specs()}, **changes}


def test_defaults():
    """The defaults are those of the parts; those of lava.* are the material's."""
    assert parameters.settings_from(_values()) == parameters.Settings()
    values = parameters.constant_values({**constants_of(None), 'lava': Lava(density=2000.0)})
    assert values['lava.density'] == 2000.0


def test_descriptors():
    """Each number has a range that its default lies in; choices are told to tools."""
    for spec in (*parameters.SOURCES, *_specs()):
        descriptor = spec.descriptor()
        assert all(choice in descriptor.additional_constraints for choice in spec.choices)
        assert (parameters.WHEN in descriptor.additional_constraints) is spec.read_only
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        assert len(ranges) == (type(spec.default) in (int, float)), spec.name
        for limits in ranges:
            assert limits.from_value <= spec.default <= limits.to_value, spec.name


def test_zero_and_empty_mean_automatic():
    """0 and '' are how ROS parameters say none."""
    given = {'end_time': 9.0, 'spacing': 2.0, 'device': 'cpu', 'epsg': 32633}
    settings = parameters.settings_from(_values(**given, offset_easting=5e5))
    assert {name: getattr(settings, name) for name in given} == given
    assert settings.offset == (5e5, 0.0)
    settings = parameters.settings_from(_values())
    assert {getattr(settings, name) for name in given} == {None}


def test_effects_are_forced_by_name():
    """Both lists make one mapping; an empty list is empty however ROS writes it."""
    settings = parameters.settings_from(
        _values(
            effects_on=['inertia', 'merging'],
            effects_off=['', 'steep'],
            layers_on=['', 'a'],
            horizon=2.0,
        )
    )
    assert settings.layers_on == ('a',)
    assert settings.forced == {'inertia': True, 'merging': True, 'steep': False}
    assert settings.horizon == 7200.0
    for empty in ([], [''], None):
        assert parameters.settings_from(_values(effects_on=empty)).forced == {}


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        ({'layers_on': 'lava_points'}, "layers_on is 'lava_points', expected a list of layers"),
        ({'effects_on': ['slope']}, "effects_on is 'slope', expected one of steep, yielding"),
        ({'effects_off': ['Steep']}, "effects_off is 'Steep', expected one of steep"),
        ({'effects_on': 'steep'}, "effects_on is 'steep', expected a list of effects"),
        ({'effects_on': [1]}, 'effects_on is 1, expected one of'),
        (
            {'effects_on': ['steep'], 'effects_off': ['steep']},
            "effects_off is 'steep', expected an effect that is not in effects_on",
        ),
        (
            {'effects_on': ['green', 'inertia']},
            "effects_on is ['green', 'inertia'], expected green false beside inertia",
        ),
        ({'effects_on': ['vft']}, "effects_on is 'vft', expected an effect that the material has"),
        ({'effects_on': ['arrhenius'], 'lava.vft_b': 5000.0}, "effects_on is 'arrhenius'"),
        # what the ranges cannot say is checked with the values together
        ({'frame_id': ''}, 'frame_id is'),
        ({'lava.density': -1.0}, 'lava.density is'),
        ({'preset': 'best'}, 'preset is'),
    ],
)
def test_wrong_values_are_refused(changes, sentence):
    """What is no list, unknown, contradictory, empty or not of the material is named."""
    with pytest.raises(LavaError) as caught:
        parameters.settings_from(_values(**changes))
    assert str(caught.value).startswith(sentence)
