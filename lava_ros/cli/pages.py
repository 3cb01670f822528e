# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arguments of commands that read runs, and the options of pages as keyword arguments."""

import argparse
from typing import Any

from lava_ros import validation
from lava_ros.cli.options import argument
from lava_ros.errors import LavaError, Typed

#: A run on disk, and several.
_TEXT = 'folder of a run or of an ensemble, bag directory, or .mcap file'
ONE_RUN = argument('bag', 'RUN', _TEXT)
RUNS = argument('bag', 'RUN', _TEXT, nargs='+')

#: Options for dates and local times.
DATES = (
    '--start',
    argument(
        '--timezone', 'ZONE', 'zone of local times: Europe/Rome (default: that of this machine)',
    ),
)


def page_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of pages as keyword arguments of ``draw_runs``."""
    from lava_ros.products.page_layout import Imprint
    from lava_ros.scene.features import load_files

    return {
        'overlays': load_files('--places', args.places),
        'observed': args.observed,
        'extent': args.extent and _extent(args.extent),
        'scale': None if args.scale is None else _scale(args.scale),
        **dates_of(args),
        'imprint': Imprint(args.author, args.agency, args.logo),
    }


def dates_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of ``DATES`` as keyword arguments."""
    from lava_ros.scene.onset import Onset, time_zone

    return {
        'onset': None if args.eruption_start is None
        else Onset.from_text(args.eruption_start, field='--start'),
        'zone': None if args.timezone is None else time_zone(args.timezone),
    }


def _extent(values: list[float]) -> list[float]:
    from lava_ros.scene import MAX_COORDINATE

    return [
        validation.number('--extent', value, at_least=-MAX_COORDINATE, at_most=MAX_COORDINATE)
        for value in values
    ]


def _scale(text: str) -> float:
    from lava_ros.products.sheet import MAX_SCALE, MIN_SCALE

    try:
        found = validation.number(
            '--scale', text.strip().removeprefix('1:'), at_least=MIN_SCALE, at_most=MAX_SCALE
        )
    except LavaError as error:
        raise LavaError('--scale', text, f'1:N with N {error.expected}') from None
    return Typed(found, text)
