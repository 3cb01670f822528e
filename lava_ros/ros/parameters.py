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

"""The node's parameters: descriptions, ranges, and the settings they make."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from lava_ros import validation
from lava_ros.choice import CRITERIA, HORIZON
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.layers import ZERO_CELSIUS
from lava_ros.presets import DEFAULT as DEFAULT_PRESET
from lava_ros.presets import PRESETS
from lava_ros.ros.inputs import InputRules
from lava_ros.ros.worker import MAX_PARTICLES
from lava_ros.scene import Lava, VENT_TEMPERATURE_RANGE

#: Prefix of the parameters that are fields of ``Lava``.
LAVA = 'lava.'

#: Names of the effects.
EFFECTS = tuple(item.name for item in fields(Effects))

#: Wall time from one checkpoint to the next unless the user says otherwise [s].
CHECKPOINT_PERIOD = 60.0

_RULES = InputRules()


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter.

    Attributes:
        name: Its name.
        default: Its default, which gives it its type.
        description: What it means and in which unit.
        limits: Smallest and largest value, for numbers.
        read_only: Whether it is fixed once the node runs.
        is_list: Whether it is a list of texts.
    """

    name: str
    default: Any
    description: str
    limits: tuple[float, float] | None = None
    read_only: bool = False
    is_list: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """The descriptor that tools show and rclpy checks."""
        result = ParameterDescriptor(description=self.description, read_only=self.read_only)
        # An empty list has no type of its own: tools send it as one of anything.
        result.dynamic_typing = self.is_list
        if self.limits is not None and isinstance(self.default, float):
            low, high = self.limits
            result.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        elif self.limits is not None:
            low, high = (int(limit) for limit in self.limits)
            result.integer_range = [IntegerRange(from_value=low, to_value=high)]
        return result


#: What is known before the node is configured.
LIFECYCLE = (
    ParameterSpec(
        'autostart',
        True,
        'Configure and activate at the start; false: wait for a lifecycle manager',
        read_only=True,
    ),
)

#: What says where terrain and lava come from; the defaults of ``lava.*`` depend on it.
SOURCES = (
    ParameterSpec('scene', '', 'Scene file (YAML) to start with; empty: none', read_only=True),
    ParameterSpec(
        'terrain_file',
        '',
        'Terrain to start with (GeoTIFF, ESRI ASCII grid, npz), also in place of that of the '
        'scene file; empty: from the scene file or the topics',
        read_only=True,
    ),
    ParameterSpec(
        'resume',
        '',
        'Bag to go on from its newest checkpoint, which has the scene; empty: start anew',
        read_only=True,
    ),
)

PARAMETERS = (
    ParameterSpec(
        'device', '', 'cpu, cuda:0, ...; empty: the first GPU, else the CPU', read_only=True
    ),
    ParameterSpec(
        'msg_config',
        'default.yaml',
        'How layers become messages: a path, or the name of a file in msg_configs/',
        read_only=True,
    ),
    ParameterSpec(
        'layers_on',
        [''],
        'Layers of msg_config that are published whatever it says, such as lava_points',
        read_only=True,
        is_list=True,
    ),
    ParameterSpec(
        'layers_off',
        [''],
        'Layers of msg_config that are not published whatever it says',
        read_only=True,
        is_list=True,
    ),
    ParameterSpec('frame_id', 'map', 'Frame of every message in and out (ENU)', read_only=True),
    ParameterSpec('time_scale', 1.0, 'Simulated time per time of the clock [s/s]', (1e-3, 1e6)),
    ParameterSpec('end_time', 0.0, 'Simulated time [s] at which to stop; 0: never', (0.0, 1e10)),
    ParameterSpec(
        'preset',
        DEFAULT_PRESET,
        f'Accuracy: one of {", ".join(PRESETS)}; from the next start or reset on',
    ),
    ParameterSpec(
        'spacing',
        0.0,
        'Distance between particles [m], from the next start or reset on; 0: as the preset has it',
        (0.0, 1e4),
    ),
    ParameterSpec(
        'effects_on',
        [''],
        f'Effects that are on whatever the scene says; known: {", ".join(EFFECTS)}',
        is_list=True,
    ),
    ParameterSpec(
        'effects_off', [''], 'Effects that are off whatever the scene says', is_list=True
    ),
    ParameterSpec(
        'horizon',
        HORIZON / 3600.0,
        'How far ahead the choice of effects looks [h]',
        (1e-3, 1e5),
    ),
    ParameterSpec(
        'forecast_horizon',
        0.0,
        'How far ahead forecasts look, made again and again beside the simulation [h]; 0: none',
        (0.0, 1e5),
        read_only=True,
    ),
    ParameterSpec(
        'forecast_config',
        'forecast.yaml',
        'How forecasts become messages: a path, or the name of a file in msg_configs/',
        read_only=True,
    ),
    ParameterSpec(
        'forecast_max_age',
        0.0,
        'Simulated time after which a forecast is withdrawn unless there is a newer one [s]; '
        '0: half of forecast_horizon',
        (0.0, 1e10),
    ),
    ParameterSpec(
        'forecast_share',
        1.0,
        'Largest share of the time that the device computes forecasts; less while the simulation '
        'falls behind the clock [s/s]',
        (0.01, 1.0),
    ),
    ParameterSpec(
        'ensemble_members',
        0,
        'Members of the ensembles that are made beside forecasts; they differ in what the scene '
        'says is uncertain; 0: no ensembles',
        (0, 100_000),
        read_only=True,
    ),
    ParameterSpec(
        'deadline',
        0.0,
        'Wall time in which a forecast and its ensemble are to be there [s]: members that would '
        'be late are left out, and each start and reset takes the spacing that goes with it; '
        '0: any',
        (0.0, 1e6),
    ),
    ParameterSpec(
        'default_discharge', 10.0, 'Discharge of a vent opened by a click [m3/s]', (0.0, 1e6)
    ),
    ParameterSpec(
        'default_temperature',
        1150.0,
        'Temperature of a vent opened by a click [Celsius]',
        (VENT_TEMPERATURE_RANGE[0] - ZERO_CELSIUS, VENT_TEMPERATURE_RANGE[1] - ZERO_CELSIUS),
    ),
    ParameterSpec('default_radius', 10.0, 'Radius of a vent opened by a click [m]', (0.01, 1e4)),
    ParameterSpec(
        'terrain_subscribe_transient_local',
        True,
        'Subscribe to terrain as a latched topic; false to receive from a volatile publisher',
        read_only=True,
    ),
    ParameterSpec(
        'terrain_scale',
        _RULES.terrain_scale,
        'Height of a unit of a terrain image [m]',
        (1e-6, 1e6),
    ),
    ParameterSpec(
        'terrain_offset', _RULES.terrain_offset, 'Height added to terrain images [m]', (-1e6, 1e6)
    ),
    ParameterSpec(
        'terrain_allow_holes',
        _RULES.terrain_allow_holes,
        'Take terrain with cells without data (NaN): lava that reaches them leaves the domain',
    ),
    ParameterSpec(
        'terrain_cloud_resolution',
        _RULES.terrain_cloud_resolution,
        'Side of the cells a terrain cloud is rasterised to [m]',
        (1e-3, 1e4),
    ),
    ParameterSpec(
        'max_terrain_cells', _RULES.max_terrain_cells, 'Most cells of a terrain', (4, 2**30)
    ),
    ParameterSpec('max_vents', _RULES.max_vents, 'Most vents there may be', (0, 100_000)),
    ParameterSpec(
        'max_particles',
        MAX_PARTICLES,
        'Most particles of the simulation, each with up to 0.8 kB of memory; beyond it stops',
        (1, 2**30),
    ),
    ParameterSpec(
        'max_input_bytes', _RULES.max_input_bytes, 'Most data in a message [bytes]', (64, 2**32)
    ),
    ParameterSpec(
        'epsg',
        0,
        'EPSG code of the system that map is an offset of, for terrain from topics; 0: none',
        (0, 2**31),
    ),
    ParameterSpec('offset_easting', 0.0, 'Easting of the map origin [m], with epsg', (-1e9, 1e9)),
    ParameterSpec(
        'offset_northing', 0.0, 'Northing of the map origin [m], with epsg', (-1e9, 1e9)
    ),
    ParameterSpec('record', False, 'Record from the first terrain on', read_only=True),
    ParameterSpec(
        'bag_directory',
        '',
        'Bag to record to, a new folder; empty: <bag_root>/<date and time>; while the node runs '
        'only one inside bag_root is taken',
    ),
    ParameterSpec(
        'checkpoint_period',
        CHECKPOINT_PERIOD,
        'Wall time from one checkpoint in the bag to the next [s], the most that resuming loses; '
        'longer while checkpoints take more than half of the bag; 0: none',
        (0.0, 1e6),
    ),
    ParameterSpec(
        'bag_root',
        '',
        'Folder of the bags; empty: the one that holds bag_directory, else bags/',
        read_only=True,
    ),
    ParameterSpec(
        'bag_max_size',
        0,
        'Size [bytes] from which on the next recording goes on in a new file; 0: no limit',
        (0, 2**50),
    ),
    ParameterSpec(
        'bag_max_duration',
        0.0,
        'Time [s] after which the next recording goes on in a new file; 0: no limit',
        (0.0, 1e9),
    ),
)


def lava_parameters(lava: Lava) -> tuple[ParameterSpec, ...]:
    """The parameters ``lava.*``, with a material's values as defaults."""
    return tuple(
        ParameterSpec(
            LAVA + item.name,
            getattr(lava, item.name),
            f'{_labelled(item.metadata)}; from the next start or reset on',
            item.metadata.get('limits'),
        )
        for item in fields(Lava)
    )


def lava_values(lava: Lava) -> dict[str, Any]:
    """The values of the parameters ``lava.*`` that a material has, by name."""
    return {LAVA + item.name: getattr(lava, item.name) for item in fields(Lava)}


def _labelled(metadata: Mapping[str, Any]) -> str:
    unit = metadata.get('unit')
    return f'{metadata["text"]} [{unit}]' if unit else str(metadata['text'])


def declare(node: Node, specs: tuple[ParameterSpec, ...]) -> dict[str, Any]:
    """Declare parameters that a node does not have yet, and return the values of all by name."""
    for spec in specs:
        if not node.has_parameter(spec.name):
            node.declare_parameter(spec.name, spec.default, spec.descriptor())
    return {spec.name: plain(node.get_parameter(spec.name).value) for spec in specs}


def put(node: Node, values: Mapping[str, Any]) -> None:
    """Set parameters of a node, all or none.

    Raises:
        LavaError: One cannot have its value.
    """
    new = [Parameter(name, value=value) for name, value in values.items()]
    result = node.set_parameters_atomically(new)
    if not result.successful:
        raise LavaError('parameters', dict(values), f'values that can be set ({result.reason})')


def plain(value: Any) -> Any:
    """A parameter's value, with a list in place of any array."""
    return value if value is None or isinstance(value, str | bool | int | float) else list(value)


@dataclass(frozen=True)
class Settings:
    """What the parameters say, checked.

    Attributes:
        device: Name of the Warp device, None for automatic.
        msg_config: File of the layers.
        layers_on: Names of layers that are published whatever the file says.
        layers_off: Names of layers that are not.
        time_scale: Simulated seconds per second of the clock.
        end_time: Simulated time at which to stop [s], None for never.
        preset: Name of the accuracy's preset.
        spacing: Distance between particles [m] in place of the preset's, None for that.
        forced: Effects forced on or off by name.
        horizon: How far ahead the choice of effects looks [s].
        forecast_horizon: How far ahead forecasts look [s], 0 for none.
        forecast_config: File of their layers.
        forecast_max_age: Simulated time after which a forecast is withdrawn [s].
        forecast_share: Largest share of the time that the device computes forecasts.
        ensemble_members: Members of the ensembles beside them, 0 for none.
        deadline: Wall time in which a forecast and its ensemble are to be there [s], 0 for any.
        default_discharge: Discharge of a vent opened by a click [m3/s].
        default_temperature: Its temperature [Celsius].
        default_radius: Its radius [m].
        terrain_subscribe_transient_local: Whether terrain is subscribed to as a latched topic.
        record: Whether to record from the start.
        bag_directory: Bag to record to, empty for automatic.
        checkpoint_period: Wall time from one checkpoint in the bag to the next [s], 0 for none.
        bag_root: Folder of the bags, empty for automatic.
        bag_max_size: Size from which on a file of a bag is not continued [bytes], 0 for none.
        bag_max_duration: Time after which a file of a bag is not continued [s], 0 for none.
        max_particles: Most particles of the simulation.
        rules: What is asked of messages.
        lava: The material.
    """

    device: str | None = None
    msg_config: str = 'default.yaml'
    layers_on: tuple[str, ...] = ()
    layers_off: tuple[str, ...] = ()
    time_scale: float = 1.0
    end_time: float | None = None
    preset: str = DEFAULT_PRESET
    spacing: float | None = None
    forced: Mapping[str, bool] = field(default_factory=dict)
    horizon: float = HORIZON
    forecast_horizon: float = 0.0
    forecast_config: str = 'forecast.yaml'
    forecast_max_age: float = 0.0
    forecast_share: float = 1.0
    ensemble_members: int = 0
    deadline: float = 0.0
    default_discharge: float = 10.0
    default_temperature: float = 1150.0
    default_radius: float = 10.0
    terrain_subscribe_transient_local: bool = True
    record: bool = False
    bag_directory: str = ''
    checkpoint_period: float = CHECKPOINT_PERIOD
    bag_root: str = ''
    bag_max_size: int = 0
    bag_max_duration: float = 0.0
    max_particles: int = MAX_PARTICLES
    rules: InputRules = field(default_factory=InputRules)
    lava: Lava = field(default_factory=Lava)


def settings_from(values: Mapping[str, Any]) -> Settings:
    """Make settings of parameter values by name.

    Raises:
        LavaError: A value is not usable.
    """
    if not values['frame_id']:
        raise LavaError('frame_id', '', 'the name of a frame, such as map')
    validation.choice('preset', values['preset'], PRESETS)
    rules = {item.name for item in fields(InputRules)} - {'epsg', 'offset'}
    lava = Lava(**{item.name: values[LAVA + item.name] for item in fields(Lava)})
    made = {'device', 'end_time', 'spacing', 'forced', 'horizon', 'rules', 'lava'}
    made |= {'layers_on', 'layers_off', 'forecast_horizon', 'forecast_max_age'}
    ahead = 3600.0 * values['forecast_horizon']
    for name in ('ensemble_members', 'deadline'):
        if values[name] and not ahead:
            raise LavaError(name, values[name], '0 without a forecast_horizon')
    return Settings(
        **{item.name: values[item.name] for item in fields(Settings) if item.name not in made},
        device=values['device'] or None,
        layers_on=tuple(_texts('layers_on', values['layers_on'], 'layers', 'lava_points')),
        layers_off=tuple(_texts('layers_off', values['layers_off'], 'layers', 'temperature')),
        end_time=values['end_time'] or None,
        spacing=values['spacing'] or None,
        forced=_forced(values['effects_on'], values['effects_off'], lava),
        horizon=3600.0 * values['horizon'],
        forecast_horizon=ahead,
        forecast_max_age=values['forecast_max_age'] or 0.5 * ahead,
        rules=InputRules(
            **{name: values[name] for name in rules},
            epsg=values['epsg'] or None,
            offset=(values['offset_easting'], values['offset_northing']),
        ),
        lava=lava,
    )


def _forced(on: object, off: object, lava: Lava) -> dict[str, bool]:
    """The effects forced on or off, by name.

    Raises:
        LavaError: One is unknown, on and off, beside one that excludes it, or of no such material.
    """
    names_on, names_off = _names('effects_on', on), _names('effects_off', off)
    for name in names_off:
        if name in names_on:
            raise LavaError('effects_off', name, 'an effect that is not in effects_on as well')
    missing = {item.effect for item in CRITERIA if not item.exists(lava)}
    for name in names_on:
        if name in missing:
            raise LavaError(
                'effects_on', name, 'an effect that the material has by its constants, lava.*'
            )
    try:
        Effects(**{name: name in names_on for name in EFFECTS})
    except LavaError as error:
        expected = f'{error.field.removeprefix("effects.")} {error.expected}'
        raise LavaError('effects_on', names_on, expected) from None
    return {**dict.fromkeys(names_on, True), **dict.fromkeys(names_off, False)}


def _names(field: str, value: object) -> list[str]:
    names = _texts(field, value, 'effects', 'inertia')
    return [validation.choice(field, name, EFFECTS) for name in names]


def _texts(field: str, value: object, kind: str, example: str) -> list[str]:
    # ROS leaves a parameter unset that is an empty list at the start.
    if value is None:
        return []
    if not isinstance(value, list):
        raise LavaError(field, value, f"a list of {kind}, such as ['{example}']")
    # A list with one empty text is how ROS writes an empty list of texts.
    return [name for name in value if name != '']
