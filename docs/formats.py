# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write the tables of file formats into docs/FORMATS.md: `python docs/formats.py`."""

from collections.abc import Iterator
from functools import partial
import json
from pathlib import Path

from lava_ros.files import raster_formats, vectors
from lava_ros.files.columns import COLUMNS
from lava_ros.files.keys import DATE, Keys, Schema
from lava_ros.layers.layer_files import LAYER_KEYS
from lava_ros.scene import effusion_rates, features, measurements, reshaping, vent_files
from lava_ros.scene.emplaced import FLOW_KEYS
from lava_ros.scene.events import SCENE_EVENT_KEYS
from lava_ros.scene.file_keys import CASE_KEYS, SCENE_KEYS
from lava_ros.scene.terrain_files import TERRAIN_KEYS
from lava_ros.scene.uncertainty import UNCERTAINTY_KEYS
from lava_ros.scene.vent_keys import VENT_KEYS

PAGE = Path(__file__).with_name('FORMATS.md')

#: JSON Schema of ``run.json``.
SCHEMA = Path(__file__).parents[1] / 'schemas/run.schema.json'

#: Meaning of each column, in its unit unless the header states another.
MEANINGS = {
    'x': 'easting [m] in the coordinate system of the terrain',
    'y': 'northing [m]',
    'x_end': 'easting of the other end of a line [m]',
    'y_end': 'northing of the other end of a line [m]',
    'lon': 'longitude: degrees, or degrees, minutes and seconds',
    'lat': 'latitude, in the same notation',
    'lon_end': 'longitude of the other end of a line',
    'lat_end': 'latitude of the other end of a line',
    'name': 'name',
    'effusion_rate': 'effusion rate [m3/s]',
    'temperature': 'temperature of the lava [K]',
    'radius': 'radius of a vent, or half the width of a fissure [m]',
    'width': 'twice the radius, or the width of the crest of a barrier [m]',
    'share': 'weight of a vent when vents divide an effusion rate',
    'start': 'start of an interval ([s] or a date), or when a vent opens [s]',
    'end': 'end of an interval ([s] or a date), or when a vent closes [s]',
    'time': 'an instant: [s], or for rates also a date',
    'volume': 'volume that comes out in an interval [m3]',
    'cumulative_volume': 'volume that has come out by an instant [m3]',
    'height': 'height of a barrier above the ground [m]',
    'slope': 'slope of the sides of a barrier, rise over run',
    'error': 'standard error of the effusion rate [m3/s], or [%]',
}


def raster_rows() -> Iterator[tuple[str, ...]]:
    """Yield a row for each raster format."""
    yield ('format', 'file names', 'read by GDAL driver', 'limits', 'written')
    for item in raster_formats.FORMATS:
        names = ', '.join(f'`{suffix}`' for suffix in item.suffixes)
        yield (item.name, names, item.driver, item.notes, item.written)
    arrays = 'arrays with the names of `lava_ros.scene.terrain_files`'
    yield ('NumPy archive', '`.npz`', '', arrays, '')


def vector_rows() -> Iterator[tuple[str, ...]]:
    """Yield a row for each vector format."""
    yield ('format', 'read', '`--formats`', 'coordinates')
    for ending, known in vectors.FORMATS.items():
        names = [ending, *(other for other, own in vectors.ALIASES.items() if own == ending)]
        names += [other for other, own in vectors.ARCHIVES.items() if ending in own]
        # a written zip contains a Shapefile
        written = [
            name for name in names
            if name in vectors.WRITTEN and (name != 'zip' or ending == 'shp')
        ]
        yield (
            known.name,
            _endings(names) + (', all layers' if known.has_layers else ''),
            _endings(written, ''),
            'longitude, latitude' if known.is_degrees else 'those of the file',
        )
    yield (
        'table', _endings([ending[1:] for ending in features.TABLES]),
        '`csv` (areas as well-known text)', 'those of the terrain, or longitude, latitude',
    )


def _endings(names: list[str], dot: str = '.') -> str:
    return ', '.join(f'`{dot}{name}`' for name in names)


def column_rows() -> Iterator[tuple[str, ...]]:
    """Yield a row for each column of a table or attribute of a feature."""
    ends = ('', '_end')
    places = [f'{name}{end}' for pair in features.PLACES for name in pair for end in ends]
    uses = {
        'places': (*places, 'name'),
        'vents': vent_files.COLUMNS,
        'barriers': ('name', *reshaping.LIMITS),
        'rates': effusion_rates.COLUMNS,
    }
    yield ('column', 'meaning', 'of', 'other names')
    for name, (known, _) in COLUMNS.items():
        where = ', '.join(use for use, names in uses.items() if name in names)
        yield (f'`{name}`', MEANINGS[name], where, _endings(list(known[1:]), ''))


def survey_rows() -> Iterator[tuple[str, ...]]:
    """Yield a row for each survey of a terrain, with its errors."""
    yield ('`terrain: {survey: ...}`', 'survey', 'standard deviation', 'correlation', 'source')
    for name, item in measurements.SURVEYS.items():
        errors = item.roughness
        yield (
            f'`{name}`', item.title, f'{errors.deviation:g} m', f'{errors.correlation:g} m',
            item.source,
        )


def run_rows() -> Iterator[tuple[str, ...]]:
    """Yield a row for each key of ``run.json``, from its JSON Schema."""
    yield ('key', 'content')
    schema = json.loads(SCHEMA.read_text(encoding='utf-8'))
    for name, item in schema['properties'].items():
        yield (f'`{name}`', item['description'])


#: Signs of the limits of a number.
LIMITS = {'exclusiveMinimum': '>', 'minimum': '≥', 'exclusiveMaximum': '<', 'maximum': '≤'}

#: Maximum number of words that a table lists.
MAX_WORDS = 4


def key_rows(keys: Keys) -> Iterator[tuple[str, ...]]:
    """Yield a row for each key of a mapping in a file."""
    yield ('key', 'values', 'content')
    for name, key in keys.keys.items():
        known = values_of(key.as_schema()) + (', required' if key.is_required else '')
        yield (f'`{name}`', known, key.text)


def values_of(schema: Schema) -> str:
    """Describe the values of a schema in a few words."""
    for word in ('anyOf', 'allOf'):
        if word in schema:
            return ' or '.join(dict.fromkeys(map(values_of, schema[word])))
    if '$ref' in schema:
        return schema['$ref'].rpartition('/')[2]
    words = schema.get('enum', [schema['const']] if 'const' in schema else [])
    if words:
        return ', '.join(f'`{word}`' for word in words) if len(words) <= MAX_WORDS else 'a name'
    kind = schema.get('type')
    if isinstance(kind, list):
        return ' or '.join(values_of({'type': item}) for item in kind)
    if kind in ('number', 'integer'):
        word = 'whole number' if kind == 'integer' else 'number'
        known = {sign: schema[name] for name, sign in LIMITS.items() if name in schema}
        limits = [f'{sign} {limit:,.10g}' for sign, limit in known.items()]
        return f'{word} {" and ".join(limits)}'.strip()
    if kind == 'array':
        least, most = schema.get('minItems', 0), schema.get('maxItems')
        return f'{least} numbers' if least == most else 'list'
    if schema.get('pattern') == DATE['pattern']:
        return 'date'
    return {'boolean': '`true`, `false`', 'object': 'mapping'}.get(kind or '', 'text')


#: Rows of tables, by the name of their section.
TABLES = {
    'rasters': raster_rows, 'vectors': vector_rows, 'columns': column_rows, 'run': run_rows,
    'surveys': survey_rows,
} | {
    f'keys of {name}': partial(key_rows, keys) for name, keys in {
        'scene': SCENE_KEYS, 'terrain': TERRAIN_KEYS, 'vent': VENT_KEYS, 'flow': FLOW_KEYS,
        'event': SCENE_EVENT_KEYS, 'barrier': reshaping.BARRIER_KEYS,
        'uncertainty': UNCERTAINTY_KEYS, 'case': CASE_KEYS, 'layer': LAYER_KEYS,
    }.items()
}


def table(rows: Iterator[tuple[str, ...]]) -> str:
    """Return a Markdown table; the first row is its head."""
    lines = [f'| {" | ".join(row)} |'.replace('  |', ' |') for row in rows]
    return '\n'.join([lines[0], f'|{"---|" * (lines[0].count("|") - 1)}', *lines[1:], ''])


def page(text: str) -> str:
    """Return the page with its tables up to date."""
    for name, rows in TABLES.items():
        begin, end = f'<!-- {name}: begin -->\n', f'<!-- {name}: end -->\n'
        before, _, rest = text.partition(begin)
        text = f'{before}{begin}\n{table(rows())}\n{end}{rest.partition(end)[2]}'
    return text


if __name__ == '__main__':
    PAGE.write_text(page(PAGE.read_text(encoding='utf-8')), encoding='utf-8')
