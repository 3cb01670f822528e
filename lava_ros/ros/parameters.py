# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node's parameters: descriptions, ranges, and the settings made of their values."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

from lava_ros import validation
from lava_ros.effects import drop_superseded, EFFECTS, Effects, possible
from lava_ros.errors import LavaError
from lava_ros.layers.layer import ZERO_CELSIUS
from lava_ros.layers.layer_files import MAX_MARGIN
from lava_ros.live.restart import check_token
from lava_ros.live.worker import MAX_PARTICLES
from lava_ros.scene import (
    constants_of,
    ENVIRONMENT,
    Lava,
    MAX_ELEVATION,
    Scene,
    VENT_TEMPERATURE_RANGE,
)
from lava_ros.scene.onset import Onset
from lava_ros.scene.uncertainty import ALL, QUANTITIES
from lava_ros.simulation.carriers import METHOD_CHOICES, METHOD_MEANING
from lava_ros.simulation.method import lacking_on_cells
from lava_ros.simulation.presets import DEFAULT as DEFAULT_PRESET
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.selection import HORIZON

#: Prefix of the parameters that are fields of ``Lava``.
LAVA = 'lava.'

#: Constraint that tools show for a parameter that is read when the node is configured.
WHEN = 'read-only while the node is configured'

#: Default wall time between checkpoints [s].
CHECKPOINT_PERIOD = 60.0

#: An element of each list, by the first word of its name.
_EXAMPLES = {
    'effects': 'inertia', 'layers': 'lava_points', 'places': 'villages.geojson',
    'quantities': 'viscosity',
}

#: Names of the types of parameters in ROS. A bool is also an int.
_TYPES = {bool: 'bool', int: 'integer', float: 'double', str: 'string', list: 'string_array'}


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter. Its type is the type of its default; a list contains strings.

    Attributes:
        description: Meaning and unit.
        limits: Smallest and largest value of a number.
        read_only: True if it is fixed while the node is configured.
        choices: Valid strings or, of a list, valid elements; empty: any.
        read: Converts the value of a parameter that is not a list to its setting.
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
        """True if the parameter is a list of strings."""
        return isinstance(self.default, list)

    @property
    def type_name(self) -> str:
        """Name of its type in ROS."""
        return next(name for kind, name in _TYPES.items() if isinstance(self.default, kind))

    @property
    def range_text(self) -> str:
        """Range of a number as a string, such as ``0 to 100``; empty without a range."""
        style = '.12g' if isinstance(self.default, float) else '.0f'
        return ' to '.join(format(limit, style) for limit in self.limits or ())

    def setting(self, value: Any) -> Any:
        """Convert a value to its setting; a list becomes a tuple without empty strings.

        Raises:
            LavaError: If a list is expected and ``value`` is not one, or it is not a valid choice.
        """
        texts = (value,)
        if self.is_list:
            if not isinstance(value, list):
                kind = self.name.partition('_')[0]
                expected = f"a list of {kind}, such as ['{_EXAMPLES[kind]}']"
                raise LavaError(self.name, value, expected)
            # in ROS, an empty list of strings is a list with one empty string
            texts = tuple(text for text in value if text != '')
        for text in texts if self.choices else ():
            validation.choice(self.name, text, self.choices)
        return texts if self.is_list else self.read(value)

    def descriptor(self) -> ParameterDescriptor:
        """Return the descriptor that tools show and rclpy checks."""
        constraints = [WHEN] * self.read_only
        if self.choices:
            constraints.append(f'{"each " * self.is_list}one of {", ".join(self.choices)}')
        result = ParameterDescriptor(
            description=self.description, additional_constraints='; '.join(constraints)
        )
        # tools may send an empty list with any type
        result.dynamic_typing = self.is_list
        if self.limits is not None and isinstance(self.default, float):
            low, high = self.limits
            result.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        elif self.limits is not None:
            low, high = (int(limit) for limit in self.limits)
            result.integer_range = [IntegerRange(from_value=low, to_value=high)]
        return result


_FixedSpec = partial(ParameterSpec, read_only=True)

#: Parameters that are read when the node starts, before it is configured.
LIFECYCLE = (_FixedSpec(
    'autostart', True,
    'Configure and activate at the start; false: wait for a lifecycle manager',
),)

#: Sea level that means that there is no sea [m].
NO_SEA = -MAX_ELEVATION

#: Sources of terrain and lava; the defaults of ``lava.*`` depend on them.
SOURCES = tuple(_FixedSpec(name, '', text) for name, text in {
    'scene': 'Scene to start with: a YAML file or its name in examples/, the folder of a case, or '
    'an elevation; empty: none',
    'terrain_file': 'Terrain to start with (GeoTIFF or another raster, npz), which replaces the '
    'terrain of the scene file; empty: from the scene file or the topics',
    'resume': 'Bag to resume from its newest checkpoint, which has its scene; empty: start at '
    'time 0',
}.items())


def _parameter(*values: Any, **options: Any) -> Any:
    """Return a field of ``Settings`` with its parameter, which has the name of the field."""
    spec = ParameterSpec('', *values, **options)
    return field(default=spec.setting(spec.default), metadata={'spec': spec})


_fixed = partial(_parameter, read_only=True)
_optional = partial(_parameter, read=lambda value: value or None)
_hours = partial(_parameter, read=lambda hours: 3600.0 * hours)


@dataclass(frozen=True)
class Settings:
    """Checked values of the parameters: one field for each, in SI units.

    A field is None if the parameter is 0, empty or negative for automatic or absent. A list of
    strings is a tuple. ``constants`` are the constants of lava and surroundings
    (``scene.constants_of``).
    """

    device: str | None = _optional(
        '', 'cpu, cuda:0, ...; empty: for particles the first GPU, otherwise the CPU; for cells '
        'the CPU', read_only=True,
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
    mask_margin: float | None = _fixed(
        -1.0,
        'Clearance of the robot [m]: the margin of keepout masks (layers with step); '
        'negative: the margin in msg_config',
        (-1.0, MAX_MARGIN),
        read=lambda margin: margin if margin >= 0.0 else None,
    )
    frame_id: str = _fixed('map', 'Frame of every input and output message (ENU)')
    publish_tf: bool = _fixed(
        True,
        'Publish the static transform from utm or earth to frame_id on /tf_static, if the terrain '
        'has a coordinate system',
    )
    time_scale: float = _parameter(
        1.0, 'Simulated seconds per second of the clock [s/s]', (1e-3, 1e6)
    )
    end_time: float | None = _optional(
        0.0, 'Simulated time [s] at which to stop; 0: never', (0.0, 1e10)
    )
    method: str = _parameter(
        METHOD_CHOICES[0],
        f'{METHOD_MEANING[0].upper()}{METHOD_MEANING[1:]}; from the next start or reset',
        choices=METHOD_CHOICES,
    )
    preset: str = _parameter(
        DEFAULT_PRESET,
        f'Accuracy: one of {", ".join(PRESETS)}; from the next start or reset',
        choices=tuple(PRESETS),
    )
    spacing: float | None = _optional(
        0.0,
        'Distance between particles, or about the size of the cells of lava [m], from the next '
        'start or reset; 0: that of the preset',
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
    error_share: float = _parameter(
        0.1,
        "Maximum fraction of one core's time for the partner runs that measure the numerical "
        'error; 0: not measured [s/s]',
        (0.0, 1.0),
    )
    ensemble_members: int = _fixed(
        0,
        'Number of members of the ensembles computed in addition to forecasts; they differ in the '
        'uncertain inputs of the scene; 0: no ensembles',
        (0, 100_000),
    )
    quantities_exact: tuple[str, ...] = _fixed(
        [''],
        'Quantities that ensembles do not draw, such as viscosity or terrain, even if the scene '
        'gives them a distribution; all: only quantities with a distribution in the scene are '
        'drawn; empty: the quantities that the scene fixes',
        choices=(ALL, *QUANTITIES),
    )
    places: tuple[str, ...] = _fixed(
        [''],
        'Files of points, lines and areas (.geojson, .gpkg, .csv); place_arrivals and the '
        'diagnostics report when lava arrives there',
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
        'Maximum number of particles, each with up to 0.8 kB of memory, or of cells with lava; '
        'beyond it the simulation stops',
        (1, 2**30),
    )
    max_input_bytes: int = _parameter(
        512 * 2**20, 'Maximum size of a message [bytes]', (64, 2**32)
    )
    epsg: int | None = _optional(
        0,
        'EPSG code of the coordinate system in which the map frame is an offset, for terrain from '
        'topics without terrain_georeference; 0: none',
        (0, 2**31),
    )
    offset_easting: float = _parameter(
        0.0, 'Easting of the map origin [m], with epsg', (-1e9, 1e9)
    )
    offset_northing: float = _parameter(
        0.0, 'Northing of the map origin [m], with epsg', (-1e9, 1e9)
    )
    sea_level: float | None = _parameter(
        NO_SEA,
        'Elevation at or below which the ground is sea [m]; lava that enters the sea leaves the '
        'map. It applies to the terrain of the scene file, of terrain_file and of topics, and if '
        'it is set while the node runs to the next terrain from a topic; '
        f'{NO_SEA:g}: that of the scene file, otherwise no sea',
        (NO_SEA, -NO_SEA), read=lambda level: level if level > NO_SEA else None,
    )
    onset: str = _fixed(
        '',
        'Date and time of the start of the simulation (simulated time 0), in UTC unless it has '
        'a time zone: 2006-07-14T22:00Z; recorded in the bag, so that pages and files made of it '
        'have dates; empty: unknown',
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
    restart_token: str = _fixed(
        '',
        'Name of the run, of letters, digits, dots, hyphens and underscores: a node that was '
        'killed and starts with the same name again resumes from its bag, in place of scene, '
        'terrain_file and resume. The launch files make one for each launch; empty: each start '
        'is a new run',
    )
    bag_root: str = _fixed(
        '', 'Folder of the bags; empty: the folder of bag_directory, otherwise bags/'
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


#: Parameters with which a terrain from a topic is read.
OF_TERRAIN = (
    'terrain_scale', 'terrain_offset', 'terrain_allow_holes', 'terrain_cloud_resolution', 'epsg',
    'offset_easting', 'offset_northing', 'sea_level',
)

#: The parameters that ``Settings`` declares.
PARAMETERS = tuple(
    replace(item.metadata['spec'], name=item.name) for item in fields(Settings) if item.metadata
)


def constant_parameters(constants: Mapping[str, Any]) -> tuple[ParameterSpec, ...]:
    """Return the parameters of surroundings and lava (``lava.*``), with their defaults."""
    lava, result = constants['lava'], []
    around = [(item, constants[item.name]) for item in fields(Scene) if item.name in ENVIRONMENT]
    for item, value in [*around, *((item, getattr(lava, item.name)) for item in fields(Lava))]:
        about, prefix = item.metadata, '' if item.name in ENVIRONMENT else LAVA
        unit = f' [{about["unit"]}]' if about.get('unit') else ''
        text = f'{about["text"]}{unit}; from the next start or reset'
        choices = tuple(about.get('choices', ()))
        # a float without the text that a user typed
        usual = float(value) if isinstance(value, float) else value
        spec = ParameterSpec(prefix + item.name, usual, text, about.get('limits'), choices=choices)
        result.append(spec)
    return tuple(result)


def constant_values(constants: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of the parameters of lava and surroundings, by name."""
    return {spec.name: spec.default for spec in constant_parameters(constants)}


def start_values(settings: Settings) -> dict[str, Any]:
    """Return the values of the parameters that take effect at a start or reset, by name."""
    given = {name: getattr(settings, name) for name in ('method', 'preset', 'spacing')}
    return given | constant_values(settings.constants)


def onset_value(text: str) -> str:
    """Return a date and time as a value of ``onset`` that YAML reads as a text.

    ``ros2 param set`` and ``ros2 param load`` fail at a text that YAML reads as a date, which is
    one with seconds, unless the offset from UTC has seconds, too.

    Raises:
        LavaError: If the text is not a date and time.
    """
    start = Onset.from_text(text, field='onset').start
    if start.second or start.microsecond:
        return f'{start.isoformat()}:00'
    return start.isoformat(timespec='minutes').replace('+00:00', 'Z')


def settings_from(values: Mapping[str, Any]) -> Settings:
    """Make the settings of parameter values by name.

    Raises:
        LavaError: If a value, or a combination of values, is not valid.
    """
    if not values['frame_id']:
        raise LavaError('frame_id', '', 'the name of a frame, such as map')
    check_token(values['restart_token'])
    if values['onset']:
        Onset.from_text(values['onset'], field='onset')
    lava = Lava.paper(**{item.name: values[LAVA + item.name] for item in fields(Lava)})
    if values['ensemble_members'] and not values['forecast_horizon']:
        raise validation.dependence('ensemble_members', 'a forecast_horizon above 0')
    settings = Settings(
        **{spec.name: spec.setting(values[spec.name]) for spec in PARAMETERS},
        constants={'lava': lava, **{name: values[name] for name in ENVIRONMENT}},
    )
    names_on = list(settings.effects_on)
    for name in settings.effects_off:
        if name in names_on:
            raise validation.conflict(f'{name} in effects_on', f'{name} in effects_off')
    for name in names_on:
        if name not in drop_superseded(possible(lava)):
            raise LavaError('effects_on', name, 'an effect for which lava.* has the constants')
    if settings.method == 'cells' and (lacking := lacking_on_cells(names_on)):
        expected = 'an effect that cells have, or method particles or auto'
        raise LavaError('effects_on', ', '.join(lacking), expected)
    try:
        Effects(**{name: name in names_on for name in EFFECTS})
    except LavaError as error:
        expected = f'{error.field.removeprefix("effects.")} {error.expected}'
        raise LavaError('effects_on', names_on, expected) from None
    return settings
