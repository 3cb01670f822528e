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

"""Whatever is wrong with a scene, a file or a parameter: one LavaError that names the field."""

from dataclasses import asdict, fields
from typing import Any

from hypothesis import given, note
from hypothesis import strategies as st
import numpy as np
import pytest
import yaml

from fuzz import invalid
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.maps.layer_files import layers_from_dict
from lava_ros.ros import parameters
from lava_ros.scene import constants_of, Scene, scene_from_yaml, Terrain, Vent, vents_from_list
from lava_ros.scene.lava import Lava
from lava_ros.scene.terrain_files import load_terrain
from lava_ros.simulation.accuracy import (
    Accuracy,
    accuracy_from_dict,
    FORMULATIONS,
    GRADIENTS,
    INTEGRATORS,
    KERNELS,
    PRECISIONS,
)
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.selection import decide

GROUND = Terrain(np.zeros((4, 5)), 10.0)

VALID: dict[type, dict[str, Any]] = {
    Terrain: {'elevation': np.zeros((4, 5)), 'resolution': 10.0},
    Vent: {'position': (25.0, 15.0), 'discharge': 2.0},
    Lava: {},
    Scene: {'terrain': GROUND, 'vents': (Vent((25.0, 15.0), 2.0),)},
    Accuracy: {},
    Effects: {},
}

WRONG: dict[type, dict[str, st.SearchStrategy[Any]]] = {
    Terrain: invalid.terrain_fields(),
    Vent: invalid.vent_fields(),
    Lava: invalid.lava_fields(),
    Scene: invalid.scene_fields(),
    Accuracy: {
        'spacing': invalid.no_number(1e-6, 1e7).filter(lambda value: value is not None),
        'refinement': invalid.no_number(0.05, 20.0),
        'thickness': invalid.no_number(1e-9, 1e5).filter(lambda value: value is not None),
        'ratio': invalid.no_number(1.5, 12.0),
        'kernel': invalid.no_choice(KERNELS),
        'raster_ratio': invalid.no_number(1e-3, 2.0),
        'diffusion_number': invalid.no_number(1e-4, 2.0),
        'courant_number': invalid.no_number(1e-4, 1.0),
        'longest_step': invalid.no_number(1e-6, 1e9),
        'fixed_step': invalid.no_number(1e-9, 1e9).filter(lambda value: value is not None),
        'gradient': invalid.no_choice(GRADIENTS),
        'formulation': invalid.no_choice(FORMULATIONS),
        'deterministic': st.sampled_from(invalid.NOT_SWITCHES),
        'symmetric': st.sampled_from(invalid.NOT_SWITCHES),
        'integrator': invalid.no_choice(INTEGRATORS),
        'precision': invalid.no_choice(PRECISIONS),
    },
    Effects: {item.name: st.sampled_from(invalid.NOT_SWITCHES) for item in fields(Effects)},
}

CASES = [(kind, name) for kind, names in WRONG.items() for name in names]


def test_every_field_is_tried():
    """A new field of a scene's parts needs a strategy here."""
    for kind, names in WRONG.items():
        # where a terrain is from is for people
        assert set(names) == {item.name for item in fields(kind)} - {'source'}


@given(data=st.data(), case=st.sampled_from(CASES))
def test_a_wrong_field_is_named(data, case):
    """A value that cannot be is refused, by the name of the field it is in."""
    kind, name = case
    wrong = data.draw(WRONG[kind][name])
    note(f'{kind.__name__}.{name} = {wrong!r}')
    with pytest.raises(LavaError) as caught:
        kind(**{**VALID[kind], name: wrong})
    assert name in caught.value.field or name in str(caught.value)
    assert len(str(caught.value)) < 400


def lavas():
    """Materials with any constants within their limits."""
    values = {
        name: st.floats(*item.metadata['limits']) | st.sampled_from(item.metadata['limits'])
        for name, item in Lava.__dataclass_fields__.items()
        if 'limits' in item.metadata
    }
    return st.fixed_dictionaries(
        {}, optional={**values, 'crystal_law': st.sampled_from(('none', 'maron-pierce'))}
    )


@given(
    lava=lavas(),
    temperature=st.floats(700.0, 2000.0) | st.none(),
    discharge=st.floats(0.0, 1e8),
    ambient=st.floats(100.0, 600.0),
    gravity=st.floats(1e-3, 1e3),
    steps=st.lists(st.floats(-1e5, 1e5, width=32), min_size=4, max_size=4),
    resolution=st.floats(1e-4, 1e5),
    horizon=st.floats(1.0, 1e9),
    preset=st.sampled_from(('draft', 'standard', 'reference')),
)
def test_extreme_scenes_are_decided_or_refused(
    lava, temperature, discharge, ambient, gravity, steps, resolution, horizon, preset
):
    """At the limits of all constants together the effects are chosen, or it says why not."""
    ground = Terrain(np.array(steps).reshape(2, 2), resolution)
    middle = (resolution, resolution)
    try:
        vents = [] if temperature is None else [Vent(middle, discharge, temperature)]
        scene = Scene(ground, vents, Lava(**lava), ambient, gravity)
        decisions = decide(scene, accuracy=preset_accuracy(preset), horizon=horizon)
    except LavaError as error:
        assert error.field
    else:
        Effects(**{item.name: item.is_on for item in decisions})
        assert all(item.reason for item in decisions)


def written(path, data):
    """A file of YAML."""
    path.write_text(yaml.safe_dump(data, allow_unicode=True), encoding='utf-8')
    return path


@given(data=invalid.any_yaml())
def test_any_yaml_is_no_scene_or_refused(data):
    """Data of any shape in place of vents, layers and accuracy gives a value or a LavaError."""
    for read in (
        lambda: vents_from_list(data, GROUND),
        lambda: vents_from_list([data], GROUND),
        lambda: vents_from_list([{'discharge': data, 'position': [25.0, 15.0]}], GROUND),
        lambda: vents_from_list([{'discharge': 1.0, 'projected': data}], GROUND),
        lambda: layers_from_dict(data),
        lambda: layers_from_dict({'layers': data}),
        lambda: layers_from_dict({'layers': {'a': data}}),
        lambda: accuracy_from_dict(data),
        lambda: decide(Scene(GROUND, lava=Lava()), data),
    ):
        try:
            read()
        except LavaError as error:
            assert error.field


LAYER_FIELDS: dict[str, st.SearchStrategy[Any]] = {
    'topic': st.sampled_from((*invalid.NOT_TEXTS, '', '/height', 'a b', '1a', 'a/', 'ä')),
    'source': invalid.no_choice(('thickness', 'temperature', 'hazard')),
    'message': invalid.no_choice(('nav_msgs/OccupancyGrid', 'sensor_msgs/Image')),
    'range': st.sampled_from((*invalid.NOT_PAIRS[:13], [1.0, 1.0], [2.0, 1.0])),
    'threshold': invalid.no_number(0.0),
    'outside': st.sampled_from((-2, 101, 1.5, None, True, 'one', 10**30)),
    'enabled': st.sampled_from(invalid.NOT_SWITCHES),
    'rate': invalid.no_number(0.001, 50.0),
    'record': st.sampled_from(invalid.NOT_SWITCHES),
    'qos': st.sampled_from(
        (None, [], 'latched', {'depth': 0}, {'depth': 1.5}, {'durability': 1}, {'no': 1}, {1: 2})
    ),
    'hazard': st.sampled_from(({}, None, [])),
    'name': st.just('x'),
    'colour': st.just('red'),
}


@given(data=st.data(), name=st.sampled_from(list(LAYER_FIELDS)))
def test_a_wrong_layer_is_named(data, name):
    """One wrong key in a layer is refused, and so is one there is not."""
    wrong = data.draw(LAYER_FIELDS[name])
    layer = {'source': 'thickness', 'message': 'nav_msgs/OccupancyGrid', 'range': [0.0, 5.0]}
    with pytest.raises(LavaError) as caught:
        layers_from_dict({'layers': {'depth': {**layer, name: wrong}}})
    assert name in caught.value.field
    assert caught.value.field.startswith('layers.depth')


@given(data=st.data())
def test_a_scene_file_with_anything_in_it(data, tmp_path_factory):
    """A scene file with one key of any shape gives a scene or a LavaError."""
    folder = tmp_path_factory.mktemp('scene')
    np.savez(folder / 'ground.npz', elevation=GROUND.elevation, resolution=10.0)
    content = {
        'terrain': {'file': 'ground.npz'},
        'vents': [{'position': [25.0, 15.0], 'discharge': 3.0}],
        'lava': {'density': 2600.0},
        'gravity': 9.81,
    }
    assert scene_from_yaml(written(folder / 'scene.yaml', content)).gravity == 9.81
    key = data.draw(st.sampled_from([*content, 'file', 'window', 'density', 'whole', 'text']))
    thing = data.draw(invalid.any_yaml())
    if key in ('file', 'window'):
        content['terrain'] = {**content['terrain'], key: thing}
    elif key == 'density':
        content['lava'] = {'density': thing}
    elif key == 'whole':
        content = thing
    else:
        content[key] = thing
    path = written(folder / 'scene.yaml', content)
    if key == 'text':
        path.write_bytes(data.draw(st.binary(max_size=60)))
    try:
        scene_from_yaml(path)
    except LavaError as error:
        assert error.field


@given(data=st.binary(max_size=400), ending=st.sampled_from(('npz', 'asc', 'tif', 'npy', '')))
def test_a_terrain_file_with_anything_in_it(data, ending, tmp_path_factory):
    """Random bytes in place of a terrain file are refused."""
    path = tmp_path_factory.mktemp('file') / f'ground.{ending}'
    path.write_bytes(data)
    with pytest.raises(LavaError):
        load_terrain(path)


@given(data=st.data())
def test_damaged_terrain_files(data, tmp_path_factory):
    """A terrain file with bytes changed gives a terrain or a LavaError."""
    folder = tmp_path_factory.mktemp('file')
    path = folder / 'ground.npz'
    if data.draw(st.booleans()):
        np.savez(path, elevation=GROUND.elevation, resolution=10.0)
    else:
        path = folder / 'ground.asc'
        rows = '\n'.join(' '.join(map(str, row)) for row in GROUND.elevation.tolist())
        path.write_text(
            'ncols 5\nnrows 4\nxllcorner 0\nyllcorner 0\ncellsize 10\nNODATA_value -9999\n'
            f'{rows}\n'
        )
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(1, len(content)))])
    try:
        assert isinstance(load_terrain(path), Terrain)
    except LavaError as error:
        assert error.field


PARAMETERS = {
    item.name: item
    for item in parameters.PARAMETERS
    + parameters.constant_parameters({**constants_of(None), 'lava': Lava()})
}


@given(data=st.data(), name=st.sampled_from(list(PARAMETERS)))
def test_any_parameter_within_its_type_is_taken_or_refused(data, name):
    """What rclpy lets through, a value of the declared type, gives settings or a LavaError."""
    spec = PARAMETERS[name]
    if spec.is_list:
        value = data.draw(
            st.lists(st.sampled_from(('inertia', 'green', 'vft', 'crust', '', 'x')), max_size=4)
            | st.sampled_from((None, [1], [b'x'], [None], 'inertia', [['inertia']]))
        )
    elif isinstance(spec.default, bool):
        value = data.draw(st.booleans())
    elif isinstance(spec.default, str):
        words = st.sampled_from(('draft', '../x', '/', 'cuda:99'))
        value = data.draw(st.text(max_size=20) | words)
    else:
        low, high = spec.limits
        if isinstance(spec.default, int):
            value = data.draw(st.integers(int(low), int(high)))
        else:
            value = data.draw(st.floats(low, high) | st.sampled_from((low, high)))
    values = {item: spec.default for item, spec in PARAMETERS.items()}
    try:
        settings = parameters.settings_from({**values, name: value})
    except LavaError as error:
        assert error.field
    else:
        lava = settings.constants['lava']
        assert lava == Lava(**asdict(lava))
