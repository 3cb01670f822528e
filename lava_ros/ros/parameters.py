# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node's parameters: descriptions, ranges, and the settings they make."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from functools import partial
from itertools import pairwise
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from lava_ros import validation
from lava_ros.effects import EFFECTS, Effects, possible, without_replaced
from lava_ros.errors import LavaError
from lava_ros.maps.layer_files import MAX_MARGIN
from lava_ros.maps.layers import ZERO_CELSIUS
from lava_ros.ros.worker import MAX_PARTICLES
from lava_ros.scene import constants_of, ENVIRONMENT, Lava, Scene, Vent, VENT_TEMPERATURE_RANGE
from lava_ros.simulation.presets import DEFAULT as DEFAULT_PRESET
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.selection import HORIZON

#: Prefix of the parameters that are fields of ``Lava``.
LAVA = 'lava.'

#: What is said of a parameter that is read when the node is configured.
WHEN = 'read-only while the node is configured'

#: Wall time from one checkpoint to the next unless the user says otherwise [s].
CHECKPOINT_PERIOD = 60.0


#: An element of each list, by the first word of its name.
_EXAMPLES = {'effects': 'inertia', 'layers': 'lava_points', 'places': 'villages.geojson'}


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter, whose default gives it its type; a list is one of texts.

    Attributes:
        description: What it means and in which unit.
        limits: Smallest and largest value, for numbers.
        read_only: Whether it is fixed while the node is configured.
        choices: The texts it may be, or have in its list; empty: any.
        read: Makes the setting of a value that is no list.
    """

    name: str
    default: Any
    description: str
    limits: tuple[float, float] | None = None
    read_only: bool = False
    choices: tuple[str, ...] = ()
    read: Callable[[Any], Any] = lambda value: value

    @property
    def is_list(self) -> bool:
        """Whether it is a list of texts."""
        return isinstance(self.default, list)

    @property
    def range_text(self) -> str:
        """Range of a number as text, such as ``0 to 100``; empty without a range."""
        style = '.12g' if isinstance(self.default, float) else '.0f'
        return ' to '.join(format(limit, style) for limit in self.limits or ())

    def setting(self, value: Any) -> Any:
        """What a value stands for in ``Settings``; a list becomes a tuple without empty texts.

        LavaError where it is no list but has to be one, or none of the choices.
        """
        texts = (value,)
        if self.is_list:
            if not isinstance(value, list):
                kind = self.name.partition('_')[0]
                example = _EXAMPLES[kind]
                raise LavaError(self.name, value, f"a list of {kind}, such as ['{example}']")
            # a list with one empty text is how ROS writes an empty list of texts
            texts = tuple(text for text in value if text != '')
        for text in texts if self.choices else ():
            validation.choice(self.name, text, self.choices)
        return texts if self.is_list else self.read(value)

    def descriptor(self) -> ParameterDescriptor:
        """The descriptor that tools show and rclpy checks."""
        constraints = [WHEN] * self.read_only
        if self.choices:
            constraints.append(f'{"each " * self.is_list}one of {", ".join(self.choices)}')
        result = ParameterDescriptor(
            description=self.description, additional_constraints='; '.join(constraints)
        )
        # An empty list has no type of its own: tools send it as one of anything.
        result.dynamic_typing = self.is_list
        if self.limits is not None and isinstance(self.default, float):
            low, high = self.limits
            result.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        elif self.limits is not None:
            low, high = (int(limit) for limit in self.limits)
            result.integer_range = [IntegerRange(from_value=low, to_value=high)]
        return result


_FixedSpec = partial(ParameterSpec, read_only=True)

#: What is known before the node is configured.
LIFECYCLE = (
    _FixedSpec(
        'autostart',
        True,
        'Configure and activate at the start; false: wait for a lifecycle manager',
    ),
)

#: What says where terrain and lava come from; the defaults of ``lava.*`` depend on it.
SOURCES = (
    _FixedSpec(
        'scene',
        '',
        'Scene file (YAML) to start with: a path, or the name of a file in examples/; empty: none',
    ),
    _FixedSpec(
        'terrain_file',
        '',
        'Terrain to start with (GeoTIFF or another raster, npz), also in place of that of the '
        'scene file; empty: from the scene file or the topics',
    ),
    _FixedSpec(
        'resume',
        '',
        'Bag to resume from its newest checkpoint, which has the scene; empty: start at time 0',
    ),
)


def _parameter(*values: Any, **options: Any) -> Any:
    """Declare a field of ``Settings`` and its parameter, whose name is that of the field."""
    spec = ParameterSpec('', *values, **options)
    return field(default=spec.setting(spec.default), metadata={'spec': spec})


_fixed = partial(_parameter, read_only=True)
_optional = partial(_parameter, read=lambda value: value or None)
_hours = partial(_parameter, read=lambda hours: 3600.0 * hours)


@dataclass(frozen=True)
class Settings:
    """What the parameters say, checked: a field for each, of its name and meaning, in SI units.

    What is automatic or absent is None, where the parameter is 0 or empty. A list of texts is a
    tuple. ``constants`` are lava and surroundings (``scene.constants_of``).
    """

    device: str | None = _optional(
        '', 'cpu, cuda:0, ...; empty: the first GPU, else the CPU', read_only=True
    )
    msg_config: str = _fixed(
        'default.yaml', 'File of the layers (YAML): a path, or the name of a file in msg_configs/'
    )
    layers_on: tuple[str, ...] = _fixed(
        [''], 'Layers of msg_config to publish even if disabled there, such as lava_points'
    )
    layers_off: tuple[str, ...] = _fixed(
        [''], 'Layers of msg_config not to publish even if enabled there'
    )
    mask_margin: float | None = _optional(
        0.0,
        'Clearance of the robot [m]: the margin of keepout masks (layers with step); '
        '0: the margin in msg_config',
        (0.0, MAX_MARGIN),
        read_only=True,
    )
    frame_id: str = _fixed('map', 'Frame of every message in and out (ENU)')
    time_scale: float = _parameter(
        1.0, 'Simulated seconds per second of the clock [s/s]', (1e-3, 1e6)
    )
    end_time: float | None = _optional(
        0.0, 'Simulated time [s] at which to stop; 0: never', (0.0, 1e10)
    )
    preset: str = _parameter(
        DEFAULT_PRESET,
        f'Accuracy: one of {", ".join(PRESETS)}; from the next start or reset on',
        choices=tuple(PRESETS),
    )
    spacing: float | None = _optional(
        0.0,
        'Distance between particles [m], from the next start or reset on; 0: that of the preset',
        (0.0, 1e4),
    )
    effects_on: tuple[str, ...] = _parameter(
        [''],
        f'Effects that are on regardless of the scene; known: {", ".join(EFFECTS)}',
        choices=tuple(EFFECTS),
    )
    effects_off: tuple[str, ...] = _parameter(
        [''], 'Effects that are off regardless of the scene', choices=tuple(EFFECTS)
    )
    horizon: float = _hours(
        HORIZON / 3600.0, 'Time ahead for which effects are chosen [h]', (1e-3, 1e5)
    )
    forecast_horizon: float = _hours(
        0.0,
        'Horizon of the forecasts, computed repeatedly while the simulation runs [h]; 0: none',
        (0.0, 1e5),
        read_only=True,
    )
    forecast_config: str = _fixed(
        'forecast.yaml',
        'File of the layers of forecasts (YAML): a path, or the name of a file in msg_configs/',
    )
    forecast_max_age: float = _parameter(
        0.0,
        'Simulated time after which a forecast is withdrawn unless there is a newer one [s]; '
        '0: half of forecast_horizon',
        (0.0, 1e10),
    )
    forecast_share: float = _parameter(
        1.0,
        'Maximum fraction of the time in which the device computes forecasts; less while the '
        'simulation falls behind the clock [s/s]',
        (0.01, 1.0),
    )
    ensemble_members: int = _fixed(
        0,
        'Number of members of the ensembles computed in addition to forecasts; they differ in the '
        'uncertain inputs of the scene; 0: no ensembles',
        (0, 100_000),
    )
    deadline: float = _parameter(
        0.0,
        'Wall time within which a forecast and its ensemble have to be ready [s]: members that '
        'would be late are left out, and each start and reset chooses the spacing accordingly; '
        '0: no deadline',
        (0.0, 1e6),
    )
    places: tuple[str, ...] = _fixed(
        [''],
        'Files of points, lines and areas (.geojson, .gpkg, .csv) for which place_arrivals and '
        'the diagnostics tell when lava arrives there',
    )
    clicked_point_enabled: bool = _fixed(
        True,
        'Subscribe to clicked_point, whose points open vents; false: clicks in RViz open no vents',
    )
    default_discharge: float = _parameter(
        10.0, 'Effusion rate of a vent opened by a click [m3/s]', (0.0, 1e6)
    )
    default_temperature: float = _parameter(
        round(constants_of(None)['lava'].reference_temperature - ZERO_CELSIUS, 2),
        'Temperature of a vent opened by a click [Celsius]',
        (VENT_TEMPERATURE_RANGE[0] - ZERO_CELSIUS, VENT_TEMPERATURE_RANGE[1] - ZERO_CELSIUS),
    )
    default_radius: float = _parameter(10.0, 'Radius of a vent opened by a click [m]', (0.01, 1e4))
    terrain_subscribe_transient_local: bool = _fixed(
        True,
        'Subscribe to terrain as a latched topic; false to receive from a volatile publisher',
    )
    terrain_scale: float = _parameter(1.0, 'Height of a unit of a terrain image [m]', (1e-6, 1e6))
    terrain_offset: float = _parameter(0.0, 'Height added to terrain images [m]', (-1e6, 1e6))
    terrain_allow_holes: bool = _parameter(
        False,
        'Accept terrain with cells without data (NaN): lava that reaches them leaves the domain',
    )
    terrain_cloud_resolution: float = _parameter(
        10.0, 'Cell size to which a terrain cloud is rasterised [m]', (1e-3, 1e4)
    )
    max_terrain_cells: int = _parameter(
        25_000_000, 'Maximum number of cells of a terrain', (4, 2**30)
    )
    max_vents: int = _parameter(1000, 'Maximum number of vents', (0, 100_000))
    max_particles: int = _parameter(
        MAX_PARTICLES,
        'Maximum number of particles, each with up to 0.8 kB of memory; beyond it the simulation '
        'stops',
        (1, 2**30),
    )
    max_input_bytes: int = _parameter(
        512 * 2**20, 'Maximum size of a message [bytes]', (64, 2**32)
    )
    epsg: int | None = _optional(
        0,
        'EPSG code of the coordinate system of which map is an offset, for terrain from topics; '
        '0: none',
        (0, 2**31),
    )
    offset_easting: float = _parameter(
        0.0, 'Easting of the map origin [m], with epsg', (-1e9, 1e9)
    )
    offset_northing: float = _parameter(
        0.0, 'Northing of the map origin [m], with epsg', (-1e9, 1e9)
    )
    record: bool = _fixed(False, 'Record, starting with the first terrain')
    bag_directory: str = _parameter(
        '',
        'Bag to record to, a new folder; empty: <bag_root>/<date and time>; while the node runs '
        'only one inside bag_root is taken',
    )
    checkpoint_period: float = _parameter(
        CHECKPOINT_PERIOD,
        'Wall time between checkpoints in the bag [s], which is the maximum time that resuming '
        'loses; a tenth of it after a change of the scene or its effects; longer while '
        'checkpoints take more than half of the bag; 0: no checkpoints',
        (0.0, 1e6),
    )
    max_saved_bytes: int = _parameter(
        10 * 2**30,
        'Maximum amount of data that ~/save writes between configuring and cleaning up [bytes]',
        (0, 2**50),
    )
    resume_since: float = _fixed(
        0.0,
        'Unix time [s]: the node resumes from the newest checkpoint in the bags that it has '
        'written since, in place of scene, terrain_file and resume; 0: it does not. The launch '
        'files use it to restart a node that was killed',
        (0.0, 1e11),
    )
    bag_root: str = _fixed(
        '', 'Folder of the bags; empty: the one that holds bag_directory, else bags/'
    )
    bag_max_size: int = _parameter(
        0, 'Size [bytes] at which the next recording continues in a new file; 0: no limit',
        (0, 2**50),
    )
    bag_max_duration: float = _parameter(
        0.0, 'Time [s] after which the next recording continues in a new file; 0: no limit',
        (0.0, 1e9),
    )
    constants: Mapping[str, Any] = field(default_factory=lambda: constants_of(None))

    @property
    def forced(self) -> dict[str, bool]:
        """The effects forced on or off, by name."""
        return {**dict.fromkeys(self.effects_on, True), **dict.fromkeys(self.effects_off, False)}

    @property
    def offset(self) -> tuple[float, float]:
        """Easting and northing of the map frame's origin [m] in the system of ``epsg``."""
        return self.offset_easting, self.offset_northing


#: The parameters that ``Settings`` declares.
PARAMETERS = tuple(
    replace(item.metadata['spec'], name=item.name) for item in fields(Settings) if item.metadata
)


def constant_parameters(constants: Mapping[str, Any]) -> tuple[ParameterSpec, ...]:
    """Parameters of surroundings and lava (``lava.*``); ``constants`` has the defaults."""
    lava, result = constants['lava'], []
    around = [(item, constants[item.name]) for item in fields(Scene) if item.name in ENVIRONMENT]
    for item, value in [*around, *((item, getattr(lava, item.name)) for item in fields(Lava))]:
        about, prefix = item.metadata, '' if item.name in ENVIRONMENT else LAVA
        unit = f' [{about["unit"]}]' if about.get('unit') else ''
        text = f'{about["text"]}{unit}; from the next start or reset on'
        choices = tuple(about.get('choices', ()))
        spec = ParameterSpec(prefix + item.name, value, text, about.get('limits'), choices=choices)
        result.append(spec)
    return tuple(result)


def constant_values(constants: Mapping[str, Any]) -> dict[str, Any]:
    """The values of the parameters of lava and surroundings, by name."""
    return {spec.name: spec.default for spec in constant_parameters(constants)}


#: Values that stand for an empty list of strings: ROS leaves a parameter unset that is an empty
#: list at the start, ``ros2 param dump`` writes it as null, and ROS reads null as a string.
_EMPTY_LISTS = (None, '', '~', 'null', 'Null', 'NULL', 'None')

#: Names of the types of parameters in ROS.
TYPES = {bool: 'bool', int: 'integer', float: 'double', str: 'string', list: 'string_array'}


def declare(node: Node, specs: tuple[ParameterSpec, ...]) -> dict[str, Any]:
    """Declare parameters that a node does not have yet.

    Returns:
        Values of all ``specs`` by name.

    Raises:
        LavaError: If a value that was given at the start has another type or is out of range.
    """
    for spec in specs:
        if not node.has_parameter(spec.name):
            given = node._parameter_overrides.get(spec.name)
            value = None if given is None else given.value
            try:
                node.declare_parameter(
                    spec.name,
                    spec.default,
                    spec.descriptor(),
                    ignore_override=spec.is_list and _is_empty(value),
                )
            except InvalidParameterTypeException:
                expected = f'a {TYPES[type(spec.default)]}'
                if isinstance(spec.default, float):
                    expected += '; a whole number is written 5.0'
                raise LavaError(spec.name, value, expected) from None
            except InvalidParameterValueException:
                raise LavaError(spec.name, value, spec.range_text) from None
    return {spec.name: plain(node.get_parameter(spec.name).value) for spec in specs}


def _is_empty(value: Any) -> bool:
    """Return True if a value stands for an empty list of strings."""
    if value is None or isinstance(value, str):
        return value in _EMPTY_LISTS
    return hasattr(value, '__len__') and len(value) == 0


def with_types(node: Node, given: Iterable[Parameter]) -> list[Parameter]:
    """Convert values that are set to the types of the node's parameters.

    ``ros2 param load`` sends 7e-07 from its own dump as a string, because a YAML number has a
    point, and null as the string None. An empty list of strings becomes a list with one empty
    string, which has a type.
    """
    result = list(given)
    for index, item in enumerate(result):
        if not node.has_parameter(item.name):
            continue
        is_list = node.describe_parameter(item.name).dynamic_typing
        is_text = isinstance(item.value, str)
        if is_list and _is_empty(item.value):
            result[index] = Parameter(item.name, value=[''])
        elif is_text and node.get_parameter(item.name).type_ == Parameter.Type.DOUBLE:
            with suppress(ValueError):
                result[index] = Parameter(item.name, value=float(item.value))
    return result


def typed(args: Sequence[str]) -> set[str]:
    """Names of the parameters that a command line sets for this node: ``-p name:=value``."""
    words = [word for flag, word in pairwise(args) if flag in ('-p', '--param')]
    return {word.partition(':=')[0].removeprefix('lava:') for word in words}


def without_effect(node: Node, typed_names: Collection[str]) -> list[str]:
    """What to say of each parameter given at the start that the node does not have.

    Files may speak to many nodes, so that one more is no error; LavaError where it was typed.
    """
    known = list(node._parameters)
    result = []
    for name in sorted(set(node._parameter_overrides) - set(known)):
        if name.startswith('qos_overrides.'):
            continue
        close = get_close_matches(name, known, 3)
        text = f'; similar names: {", ".join(close)}' if close else ''
        if name.split('.')[0] in ('vent', 'vents', *(item.name for item in fields(Vent))):
            text += '; vents come by the scene file (scene), the topic vents or clicks'
        if name in typed_names:
            value = node._parameter_overrides[name].value
            raise LavaError(f'-p {name}', value, f'a parameter that this node has{text}')
        result.append(f'this node has no parameter {name!r}: its value has no effect{text}')
    return result


def fix(node: Node, specs: Iterable[ParameterSpec], *, fixed: bool) -> None:
    """Let parameters that are read when a node is configured be set, or not, as tools are told."""
    for spec in specs:
        if spec.read_only and node.has_parameter(spec.name):
            # the descriptor in use; rclpy lets nobody put another in the place of a fixed one
            node.describe_parameter(spec.name).read_only = fixed


def put(node: Node, values: Mapping[str, Any]) -> None:
    """Set parameters of a node, all or none; LavaError where one cannot have its value."""
    if not values:
        # rclpy refuses to set nothing
        return
    new = [Parameter(name, value=value) for name, value in values.items()]
    result = node.set_parameters_atomically(new)
    if not result.successful:
        raise LavaError('parameters', dict(values), f'values that can be set ({result.reason})')


def plain(value: Any) -> Any:
    """A parameter's value, with a list in place of any array."""
    return value if value is None or isinstance(value, str | bool | int | float) else list(value)


def settings_from(values: Mapping[str, Any]) -> Settings:
    """Make settings of parameter values by name; LavaError where one is not usable."""
    if not values['frame_id']:
        raise LavaError('frame_id', '', 'the name of a frame, such as map')
    lava = Lava(**{item.name: values[LAVA + item.name] for item in fields(Lava)})
    for name in ('ensemble_members', 'deadline'):
        if values[name] and not values['forecast_horizon']:
            raise LavaError(name, values[name], '0 without a forecast_horizon')
    settings = Settings(
        **{spec.name: spec.setting(values[spec.name]) for spec in PARAMETERS},
        constants={'lava': lava, **{name: values[name] for name in ENVIRONMENT}},
    )
    names_on = list(settings.effects_on)
    for name in settings.effects_off:
        if name in names_on:
            raise LavaError('effects_off', name, 'an effect that is not in effects_on as well')
    for name in names_on:
        if name not in without_replaced(possible(lava)):
            right = 'an effect that the material has by its constants, lava.*'
            raise LavaError('effects_on', name, right)
    try:
        Effects(**{name: name in names_on for name in EFFECTS})
    except LavaError as error:
        expected = f'{error.field.removeprefix("effects.")} {error.expected}'
        raise LavaError('effects_on', names_on, expected) from None
    return settings
