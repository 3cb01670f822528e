# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""One run of a scene for `lava run`."""

from __future__ import annotations

import argparse
from dataclasses import replace
import sys
from typing import Any, TYPE_CHECKING

from lava_ros.cli.arrivals import print_arrivals
from lava_ros.cli.console import Progress, write_json
from lava_ros.errors import LavaError

if TYPE_CHECKING:
    from lava_ros.layers.place_arrivals import ArrivalTable
    from lava_ros.runs.scene_run import SceneRun
    from lava_ros.scene import Scene
    from lava_ros.simulation.numerical_error import NumericalError


def run_scene(args: argparse.Namespace) -> int:
    """Simulate a scene once, and return the exit status of `lava run`."""
    from lava_ros.cli.run_request import request_of
    from lava_ros.layers.numbers import duration
    from lava_ros.layers.place_arrivals import flow_table
    from lava_ros.layers.places import places_on
    from lava_ros.runs.scene_run import SceneRun
    from lava_ros.runs.sinks import ProgressSink
    from lava_ros.scene.features import read_features
    from lava_ros.scene.onset import Onset

    request = request_of(args)
    terrain, until = request.scene.terrain, request.until
    features = [item for file in args.places for item in read_features('--places', file, terrain)]
    places = places_on(features, terrain) if features else None
    with SceneRun(request) as made, Progress() as progress:
        if made.is_resumed:
            print(f'continuing the interrupted run in {made.folder.path}', file=sys.stderr)
        shown = ProgressSink(
            lambda time: progress.show(duration(time), time / until), until,
            lambda: progress.is_due,
        )
        try:
            snapshot = made.run(shown)
            progress.show('measuring the numerical error', 1.0)
            record = {
                'kind': 'scene', 'folder': str(made.folder.path),
                **made.finish(_measured(made)),
            }
        except KeyboardInterrupt:
            print('lava run: interrupted; the same command continues', file=sys.stderr)
            raise
    table = None
    if places is not None:
        assert snapshot.arrived is not None
        facts = {'threshold_m': snapshot.threshold, 'time_s': snapshot.time}
        table = flow_table(places, terrain, snapshot.arrived, snapshot.inundated, facts)
        table = replace(table, onset=Onset.of(request.scene))
        record['places'] = table.as_dict()['places']
    write_json(record, args.json)
    _print(record, request.scene, table)
    return 0


def _measured(made: SceneRun) -> NumericalError | None:
    """Return the numerical error of a run, None without lava or if it cannot be measured."""
    from lava_ros.forecast.partner_runs import measure_error
    from lava_ros.simulation.numerical_error import Areas

    simulation, snapshot, request = made.simulation, made.snapshot, made.request
    assert snapshot is not None
    if not snapshot.budget.emitted:
        return None
    try:
        return measure_error(
            request.scene, Areas.of(snapshot), snapshot.time, accuracy=simulation.accuracy,
            effects=simulation.effects, horizon=request.until, device=request.device,
        )
    except LavaError as error:
        print(f'lava run: the numerical error is not measured: {error}', file=sys.stderr)
        return None


def _print(record: dict[str, Any], scene: Scene, table: ArrivalTable | None) -> None:
    from lava_ros.layers.numbers import area_words, duration
    from lava_ros.scene.erupting_lava import EruptingLava
    from lava_ros.simulation.output.budget import VolumeBudget

    carriers = record['settings'].get('method', 'particles')
    resolution, across = record['resolution'], record['resolution']['particles_across']
    budget = VolumeBudget.from_texts({name: str(value) for name, value in record.items()})
    assert budget is not None
    for name, value in (
        ('simulated time', duration(record['simulated_time_s'])),
        ('start of the eruption', record['onset'] or 'unknown'),
        ('lava', EruptingLava.of(scene).text()),
        (
            'particles' if carriers == 'particles' else 'cells with lava',
            f'{record["particles"]:,}, {resolution["spacing_m"]:.3g} m apart',
        ),
        (f'{carriers} across the flow', 'unknown' if across is None else f'{across:.2g}'),
        # absent from folders of older versions
        *([('kind of flow', record['flow_kind'])] if record.get('flow_kind') else []),
        ('numerical error', record['numerical_error_text']),
        ('inundated area', area_words(record['inundated_area_m2'])),
        ('standing lava', area_words(record['standing_area_m2'])),
        *((f'volume {name}', value) for name, value in budget.rows()),
        ('wall time', f'{record["wall_time_s"]:.1f} s on {record["device"]}'),
        ('run', record['folder']),
    ):
        print(f'{name:32} {value}')
    print_arrivals(table)
    for item in record['warnings']:
        print(f'lava run: {item}', file=sys.stderr)
