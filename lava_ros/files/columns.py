# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Names, synonyms and units of the columns of tables and the attributes of features.

Headers may be in any case and have synonyms and units: ``Effusion rate (m3/s)``, ``TADR``,
``start_h``, ``Easting``.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
import re
from typing import NoReturn
import unicodedata

from lava_ros import validation
from lava_ros.errors import LavaError, Typed

_NONE: Mapping[str, float] = {}

#: Units of length as ``normal_unit`` spells them [m].
LENGTHS = {
    'm': 1.0, 'km': 1000.0, 'cm': 0.01, 'ft': 0.3048, 'dm': 0.1,
    **dict.fromkeys(('metre', 'metres', 'meter', 'meters'), 1.0),
    **dict.fromkeys(('decimetre', 'decimetres', 'decimeter', 'decimeters'), 0.1),
    **dict.fromkeys(('centimetre', 'centimetres', 'centimeter', 'centimeters'), 0.01),
    **dict.fromkeys(('foot', 'feet', 'international_foot', 'international_feet'), 0.3048),
    **dict.fromkeys(('us_ft', 'ftus', 'us_survey_foot', 'us_survey_feet', 'foot_us'),
                    1200.0 / 3937.0),
}
_SECONDS = {
    's': 1.0, 'min': 60.0, 'h': 3600.0, 'd': 86400.0, 'sec': 1.0, 'second': 1.0, 'seconds': 1.0,
    'minute': 60.0, 'minutes': 60.0, 'hr': 3600.0, 'hrs': 3600.0, 'hour': 3600.0, 'hours': 3600.0,
    'day': 86400.0, 'days': 86400.0,
}
# the headers of dates
_TIME = {**_SECONDS, 'iso': 1.0, 'utc': 1.0}
_VOLUME = {
    'm3': 1.0, 'km3': 1e9, '10_6_m3': 1e6, '106_m3': 1e6, 'x10_6_m3': 1e6, '1e6_m3': 1e6,
    'million_m3': 1e6, 'mm3': 1e6, 'cubic_metres': 1.0, 'cubic_meters': 1.0,
}
_RATE = {
    f'{volume}{per}{time}{power}': number / seconds
    for per, power in (('_per_', ''), ('_', ''), ('', ''), ('_', '_1'), ('', '_1'))
    for volume, number in _VOLUME.items()
    for time, seconds in _SECONDS.items()
} | {'cumecs': 1.0}
_KELVIN = {'k': 0.0, 'kelvin': 0.0}
_CELSIUS = {'c': 273.15, 'degc': 273.15, 'deg_c': 273.15, 'celsius': 273.15}
_DEGREES = {'deg': 1.0, 'degrees': 1.0, 'dd': 1.0, 'dms': 1.0, 'wgs84': 1.0}
_ERROR = {**_RATE, '%': 0.01, 'percent': 0.01}

#: Names of each column in lower case, starting with the key, and the factors of its units to SI. A
#: column without a unit is in the first unit. A synonym of two columns means the first absent one.
COLUMNS: Mapping[str, tuple[tuple[str, ...], Mapping[str, float]]] = {
    names.split()[0]: (tuple(names.split()), units)
    for units, *columns in (
        (LENGTHS,
         'x easting east utm_e utm_x utm_easting x_utm x_coord xcoord coord_x point_x x_init '
         'x_start easting_start x0 x1',
         'y northing north utm_n utm_y utm_northing y_utm y_coord ycoord coord_y point_y '
         'y_init y_start northing_start y0 y1',
         'x_end easting_end end_x xend x1 x2',
         'y_end northing_end end_y yend y1 y2',
         'radius vent_radius r',
         'width diameter vent_width vent_diameter fissure_width',
         'height barrier_height'),
        (_DEGREES,
         'lon longitude long lng lon_start lon1',
         'lat latitude lat_start lat1',
         'lon_end longitude_end end_lon lon2',
         'lat_end latitude_end end_lat lat2'),
        (_NONE,
         'name vent vent_name name_vent flow_id label title site station',
         'share fraction weight',
         'slope side_slope'),
        (_RATE,
         'effusion_rate discharge rate q tadr discharge_rate eruption_rate '
         'time_averaged_discharge_rate mean_output_rate mor flux volume_flux volumetric_flux'),
        (_KELVIN | _CELSIUS, 'temperature temp vent_temperature eruption_temperature'),
        (_TIME,
         'start begin from start_time start_date t_start opens',
         'end stop to until end_time end_date t_end closes',
         'time t date datetime date_time timestamp elapsed elapsed_time time_since_start'),
        (_VOLUME,
         'volume vol erupted_volume',
         'cumulative_volume cum_volume volume_cumulative cumulated_volume total_volume'),
        (_ERROR,
         'error err uncertainty sigma std stdev plus_minus effusion_rate_error '
         'discharge_error rate_error tadr_error effusion_rate_uncertainty '
         'discharge_uncertainty'),
    )
    for names in columns
}

#: Words in headers of dates; numbers there are days in a spreadsheet or seconds since 1970.
_DATES = re.compile('date|timestamp|iso|utc', re.IGNORECASE)

#: Row numbers that GIS programs add.
_NUMBERS = ('fid', 'ogc_fid', 'objectid', 'gid')

#: Words for bulk and dense-rock volumes in a header.
_KINDS = {'dre': 'dense-rock', 'bulk': 'bulk'}


@dataclass(frozen=True)
class Column:
    """A known column.

    Attributes:
        header: Header in the file.
        unit: Unit in the file; empty if none.
        factor: Factor to SI.
        offset: Offset after the factor, for degrees Celsius.
        kind: ``dense-rock`` or ``bulk`` if the header has such a word, otherwise empty.
        axis: ``longitude`` or ``latitude`` if the values are angles, otherwise empty.
        is_date: True if the header names dates, so that numbers are not seconds.
    """

    header: str
    unit: str = ''
    factor: float = 1.0
    offset: float = 0.0
    kind: str = ''
    axis: str = ''
    is_date: bool = False

    def number(
        self, where: str, value: object, *, unit: str = '', **limits: float
    ) -> float:
        """Return a value in SI units, or an angle in degrees.

        ``limits`` are those of ``validation.number`` in SI units, with their ``unit``.

        Raises:
            LavaError: If the value is not valid. The error names ``where`` and the header.
        """
        label = f'{where}, {self.header}'
        if self.axis:
            # a comma in a cell is a decimal comma
            return angle(label, str(value).replace(',', '.'), self.axis)
        if self.is_date:
            expected = 'a header without the word date, such as start_s or time_h'
            raise LavaError(label, value, expected)
        # an error has the number, and its limits, in the unit of the file
        is_converted = (self.factor, self.offset) != (1.0, 0.0)
        limits = {name: (one - self.offset) / self.factor for name, one in limits.items()}
        found = validation.number(label, value, **limits, unit='' if is_converted else unit)
        if not is_converted:
            return found
        unit = 'Celsius' if self.offset else self.unit
        return Typed(found * self.factor + self.offset, f'{value} {unit}')

    def refuse(self, where: str, value: object, expected: str) -> NoReturn:
        """Raise LavaError for a value, with ``where`` and the header."""
        raise LavaError(f'{where}, {self.header}', validation.as_typed(value), expected)


def understood(
    where: str, headers: Iterable[str], wanted: Collection[str]
) -> tuple[dict[str, Column], list[str]]:
    """Find the wanted columns of a file.

    Args:
        where: Name of the file in errors.
        headers: Headers of the file.
        wanted: Columns to find, keys of ``COLUMNS``.

    Returns:
        Columns by their name in ``COLUMNS``, and the headers of all other columns.

    Raises:
        LavaError: If two columns have the same meaning, or a unit is unknown.
    """
    found: dict[str, Column] = {}
    others: list[str] = []
    read = [(header, *_parts(header)) for header in headers]
    # headers with one meaning first: x1 is the start with x2, and the end with x0
    for header, names, unit, kind in sorted(read, key=lambda item: len(item[1])):
        names = [name for name in names if name in wanted]
        if not names:
            if header.strip().lower() not in _NUMBERS:
                others.append(header)
            continue
        name = next((name for name in names if name not in found), None)
        if name is None:
            twice = f'{found[names[0]].header} and {header}'
            raise LavaError(f'columns of {where}', twice, f'one column for {names[0]}')
        units = COLUMNS[name][1]
        # brackets after a name do not contain a unit
        unit = unit if units else ''
        if unit and normal_unit(unit) not in units:
            known = ', '.join(list(units)[:4]).replace('_per_', '/')
            field = f'unit of the column {header} of {where}'
            raise LavaError(field, unit, f'a unit such as {known}')
        number = units.get(normal_unit(unit), 1.0) if unit else 1.0
        is_shift = name == 'temperature'
        found[name] = Column(
            header, unit, 1.0 if is_shift else number, number if is_shift and unit else 0.0, kind,
            {'lon': 'longitude', 'lat': 'latitude'}.get(name[:3], ''),
            bool(_DATES.search(unit or header)),
        )
    return found, [header for header, *_ in read if header in others]


@cache
def _parts(header: str) -> tuple[list[str], str, str]:
    """Return the possible columns of a header, its unit as written, and the kind of volume."""
    text = unicodedata.normalize('NFKC', header).strip()
    bracket = re.fullmatch(r'(.+?)\s*[\[(]([^\[\]()]*)[\])]', text)
    text, unit = bracket.groups() if bracket else (text, '')
    text = re.sub(r'(?<=[a-z])(?=[A-Z])', '_', text).lower()
    words = [word for word in re.split(r'[^a-z0-9%]+', text) if word]
    kind = next((_KINDS[word] for word in words if word in _KINDS), '')
    if kind and len(words) > 1:
        words = [word for word in words if word not in _KINDS]
    if normal_unit(unit) in _KINDS:
        unit, kind = '', _KINDS[normal_unit(unit)]
    for count in range(len(words), 0, -1):
        base, rest = '_'.join(words[:count]), '_'.join(words[count:])
        names = [name for name, (known, _) in COLUMNS.items() if base in known]
        # a Shapefile cuts names to 10 letters
        if not names and len(base) == 10 == len(text):
            names = [
                name for name, (known, _) in COLUMNS.items()
                if any(item.startswith(base) for item in known)
            ][:1]
        if names and (not rest or (not unit and normal_unit(rest) in COLUMNS[names[0]][1])):
            return names, unit or rest, kind
    # a column of hours or days
    if not unit and len(words) == 1 and words[0] in _SECONDS and len(words[0]) > 2:
        return ['time'], words[0], kind
    return [], unit, kind


def normal_unit(text: str) -> str:
    """Return the spelling of a unit in the tables of this module."""
    text = unicodedata.normalize('NFKC', text).lower().replace('°', 'deg').replace('^', '')
    text = text.replace('/', '_per_').strip()
    return '%' if text == '%' else re.sub(r'[^a-z0-9]+', '_', text).strip('_')


#: Maximum absolute longitude and latitude [degrees]. East of the antimeridian, maps that cross it
#: have longitudes above 180, and others from -180 up.
MAX_LONGITUDE, MAX_LATITUDE = 360.0, 90.0

#: Degrees, minutes and seconds, and the letter of a hemisphere.
_ANGLE = re.compile(
    r"""\s*(?P<before>[NSEW])?\s*(?P<sign>[-+])?\s*(?P<degrees>\d+(?:\.\d+)?)\s*(?:°|º|d|deg|:|\s)?
    (?:\s*(?P<minutes>\d+(?:\.\d+)?)\s*(?:['\u2032\u2019]|min|:|\s)?
    (?:\s*(?P<seconds>\d+(?:\.\d+)?)\s*(?:["\u2033\u201d]|\'\'|sec)?)?)?
    \s*(?P<after>[NSEW])?\s*""",
    re.VERBOSE | re.IGNORECASE,
)


def angle(field: str, value: object, axis: str) -> float:
    """Parse a longitude or latitude [degrees]: 15.006, 15°00'21.6"E, 15 0 21.6 or W 15 0.36.

    Raises:
        LavaError: If it is not an angle of the axis. The error names ``field``.
    """
    # the negative hemisphere first
    limit, letters = {
        'longitude': (MAX_LONGITUDE, 'WE'), 'latitude': (MAX_LATITUDE, 'SN'),
    }[axis]
    expected = f'a {axis} from -{limit:g} to {limit:g} degrees: -15.006 or '
    expected += f'15°00\'21.6"{letters[0]}'
    try:
        return validation.number(field, value, at_least=-limit, at_most=limit)
    except LavaError:
        parts = _ANGLE.fullmatch(value) if isinstance(value, str) else None
    if parts is not None:
        before, sign, *numbers, after = parts.groups()
        given = list(filter(None, numbers))
        size = sum(float(text) / 60.0**power for power, text in enumerate(given))
        # the sign is marked only once, and only the last number may have a fraction
        marks = ''.join(filter(None, (before, sign, after))).upper()
        if (
            size <= limit and len(marks) <= 1 and marks in f'-+{letters}'
            and all(float(text) < 60.0 for text in given[1:])
            and not any('.' in text for text in given[:-1])
        ):
            is_negative = bool(marks) and marks in f'-{letters[0]}'
            return Typed(-size if is_negative else size, str(value))
    raise LavaError(field, value, expected)
