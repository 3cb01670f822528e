# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava run`: simulate a scene, an ensemble or a mapped eruption, without ROS."""

import argparse
from collections.abc import Iterable
from functools import partial

from lava_ros import validation
from lava_ros.cli.options import (
    Argument,
    argument,
    command,
    DEFAULT_PRESET,
    formats,
    in_group,
    long_name,
    output_option,
    refuse_options,
    shared,
)
from lava_ros.cli.scene_options import is_case, refuse_for_case, SCENE, UNTIL

#: Options of ensembles.
_ENSEMBLE = in_group(
    'ensembles, with --members',
    shared('--seed', '0'),
    argument(
        '--susceptibility', 'FILE', 'raster of the relative likelihood that the vent opens in a '
        'cell; replaces the position of the vent',
    ),
    argument(
        '--observed', 'FILE', 'observed lava: a raster with values above 0, or areas (a vector '
        'file); the better a member agrees with it, the more it counts in the maps in the folder '
        'weighted',
    ),
    argument(
        '--observed-at', 'TIME', 'time of the observation, counted from the start of the scene'
    ),
    argument(
        '--posterior', 'N', 'number of further members to draw near those that agree with the '
        'observed lava, with their maps in the folder posterior_<time> (default: none)', int,
    ),
    argument(
        '--workers', 'N', 'number of processes (default: one for each GPU, several if it has 512 '
        'members or more; without a GPU one for each core)', int,
    ),
    argument(
        '--scheduler', 'ADDRESS', 'address of a Dask scheduler that runs the members: '
        'tls://host:8786',
    ),
    formats('areas of 10, 50 and 90 %% probability, isochrones', None),
)

#: Options about barriers, also of ensembles.
_BARRIERS = in_group(
    'barriers',
    argument(
        '--barriers', 'FILE', 'vector file of lines along the crests of barriers with their '
        'height [m], width [m] and slope (docs/FORMATS.md): run a second time with them, and '
        'compare',
    ),
    argument('--barriers-at', 'TIME', 'time at which the barriers are built (default: the start)'),
)

#: Options of mapped eruptions.
_CASE = in_group(
    'mapped eruptions',
    argument(
        '--runs', 'N', 'make N more runs of a mapped eruption, rotated and mirrored, and report '
        'their scatter and the area that at least half of them cover; from 2 to 8, which are all '
        'directions (default: none)', 1,
    ),
    argument(
        '--mobility-limit', 'U', 'maximum speed of lava over its slope [m/s]: faster lava moves '
        'as if its viscosity were higher (default: one that bounds the time of a run of lava that '
        'is fluid at the vent, and none for other lava)', float,
    ),
    argument(
        '--from-outline', 'TIME', 'start from the mapped outline of this time, in s of the clock '
        'of the case or as a date: lava that erupted before lies in it, and later outlines are '
        'scored (default: that of the case, or the start of the eruption)',
    ),
    argument(
        '--solidified', 'F', 'lower fraction of the lava in this outline that is solid, and part '
        'of the ground (default: 0)', float,
    ),
    shared('--low-pass', 'that of the case'),
)

#: Options of one run of a scene, and those of its vents.
_MAPS = ('--at',)
_VENTS = ('--vent', '--vents', '--effusion-rate')

#: Default preset of an ensemble.
ENSEMBLE_PRESET = 'draft'


@command(
    *SCENE,
    UNTIL,
    output_option(
        'DIR', 'folder of the results: new, empty, of an interrupted run of the same scene, or of '
        'the same ensemble (default: runs/<scene>, runs/<case>_<preset> or runs/<scene>_ensemble, '
        'with a number if that is another run)',
    ),
    argument('--maps', 'N', 'number of maps, evenly spaced over the simulated time', 24),
    shared(
        '--at', 'those of --maps; further times, may be repeated', action='append', default=[],
        dest='at',
    ),
    '--places', '--method',
    shared('--preset', f'{DEFAULT_PRESET}; of an ensemble, {ENSEMBLE_PRESET}', default=None),
    '--spacing', '--within', '--error', '--on', '--off', '--threshold', '--device', '--json',
    argument(
        '--members', 'N', 'run an ensemble of N members, with values drawn for the uncertain '
        'quantities, and map the probability of lava', int,
    ),
    *_ENSEMBLE, *_BARRIERS, *_CASE,
)
def run(args: argparse.Namespace) -> int:
    """Simulate a scene, an ensemble or a mapped eruption, and write a folder with its maps.

    The folder of a run has run.json, which describes the run and its result, and the maps as a
    rosbag2 bag. ROS is not needed. The same command continues an interrupted run, and never
    changes a finished one.

    With --members the command runs an ensemble: it draws a value of each uncertain quantity for
    each member, from the distributions in the section `uncertainty` of a scene, the published
    ranges of the lava, and the usual errors of effusion rates, vents and ground, except for the
    quantities that the section lists as `exact`. It writes the probability of inundation, the
    times by which lava has reached a cell in 10, 50 and 90 % of the members, the expected
    thickness, and the earliest arrival and largest thickness of any member, as GeoTIFF and as a
    bag. With more members the same command adds them to a finished ensemble.

    With --barriers the run or the members run a second time, with barriers; the folder comparison
    has what the barriers change.

    If SCENE is the folder of a mapped eruption (docs/VALIDATION.md), the command simulates the
    eruption and compares the flow with the map. With --members it scores the probability instead,
    and at the dates of the outlines if there are any.
    """
    # loads the reader of scenes, which other commands do not need
    from lava_ros.cli.run_options import run_options

    of_case = is_case(args)
    is_ensemble = args.members is not None
    refuse = partial(refuse_options, args, run.arguments)
    if is_ensemble:
        refuse((*_MAPS, '--maps'), lambda name: validation.conflict(name, '--members'))
    else:
        refuse(_names(_ENSEMBLE), lambda name: validation.dependence(name, '--members'))
    if of_case:
        unused = _VENTS if is_ensemble else ('--threshold', *_names(_BARRIERS))
        refuse_for_case(args, run.arguments, (*_MAPS, *unused))
    if not of_case or is_ensemble:
        other = 'the folder of a mapped eruption' + ' without --members' * is_ensemble
        refuse(_names(_CASE), lambda name: validation.dependence(name, other))
    for chosen, others in (
        ('spacing', ('--within', '--error')), ('within', ('--error', '--preset')),
        ('error', ('--preset',)),
    ):
        if getattr(args, chosen) is not None:
            refuse(others, partial(validation.conflict, f'--{chosen}'))
    options = run_options(args, ENSEMBLE_PRESET if is_ensemble else DEFAULT_PRESET)
    if is_ensemble:
        from lava_ros.cli.run_ensemble import run_members as start
    elif of_case:
        from lava_ros.cli.run_case import run_case as start
    else:
        from lava_ros.cli.run_scene import run_scene as start
    return start(options)


def _names(declared: Iterable[Argument]) -> list[str]:
    return [long_name(names) for names, _ in declared]
