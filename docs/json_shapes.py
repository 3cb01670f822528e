# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The shapes of ``--json``, as JSON Schemas, which docs/json_outputs.py writes.

A number has its unit at the end of its key. A number without a unit is a count, or its
description names it: a fraction, a ratio, an index, or a value in the `unit` beside it.
"""

from collections.abc import Mapping
import json
from pathlib import Path

from json_parts import (
    ACCURACY,
    BRIER,
    count,
    DECISION,
    DEVICE,
    each,
    either,
    ERROR,
    flag,
    free,
    keys,
    LAVA,
    NAME,
    named,
    number,
    PLACES,
    PRESET,
    QUALITY,
    Schema,
    SCORE,
    text,
    unknown,
    VOLUMES,
    WARNINGS,
)

from lava_ros.simulation.carriers import count_key, COUNTED, METHODS

FOLDER = Path(__file__).parents[1] / 'schemas'

_PERSISTENCE = {
    'brier_persistence': unknown(number('Index: brier_score of the outline before')),
    'brier_skill_persistence': unknown(number('Index: skill over the outline before')),
}

DATES = keys('Scores at dated outlines', BRIER, _PERSISTENCE, {
    'dates': each(keys('An outline', {'date': text('Date or time')}, BRIER, _PERSISTENCE)),
})

SUMMARY = {
    'warnings': WARNINGS,
    'members': count('Number of members'), 'resumed': count('Members from earlier commands'),
    'effective_members': number('Number of members of equal weight'),
    'sampling_error_percent': number('Standard error of a probability of 50 %'),
    'unseen_percent': number('Largest probability where no member has lava'),
    'arrives_before_percent': named(number('Probability of an arrival before each quantile')),
    'spacing_error': unknown(keys('Error of the particle spacing, or of the size of the cells', {
        'method': text('Carriers of the lava: particles or cells'),
        'spacing_m': number('Particle spacing, or size of the cells'),
        'pairs': count('Number of pairs of runs'),
        'delay': number('Logarithm of the ratio of arrival times'),
        'delay_spread': number('Logarithm: standard uncertainty of delay'),
        'growth': number('Logarithm of the ratio of areas'),
        'growth_spread': number('Logarithm: standard uncertainty of growth'),
        'area_error': number('Fraction of the area'),
        'is_usable': flag('True if the probabilities are usable'),
        'usable_spacing_m': number('Spacing with which they would be'),
    })),
    'horizon_s': number('Simulated time at which the members end'),
    'arrival_error_s': number('Error of the arrival times'),
    'members_beyond': count('Members whose lava left the map'),
    'inundation_threshold_m': number('Thickness at or above which lava has arrived'),
    'preset': PRESET, 'effects': each({'type': 'object'}, 'Effects at the start, with reasons'),
    'switched_on': each(keys('An effect that the flow called for', {
        'effect': NAME, 'number': number('Number that was measured'),
        'threshold': number('Number above which it is on'), 'member': count('Member'),
        'time_s': number('Simulated time'),
    })),
    'seed': count('Seed of the random numbers'),
    'workers?': count('Number of processes'), 'scheduler?': text('Address of the scheduler'),
    'device': unknown(DEVICE),
    'wall_time_s': number('Wall time of the members that this command ran'),
    'members_per_s': unknown(number('Members that ran in a second')),
    'area_m2': named(number('Area by probability of inundation')),
}
_CASE_SCORES = {'score?': keys('Score at the end', BRIER), 'dates?': DATES}
_OBSERVED = {
    'jaccard_mean': number('Index: mean agreement of the members with the observation'),
}

BARRIERS = keys('Comparison with --barriers', {
    'built_s': number('Simulated time at which they are built'),
    'barriers': each(keys('A barrier', {
        'name': NAME, 'length_m': number('Length'), 'height_m': number('Height'),
        'width_m': number('Width of the crest'), 'volume_m3': number('Volume of earth'),
    })),
    'effects': each(text(), 'Effects that are on'),
    'area_m2': named(keys('Areas', {
        'without': number('Area without barriers'), 'with': number('Area with barriers'),
    }), 'Inundated areas; those of an ensemble by probability'),
    'places': each(keys('A place', {
        'name': NAME, 'kind': text('point, line or area'),
        **{
            f'{name}_{case}': unknown(number(f'{meaning}, {case} barriers'))
            for name, meaning in {
                'probability_percent': 'Probability that lava arrives',
                **{f'arrival_p{part}_s': f'Arrival in {part} % of the members, or in the run'
                   for part in (10, 50, 90)},
            }.items()
            for case in ('without', 'with')
        },
    })),
    'files': each(text(), 'Written files'),
})

RUN_FILE = json.loads((FOLDER / 'run.schema.json').read_text(encoding='utf-8'))
_RUN = {
    name + '?' * (name not in RUN_FILE['required']): schema
    for name, schema in RUN_FILE['properties'].items() if name not in ('version', 'kind')
}


def run_keys(meaning: str, kind: str, *groups: Mapping[str, Schema]) -> Schema:
    """Return the schema of a kind of run: the keys of run.json, its folder, and its places."""
    known = {'kind': {'const': kind}, 'folder': text('Folder of the run'), 'places?': PLACES}
    mine = {name for group in groups for name in group}
    others = {name: item for name, item in _RUN.items() if name.rstrip('?') not in mine}
    return keys(meaning, known, others, *groups)


SCENE = run_keys('One run of a scene', 'scene', {'barriers?': BARRIERS})

ENSEMBLE = run_keys('An ensemble', 'ensemble', {
    **SUMMARY,
    'elevation': text('Digest of the terrain'),
    'plan': free('Horizon, accuracy and effects of the members'),
    'susceptibility': unknown(text('Digest of --susceptibility')),
    'parents': unknown(text(
        'Digest of the members near which those of --posterior are drawn, and of the observed lava'
    )),
    'quantities': keys('Uncertain quantities', {
        'drawn': named(keys('A quantity', {
            'distribution': text('Distribution'), 'source': text('Source'),
        })),
        'exact': named(text('Reason')),
    }),
    'influence': keys('Quantities that decide', {
        'rows': each(keys('A quantity', {
            'quantity': NAME, 'area': number('Fraction: change of the inundated area'),
            'area_error': number('Fraction: standard error of area'),
            'mismatch': number('Index: 1 - J of the areas before and after a change'),
            'mismatch_error': number('Index: standard error of mismatch'),
            'together': each(text(), 'Quantities that change with it'),
        })),
        'rest': unknown(number('Fraction of the variance of terrain and interaction')),
        'members': count('Number of members'), 'needed': count('Number of members needed'),
    }),
    **QUALITY,
    'difference_of_members': number('Index: mean 1 - J of two members'),
    'eruptions_cut_off?': count('Eruptions that last beyond the horizon'),
    'case?': text('Name of the mapped eruption'),
    'uncertainty?': free('Section `uncertainty` of the mapped eruption'),
    **_CASE_SCORES,
    'observed?': keys('Agreement with --observed', {
        'observation': text('File and time'), **_OBSERVED,
        'jaccard_best': number('Index: best agreement of a member'),
        'sharpness': number('Factor of the weights'),
    }),
    'posterior?': keys('Members of --posterior', SUMMARY, _OBSERVED, _CASE_SCORES, {
        'effective_parents': number('Number of first members of equal weight'),
    }),
    'barriers?': BARRIERS,
    'files': each(text(), 'Written files'),
})

CASE = run_keys('A mapped eruption', 'case', {
    'case': NAME, 'title': text('Title'), 'material': text('Material'),
    'composition_percent': named(number('Oxides of the melt, by weight')),
    'low_pass_m': number('Standard deviation of the filter of the elevation'),
    'score': keys('Comparison with the map', SCORE),
    'decisions': each(keys('An effect', DECISION)),
    'effects_error': number('Fraction of the area, because of effects that are off'),
    'evaluations': count('Number of velocity evaluations'),
    'particles_emitted?': count('Number of emitted particles; absent on cells'),
    'cell_m': number('Side of a simulated cell'),
    'runs?': keys('Rotated and mirrored runs', {
        'count': count('Number of runs'), 'chance': number('Index: mean 1 - J of two runs'),
        'jaccard': each(number('Index of each run')), 'mean': number('Index: mean of jaccard'),
        'standard_deviation': number('Index: standard deviation of jaccard'),
        'lowest': number('Index: lowest jaccard'), 'highest': number('Index: highest jaccard'),
        'length_error': each(number('Fraction: relative error of the length of each run')),
        'majority': keys('Score of the cells that half of the runs inundate', SCORE),
    }),
    'outlines?': each(keys('A dated outline', {
        'outline': text('Date or time'), 'time_s': number('Time since the start'),
        **{name: SCORE[name] for name in (
            'jaccard', 'recall', 'precision', 'footprint_area_error', 'length_error')},
        'persistence': unknown(number('Index: jaccard of the outline before')),
        'descent': number('Index: jaccard of steepest descent'),
    })),
})

SAMPLE = keys('A set of values', {
    'values': named(number('Values by constant, each in the `unit` of `unknowns`')),
    'numbers': named(keys('Results by case', {
        **{name: SCORE[name] for name in (
            'jaccard', 'recall', 'precision', 'length_error', 'footprint_area_error')},
        'single': number('Index: jaccard of the first run'),
        'eruption': number('Number of the case, from 0'),
        'fitted': number('Number: 1 if the result was fitted'),
        'directions': number('Number of runs'), 'wall_time_s': number('Wall time'),
    })),
})

CALIBRATION = keys('A calibration', {
    'cases': each(text(), 'Names of the cases'), 'preset': PRESET, 'runs': count('Sets of values'),
    'moved': each(text(), 'Constants that were searched'),
    'kept': each(text(), 'Constants that the cases state'),
    'erupting_lava': named(LAVA),
    'usual': SAMPLE, 'best': SAMPLE, 'near_best': each(SAMPLE),
    'leave_one_out': each(keys('A case', {
        'case': NAME, 'values': SAMPLE['properties']['values'],
        'jaccard': number('Index with the set that is best for the other cases'),
        'best': number('Index with its own best set'),
        'eruption': count('Number of the case, from 0'),
    })),
    'fitted': each(text(), 'Cases and outlines that were fitted'),
    'forecasts': each(keys('An outline that was not fitted', {
        'outline': text('Case and date'), 'jaccard': number('Index of the best set'),
        'persistence': unknown(number('Index of the last fitted outline')),
        'descent': number('Index of steepest descent'),
    })),
    'unknowns': each(keys('A constant', {
        'unknown': keys('The constant', {
            'name': NAME, 'unit': text('Unit'),
            'low': number('Lowest published value, in `unit`'),
            'high': number('Highest published value, in `unit`'),
            'usual': number('Value without calibration, in `unit`'), 'source': text('Source'),
            'is_log': flag('True if its logarithm is searched'),
        }),
        'best': number('Best value, in `unit`'),
        'low': number('Lowest value of a near-best set, in `unit`'),
        'high': number('Highest value of a near-best set, in `unit`'),
        'spread': number('Fraction of the published range'),
        'correlation': unknown(number('Index: rank correlation with the score')),
        'is_sensitive': flag('True if the score depends on it'),
        'quantiles': each(number('Quantiles of 5, 50 and 95 %, in `unit`')),
    })),
    'effective_sets': number('Number of sets of equal weight'),
})

PLAN = keys('A plan', {
    'until_s': number('Simulated time at which a run ends'),
    'preset': PRESET, 'spacing_m': number('Particle spacing, or size of the cells of lava'),
    'refinement': number('Ratio of the spacing of the preset standard to the spacing'),
    'members': count('Number of runs'), 'wall_time_s': number('Expected time of all runs'),
    'numerical_error': ERROR,
    'sampling_error_percent': number('Standard error of a probability of 50 %'),
    'is_finest': flag('True if more time would hardly reduce the error'),
    'pilots': count('Number of pilot runs'), 'spent_s': number('Time of the pilot runs'),
    'options': each(keys('A possible run', {
        'refinement': number('Ratio of the spacing of the preset standard to the spacing'),
        'spacing_m': number('Particle spacing'), 'wall_time_s': number('Expected time'),
        'error': ERROR,
    })),
    'presets': named(number('Ratio: refinement of each preset')),
    'inputs': named(keys('Effect of an uncertain quantity', {
        'area': number('Fraction: change of the inundated area'),
        'mismatch': number('Index: 1 - J of the areas before and after'),
    })),
    'erupting_lava': LAVA,
})

MAP = keys('Drawn maps', {
    'output': text('File'),
    'frames?': count('Number of pictures of an animation'),
    'size_bytes?': count('Size of an HTML page'),
    'title?': text('Title of a page to print'), 'summary?': text('Line below it'),
    'banner?': text('Statement on every page'), 'notes?': named(text('Facts by term')),
    'maps?': each(text(), 'Titles of the maps'),
    'scores?': named(keys('Scores of an ensemble against --observed', {
        'brier_score': BRIER['brier_score'], 'brier_skill': BRIER['brier_skill'],
    })),
    'runs?': named(keys('A run', QUALITY)),
})

ARRIVALS = keys('Arrival at places', {
    'inundation_threshold_m': number('Thickness at or above which lava has arrived'),
    'time_s?': number('Simulated time of the maps of a run'),
    'horizon_s?': number('Simulated time at which the members end'),
    **{f'{name}?': SUMMARY[name] for name in (
        'members', 'effective_members', 'unseen_percent', 'arrives_before_percent',
        'spacing_error', 'arrival_error_s',
    )},
    'note?': text('What a reader of the table must know'),
    'onset_utc': unknown(text('Date of simulated time 0')),
    'places': PLACES,
    **{f'{name}?': schema for name, schema in QUALITY.items()},
})

SPAN = {
    'start_ns': unknown(count('Time of the first message')),
    'end_ns': unknown(count('Time of the last message')),
    'message_count': count('Number of messages'),
}

INFO = keys('A bag', {
    'path': text('The bag'), 'size_bytes': count('Size'),
    'finished': flag('False if the recording was cut off, or has not ended'), **SPAN,
    'duration_s': number('Time from the first to the last message'),
    'damage': each(text(), 'Damaged parts'),
    'files': each(keys('A file', {
        'name': NAME, 'size_bytes': count('Size'), 'finished': flag('False if it was cut off'),
        **SPAN,
    })),
    'topics': each(keys('A topic', {
        'name': NAME, 'type': text('Type of the messages'),
        'type_hash': unknown(text('Hash of the type')), 'count': count('Number of messages'),
        'qos': free('QoS, as rosbag2 writes it'),
    })),
    'nodes': each(text(), 'Nodes whose maps the bag has'),
    'simulation': unknown(keys('The end of the only simulation', {
        'simulated_time_s': unknown(number('Simulated time')),
        **{f'{name}?': unknown(schema) for name, schema in VOLUMES.items()},
        'numerical_error': unknown(ERROR), 'warnings': WARNINGS,
    })),
    'checkpoints': each(keys('A checkpoint', {
        'time_s': number('Simulated time'), 'log_time_ns': count('ROS time'),
        'method': text('Carriers of the lava: particles or cells'),
        **{f'{count_key(name)}?': count(f'Number of {COUNTED[name]}') for name in METHODS},
        'size_bytes': count('Size'),
    })),
    'erupting_lava': unknown(LAVA),
    'scene': free('The scene, as the node recorded it'),
    'effects': unknown(each(keys('A change of effects', {
        'time_s': number('Simulated time'), 'stamp_ns?': count('ROS time'),
        'effects': named(text('on or off, and the reason')),
    }))),
    'resumed_from': unknown(free('Bag and simulated time of the checkpoint')),
    'custom_data': named(text('Description of the bag, as recorded')),
})

DEMO = keys('A demo', {
    'simulated_time_s': number('Simulated time'), 'particles': count('Number of particles'),
    'spacing_m': number('Particle spacing'),
    'particles_across': number('Number of particles across the flow'),
    'numerical_error_text': text('The numerical error in words'),
    **{f'numerical_error_{name}?': number(f'Fraction: {meaning}') for name, meaning in {
        'inundated': 'error of the inundated area', 'standing': 'error of the standing area',
        'lava': 'part of the particle spacing', 'ground': "part of the ground's cells",
    }.items()},
    'numerical_error_time_s?': number('Simulated time at which it was measured'),
    'inundated_area_m2': number('Inundated area'),
    'standing_area_m2': number('Area with lava at the end'), **VOLUMES,
    'warnings': WARNINGS, 'steps': count('Number of time steps'),
    'mean_speed': number('Ratio of simulated time to wall time'),
    'speed_is_limited': flag('True if --max-speed limited it'), 'device': DEVICE,
    'height_maps_received': count('Number of maps of thickness received'),
    'erupting_lava': LAVA, 'wall_time_s': number('Wall time'), 'bag': text('The bag'),
    'picture': text('The picture'),
})

INSTALL = keys('Checks of the installation', {
    'works': flag('False if a check fails'),
    'checks': each(keys('A check', {
        'check': NAME, 'level': either('OK', 'WARN', 'FAIL', meaning='Result'),
        'text': text('What was found'), 'remedy': text('What to do'),
    })),
})

SOLVER = keys('Comparison with exact solutions', {
    'preset': PRESET, 'device': DEVICE, 'accuracy': ACCURACY,
    'within_bounds': flag('True if every quantity is within its bound'),
    'runs': each(keys('A case', {
        'case': NAME, 'particles': count('Number of particles at the end'),
        'steps': count('Number of time steps'),
        'evaluations': count('Number of velocity evaluations'),
        'simulated_time_s': number('Simulated time'), 'wall_time_s': number('Wall time'),
        'measurements': each(keys('A quantity', {
            'quantity': NAME, 'measured': number('Measured value, in `unit`'),
            'exact': number('Exact value, in `unit`'), 'unit': text('Unit'),
            'scale': unknown(number('Scale of the error, in `unit`')),
            'error': number('Fraction: relative error'),
            'bound': number('Fraction: largest error that is accepted'),
            'within': flag('True if the error is within the bound'),
        })),
    })),
})

_MACHINE = {'device': DEVICE, 'machine': text('Machine'), 'command': text('Command')}

ROWS = keys('Errors and times', {'rows': each(keys('A quantity of a case at a setting', {
    'case': NAME, 'setting': text('Setting'), 'preset': text('Preset; empty for another setting'),
    'quantity': text('Quantity'), 'error': unknown(number('Fraction: relative error')),
    'measured': unknown(number('Measured value, in `unit`')),
    'exact': number('Exact value, in `unit`'), 'unit': text('Unit'),
    'particles': count('Number of particles at the end'), 'steps': count('Number of time steps'),
    'evaluations': count('Number of velocity evaluations'),
    'simulated_s': number('Simulated time'), 'wall_s': number('Median of the wall times'),
    'wall_s_per_simulated_hour': number('Wall time for an hour of simulated time'),
    'repetitions': count('Number of repetitions'), 'low_s': number('Shortest wall time'),
    'high_s': number('Longest wall time'), **_MACHINE,
}))})

SPEED = keys('Times and memory', {'rows': each(keys('A measurement', {
    'benchmark': NAME, 'particles': count('Number of particles'),
    'value': number('Median, in `unit`'), 'unit': text('Unit'),
    'low': number('Lowest value, in `unit`'), 'high': number('Highest value, in `unit`'),
    'repetitions': count('Number of repetitions'),
    'ratio?': number('Ratio to a step without effects'), **_MACHINE,
}))})

EFFECTS = keys('Effects of a scene', {
    'until_s': number('Simulated time at which a run ends'),
    'flow_kind': unknown(text('Kind of the flow, with its numbers')),
    'effects': each(keys('An effect', DECISION, {
        'step_time_over_bare': unknown(number('Ratio of a step with it to one without effects')),
    })),
})

MATERIALS = keys('Named lavas', {'materials': each(keys('A lava', {
    'name': NAME, 'title': text('Title'),
    'constants': each(keys('A constant', {
        'name': NAME, 'unit': text('Unit'),
        'value': {'type': ['number', 'string'], 'description': 'In `unit`, or the name of a law'},
        'source': text('Source'),
        'range': unknown(each(number('Published range, in `unit`'))),
        'range_source': text('Source of the range'),
        'follows': text('Constant with the same, or after - the opposite, rank'),
    })),
}))})

#: Shapes that several commands have, by their heading in the page.
SHARED: Mapping[str, Schema] = {
    'Numerical error': ERROR, 'Lava at the vents': LAVA, 'Settings of the solver': ACCURACY,
    'Places': PLACES,
}

#: The shapes of the JSON of each command.
COMMANDS: Mapping[str, tuple[Schema, ...]] = {
    'run': (SCENE, ENSEMBLE, CASE), 'calibrate': (CALIBRATION,), 'plan': (PLAN,),
    'effects': (EFFECTS,), 'materials': (MATERIALS,), 'map': (MAP,), 'places': (ARRIVALS,),
    'ros demo': (DEMO,), 'bag info': (INFO,), 'check install': (INSTALL,),
    'check solver': (SOLVER,), 'check accuracy': (ROWS,), 'check speed': (SPEED,),
}
