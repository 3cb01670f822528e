# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""One run of a scene for `lava run`."""

from collections.abc import Sequence
from dataclasses import asdict, replace
import sys
from typing import Any

from lava_ros.bag.description import is_on
from lava_ros.cli import run_barriers
from lava_ros.cli.arrivals import add_arrivals, check_places, print_arrivals
from lava_ros.cli.console import flow_facts, print_facts, write_json
from lava_ros.cli.run_options import RunOptions
from lava_ros.cli.run_request import request_of, simulated
from lava_ros.forecast.partner_runs import measure_run
from lava_ros.layers.numbers import duration
from lava_ros.layers.place_arrivals import ArrivalTable
from lava_ros.products.gis import Provenance
from lava_ros.runs.scene_run import SceneRun
from lava_ros.runs.store import FINISHED, known_record
from lava_ros.scene import Scene
from lava_ros.scene.erupting_lava import EruptingLava
from lava_ros.scene.onset import Onset
from lava_ros.scene.reshaping import Barrier


def run_scene(options: RunOptions) -> int:
    """Simulate a scene once, and return the exit status of `lava run`."""
    request = request_of(options)
    terrain = request.scene.terrain
    check_places(options.places, terrain)
    barriers = run_barriers.barriers_of(options, terrain, request.until)
    if barriers:
        built = {'barriers': [asdict(item) for item in barriers], 'built_s': options.built}
        request = replace(request, settings={**request.settings, **built})
    with simulated(request) as made:
        if barriers:
            _run_with(options, made, barriers)
        made.note_error(measure_run(made))
        facts = {'barriers': _compared(options, made, barriers)} if barriers else {}
        record = {'folder': str(made.folder.path), **made.finish(facts)}
    table = add_arrivals(record, options.places, made.folder.path)
    write_json(record, options.json)
    _print(record, request.scene, table)
    if barriers:
        run_barriers.print_comparison(record['barriers'])
    return 0


def _run_with(options: RunOptions, made: SceneRun, barriers: Sequence[Barrier]) -> None:
    """Run the scene with barriers, in a folder inside that of the run."""
    made.keep()
    request, built = made.request, options.built
    folder = made.folder.path / run_barriers.WITH_BARRIERS
    # of an interrupted comparison
    if known_record(folder).get('status') == FINISHED:
        return
    # both runs have the same particles
    chosen = made.folder.record['preset'], made.simulation.accuracy
    dammed = replace(
        request, output=folder, accuracy=lambda: chosen,
        scene=run_barriers.dammed(request.scene, barriers, built),
    )
    with simulated(dammed) as again:
        again.note_error(measure_run(again))
        again.finish()


def _compared(
    options: RunOptions, made: SceneRun, barriers: Sequence[Barrier]
) -> dict[str, Any]:
    """Compare the runs without and with barriers; return plain data."""
    folder = made.folder.path
    origin = Provenance(
        made.request.name, [name for name, text in made.effects.items() if is_on(text)],
        made.folder.record['preset'], onset=Onset.of(made.request.scene),
    )
    return run_barriers.compare(
        options, folder, folder / run_barriers.WITH_BARRIERS, barriers, origin
    )


def _print(record: dict[str, Any], scene: Scene, table: ArrivalTable | None) -> None:
    print_facts([
        ('simulated time', duration(record['simulated_time_s'])),
        ('start of the eruption', record['onset'] or 'unknown'),
        ('lava', EruptingLava.of(scene).text()),
        *flow_facts(record, record['resolution'], record['accuracy']['method']),
        ('wall time', f'{record["wall_time_s"]:.1f} s on {record["device"]}'),
        ('run', record['folder']),
    ])
    print_arrivals(table)
    for item in record['warnings']:
        print(f'lava run: {item}', file=sys.stderr)
