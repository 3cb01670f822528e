# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava effects`, `materials` and `barrier`: what is decided before a run."""

import argparse
from collections.abc import Mapping
import csv
from dataclasses import asdict, replace
import json
import math
from pathlib import Path

import numpy as np

from lava_ros.cli.options import argument, command, forced_effects, seconds_of
from lava_ros.cli.output import Progress, write_json
from lava_ros.cli.scenes import SCENE, scene_from_arguments, terrain_options
from lava_ros.effects import EFFECTS
from lava_ros.effects.effect import Effect
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write
from lava_ros.files.resources import share_path
from lava_ros.maps.gis import Provenance, write_grid
from lava_ros.maps.numbers import percent
from lava_ros.maps.plot import duration
from lava_ros.scene import Scene
from lava_ros.scene.lava import constant_units
from lava_ros.scene.materials import Constant, material_named
from lava_ros.scene.materials import materials as known_materials
from lava_ros.scene.reshaping import Barrier, low_pass, read_barriers, with_barrier
from lava_ros.scene.terrain_files import barrier_tags, load_terrain
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.selection import decide, Decision, decision_as_dict

#: What effects cost, measured by `lava bench effects`.
COSTS = 'docs/benchmarks/effects_h200.csv'


@command(
    *SCENE, '--preset', '--horizon', '--on', '--off', '--device',
    argument(
        '--measure', None, 'simulate the scene up to the horizon, and print the numbers of the '
        'flow itself', action='store_true',
    ),
    '--json',
)
def effects(args: argparse.Namespace) -> int:
    """Print which physical effects a scene needs, and why.

    A dimensionless number decides about each effect. The command prints the number that is
    expected of the flow, its threshold, what the effect costs in time, and what leaving it out
    costs in accuracy. With --measure it also prints the largest number in a run.
    """
    horizon = seconds_of('--horizon', args.horizon)
    scene, forced = scene_from_arguments(args), forced_effects(args)
    accuracy = preset_accuracy(args.preset)
    if args.measure:
        decisions = _measured(scene, forced, accuracy, horizon, args.device)
    else:
        decisions = decide(scene, forced, accuracy=accuracy, horizon=horizon)
    costs = step_costs()
    width = max(len(item.reason) for item in decisions)
    line = f'{{:16}} {{:3}} {{:{width}}}  {{:>8}}  {{:>6}}  {{}}'.format
    print(line('effect', '', 'because', 'measured', 'step', 'without it, at the threshold'))
    for item in decisions:
        cost = f'x {costs[item.name]:.2f}' if item.name in costs else '?'
        switch = 'on' if item.is_on else '-'
        measured = '-' if math.isnan(item.measured) else f'{item.measured:.2g}'
        print(line(item.name, switch, item.reason, measured, cost, _without(item.effect)))
    print(f'step: time of a step with this effect alone over one without ({COSTS}); ?: unknown')
    # None where the time of a step has not been measured
    rows = [
        {**decision_as_dict(item), 'step_time_over_bare': costs.get(item.name)}
        for item in decisions
    ]
    write_json(rows, args.json)
    return 0


def _measured(
    scene: Scene, forced: Mapping[str, bool], accuracy: Accuracy, horizon: float,
    device: str | None,
) -> tuple[Decision, ...]:
    """Simulate a scene up to a horizon [s], and return the decisions with measured numbers."""
    # the solver loads Warp, which the expected numbers do not need
    from lava_ros.simulation.simulation import Simulation

    simulation = Simulation(
        scene, effects=forced, accuracy=accuracy, device=device, horizon=horizon
    )
    with Progress() as progress:
        for _ in simulation.advancing(horizon):
            progress.show(duration(simulation.time), simulation.time / horizon)
    simulation.review(EFFECTS)
    return simulation.decisions()


def _without(effect: Effect) -> str:
    """Say what leaving an effect out costs where its number is at the threshold."""
    if not effect.cost:
        return effect.admits
    return f'{effect.admits}; {percent(effect.cost)} of the footprint'


def step_costs() -> dict[str, float]:
    """Measured time of a step with each single effect, relative to that of a step without effects.

    Raises:
        LavaError: The file of the measurements is missing from the package's data.
    """
    with share_path(COSTS).open(newline='', encoding='utf-8') as file:
        return {row['benchmark']: float(row['ratio']) for row in csv.DictReader(file)}


@command(
    argument('name', 'NAME', 'list only this lava', nargs='?'),
    argument('--json', None, 'print JSON', action='store_true'),
)
def materials(args: argparse.Namespace) -> int:
    """List the lavas that have a name, with their constants and sources.

    A scene file and the case.yaml of a case name one with lava: {material: NAME}.
    """
    chosen = [material_named(args.name)] if args.name else list(known_materials().values())
    if args.json:
        print(json.dumps([asdict(item) for item in chosen], indent=1))
        return 0
    units = constant_units()
    sources: dict[str, int] = {}
    for material in chosen:
        print(f'{material.name}: {material.title}')
        constants = {'vent_temperature': material.vent_temperature, **material.constants}
        for name, constant in constants.items():
            value = constant.value
            shown = value if isinstance(value, str) else f'{value:g}'
            print(f'  {name:22} {shown:>16} {units[name]:9} {_cited(constant, sources)}')
        print()
    for source, number in sources.items():
        print(f'[{number}] {source}')
    return 0


def _cited(constant: Constant, sources: dict[str, int]) -> str:
    """Numbers of the references of a constant and of its range."""
    text = f'[{sources.setdefault(constant.source, len(sources) + 1)}]'
    if constant.range is not None:
        number = sources.setdefault(constant.range_source, len(sources) + 1)
        text += f'  published: {constant.range[0]:g} to {constant.range[1]:g} [{number}]'
    return text


@command(
    argument('terrain', 'TERRAIN', 'GeoTIFF or another raster (docs/FORMATS.md), or npz'),
    argument('-o --output', 'FILE', 'elevation to write, .tif', required=True),
    argument(
        '--line', 'E,N', 'easting and northing [m] of two or more places along the crest',
        nargs='+',
    ),
    argument(
        '--lines', 'FILE', 'vector file of lines along crests, each with its own height [m], '
        'width [m] and slope or else those below (docs/FORMATS.md)',
    ),
    argument('--height', 'M', 'height above the ground [m]', float),
    argument('--width', 'M', 'width of the crest [m]', 10.0),
    argument('--slope', 'S', 'slope of the sides, rise over run', 1.0),
    '--low-pass', '--epsg', '--nodata',
    low_pass=0.0,
)
def barrier(args: argparse.Namespace) -> int:
    """Add barriers to a terrain, and write the result to a new file.

    The command raises the elevation along a line, or the lines of a file, and writes it as
    GeoTIFF. Where barriers overlap, the highest counts. Maps of runs on this elevation show the
    barriers. --low-pass smooths the elevation before that.
    """
    if not args.line and not args.lines and not args.low_pass:
        raise LavaError('--line', None, 'the places of a barrier, --lines, or --low-pass')
    output = file_to_write('--output', args.output, ('.tif', '.tiff'))
    terrain = load_terrain(args.terrain, **terrain_options(args))
    before = terrain = low_pass(terrain, args.low_pass)
    barriers = []
    if args.line:
        if args.height is None:
            raise LavaError('--height', None, 'a height [m]')
        line = tuple(_place(text) for text in args.line)
        barriers.append(Barrier(line, args.height, args.width, args.slope))
    if args.lines:
        usual = {'height': args.height, 'width': args.width, 'slope': args.slope}
        barriers += read_barriers('--lines', args.lines, before, usual)
    for item in barriers:
        raised = with_barrier(before, item)
        terrain = replace(
            terrain,
            elevation=np.maximum(terrain.elevation, raised.elevation),
            barriers=(*terrain.barriers, item.line),
        )
        print(
            f'barrier {item.length:.0f} m long, {item.height:g} m high, crest {item.width:g} m '
            f'wide: {item.volume:.0f} m3 of earth by its cross-section'
        )
    origin = Provenance(Path(args.terrain).name, effects=(), preset='none')
    write_grid(output, 'elevation', terrain.elevation, terrain, origin, barrier_tags(terrain))
    if barriers:
        added = (terrain.elevation - before.elevation)[terrain.has_data]
        crest = max(item.crest_on(terrain.resolution) for item in barriers)
        if any(item.crest_on(terrain.resolution) > item.width for item in barriers):
            volume = float(added.sum(dtype='float64')) * terrain.resolution**2
            print(f'with the crest widened to {crest:.3g} m, the elevation has {volume:.0f} m3')
        print(f'{int((added > 0.0).sum())} cells raised by up to {added.max():.1f} m')
    print(f'written to {output}')
    return 0


def _place(text: str) -> tuple[float, float]:
    try:
        easting, northing = map(float, text.split(','))
    except ValueError:
        raise LavaError('--line', text, 'easting,northing [m]') from None
    return easting, northing
