# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Parts of the shapes in json_shapes.py: kinds of values, and objects that several shapes have."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from lava_ros.cli.console import key_of
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output import budget

Schema = dict[str, Any]


def text(meaning: str = '') -> Schema:
    """Return the schema of a text."""
    return {'type': 'string', 'description': meaning}


def number(meaning: str) -> Schema:
    """Return the schema of a number."""
    return {'type': 'number', 'description': meaning}


def count(meaning: str) -> Schema:
    """Return the schema of a whole number."""
    return {'type': 'integer', 'description': meaning}


def flag(meaning: str) -> Schema:
    """Return the schema of true or false."""
    return {'type': 'boolean', 'description': meaning}


def free(meaning: str) -> Schema:
    """Return the schema of plain data that the description explains."""
    return {'description': meaning}


def either(*values: str, meaning: str) -> Schema:
    """Return the schema of one of some texts."""
    return {'enum': list(values), 'description': meaning}


def each(item: Schema, meaning: str = '') -> Schema:
    """Return the schema of a list."""
    return {'type': 'array', 'items': item, 'description': meaning or item.get('description', '')}


def named(item: Schema, meaning: str = '') -> Schema:
    """Return the schema of an object whose keys are names."""
    meaning = meaning or item.get('description', '')
    return {'type': 'object', 'additionalProperties': item, 'description': meaning}


def unknown(schema: Schema) -> Schema:
    """Return a schema that also admits null."""
    if isinstance(schema.get('type'), str):
        return {**schema, 'type': [schema['type'], 'null']}
    return {'anyOf': [schema, {'type': 'null'}], 'description': schema.get('description', '')}


def keys(meaning: str, known: Mapping[str, Schema], *groups: Mapping[str, Schema]) -> Schema:
    """Return the schema of an object; a key that ends with ? may be missing."""
    every = {name: schema for part in (known, *groups) for name, schema in part.items()}
    return {
        'type': 'object',
        'description': meaning,
        'properties': {name.rstrip('?'): schema for name, schema in every.items()},
        'required': [name for name in every if not name.endswith('?')],
        'additionalProperties': False,
    }


NAME = text('Name')
WARNINGS = each(text(), 'What a reader of the maps must know')
DEVICE = text('Computing device')
PRESET = text('Preset of the accuracy')


def area_error(meaning: str) -> Schema:
    """Return the schema of the numerical error of an area."""
    return keys(meaning, {
        'lava?': number('Fraction: part of the particle spacing, or of the size of the cells'),
        'ground?': unknown(number("Fraction: part of the ground's cells; null: unknown")),
        'total': number('Fraction: both parts'),
    })


ERROR = keys('Numerical error', {
    'inundated': area_error('Error of the inundated area'),
    'standing': area_error('Error of the area with lava at the end'),
    'method?': text('Carriers of the lava: particles or cells'),
    'spacing_m?': number('Particle spacing, or side of a cell of lava'),
    'cell_m?': number('Side of a cell'),
    'time_s': number('Simulated time at which it was measured'),
})

LAVA = keys('Lava at the vents', {
    'material': unknown(text('Closest shipped material; null if none is close')),
    'changed_constants': each(text(), 'Constants that differ from the material'),
    'vents': each(keys('A vent', {
        'name': NAME, 'temperature_k': number('Temperature'),
        'viscosity_pa_s': number('Viscosity'),
    })),
})

#: Lava, numerical error and warnings, by which a reader judges a result.
QUALITY = {
    'erupting_lava': unknown(LAVA), 'numerical_error': unknown(ERROR), 'warnings': WARNINGS,
}

VOLUMES = {
    **{
        budget.volume_key(name): number(f'Volume {label}: {meaning}')
        for name, (label, meaning) in budget.VOLUMES.items()
    },
    'volume_error': number('Fraction of the emitted volume that is unaccounted for'),
}

def _of_field(one: Any) -> Schema:
    """Return the schema of a described field of a dataclass."""
    kind = number if 'limits' in one.metadata else text if 'choices' in one.metadata else flag
    schema = kind(one.metadata['text'])
    return unknown(schema) if one.default is None else schema


ACCURACY = keys(
    'Settings of the solver', {key_of(one): _of_field(one) for one in fields(Accuracy)}
)

DECISION = {
    'effect': NAME, 'title': text('Name for people'), 'on': flag('True if the effect is on'),
    'forced': flag('True if the user chose it'),
    'number': text('Dimensionless number that decides'),
    'value': unknown(number('Number that is expected')),
    'measured': unknown(number('Number in a run')),
    'threshold': unknown(number('Number above which the effect is on')),
    'on_since_s': unknown(number('Simulated time at which it was switched on')),
    'reason': text('Why it is on or off'),
    'without_it': text('What leaving it out changes at the threshold'),
    'footprint_without_it': unknown(
        number('Fraction of the inundated area that leaving it out changes')
    ),
    'thickness_without_it': unknown(
        number('Fraction of the thickness that leaving it out changes')
    ),
    'source': text('Source of the law'),
}

_PARTS = {
    f'arrival_p{part}_{unit}': unknown(kind(f'Arrival in {part} % of the members, or in the run'))
    for part in (10, 50, 90) for unit, kind in (('s', number), ('utc', text))
}

PLACES = each(keys('A place', {
    'name': NAME, 'kind': text('point, line or area'),
    'off_map_percent': number('Part of the place on cells without data'),
    'probability_percent': unknown(number('Probability that lava arrives')),
    'probability_text': unknown(text('The probability in words')),
    'arrival_earliest_s': unknown(number('Earliest arrival in any member')),
    'arrival_earliest_utc': unknown(text('Its date')),
    'front_distance_m': unknown(number('Distance of the place from the lava of a run')),
    **_PARTS,
    **{
        f'{name}{unit}?': unknown(number(meaning))
        for measure, unit in (('length', '_m'), ('area', '_m2'))
        for name, meaning in (
            (measure, f'Whole {measure}'),
            *((f'inundated_{measure}_p{part}', f'Inundated {measure} in {part} % of the members')
              for part in (10, 50, 90)),
        )
    },
}), 'When lava arrives at the places of --places')

SCORE = {
    'jaccard': number('Index: cells in both flows over cells in either'),
    'recall': number('Fraction of the mapped cells that are simulated'),
    'precision': number('Fraction of the simulated cells that are mapped'),
    'fit': number('Index: square root of jaccard'),
    'hits': count('Cells of both flows'), 'misses': count('Cells of the mapped flow only'),
    'false_alarms': count('Cells of the simulated flow only'),
    'inundated_area_m2': number('Inundated area'),
    'standing_area_m2': number('Area with lava at the end'),
    'mapped_area_m2': number('Mapped area'), 'runout_length_m': number('Runout length'),
    'mapped_length_m': number('Mapped runout length'),
    'volume_on_map_m3': number('Volume on the map'),
    'mean_thickness_m': number('Mean thickness'), 'median_thickness_m': number('Median thickness'),
    'largest_thickness_m': number('Largest thickness'),
    'mapped_thickness_m': number('Emitted volume over the mapped area'),
    'length_error': number('Fraction: relative error of the length'),
    'area_error': number('Fraction: relative error of the inundated area'),
    'footprint_area_error': number(
        'Fraction: relative error of the area of the cells covered at least half'
    ),
}

BRIER = {
    'cells': count('Cells with lava in a member or on the map'),
    'base_rate': number('Fraction of these cells with mapped lava'),
    'brier_score': number('Index: mean square of probability minus outcome'),
    'brier_skill': number('Index: 1 minus the ratio of brier_score to that of the base rate'),
    'brier_skill_of_terrain': number('Index: the same over all cells'),
    'largest_gap': unknown(number('Fraction: largest error of a probability')),
    'reliability?': each(keys('A range of probabilities', {
        'low': number('Fraction: lowest probability'),
        'high': number('Fraction: highest probability'),
        'forecast': number('Fraction: mean probability'), 'observed': number('Fraction with lava'),
        'count': count('Number of cells'),
    })),
}
