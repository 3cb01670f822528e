# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Barriers of `lava run --barriers`: their file, the scene with them, and the comparison."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from lava_ros import validation
from lava_ros.cli.console import made_folder, table_lines
from lava_ros.cli.run_options import RunOptions
from lava_ros.errors import LavaError
from lava_ros.layers.numbers import area_words, duration
from lava_ros.products.comparison import compare_runs, place_texts
from lava_ros.products.gis import Provenance
from lava_ros.scene import Scene, Terrain
from lava_ros.scene.events import TerrainEvent
from lava_ros.scene.reshaping import Barrier, read_barriers, with_barriers

#: Folders of the same run or members with barriers, and of the comparison.
WITH_BARRIERS, COMPARISON = 'with_barriers', 'comparison'


def barriers_of(options: RunOptions, terrain: Terrain, until: float) -> list[Barrier]:
    """Return the barriers that the options name for a run up to a time [s], and print them.

    Raises:
        LavaError: If an argument or a file is not valid.
    """
    if not options.barriers:
        return []
    if options.observed:
        raise validation.conflict('--barriers', '--observed')
    if options.built >= until:
        expected = f'a time before the end of the run, {duration(until)}'
        raise LavaError('--barriers-at', options.built, expected)
    barriers = read_barriers('--barriers', options.barriers, terrain)
    # warns of widened crests, before the runs
    with_barriers(terrain, barriers)
    for item in barriers:
        print(item.text())
    return barriers


def dammed(scene: Scene, barriers: Sequence[Barrier], built: float) -> Scene:
    """Return the scene with barriers, which are built at a simulated time [s]."""
    if not built:
        raised = with_barriers(scene.terrain, barriers, is_told=False)
        return replace(scene, terrain=raised)
    event = TerrainEvent(built, f'{len(barriers)} barriers', barriers=tuple(barriers))
    events = sorted((*scene.events, event), key=lambda item: item.time)
    return replace(scene, events=tuple(events))


def compare(
    options: RunOptions, output: Path, folder: Path, barriers: Sequence[Barrier],
    origin: Provenance,
) -> dict[str, Any]:
    """Compare runs or ensembles without and with barriers; return plain data with the files.

    Args:
        options: The options of the command.
        output: Folder of the run or the ensemble without barriers.
        folder: Folder of the run or the ensemble with barriers.
        barriers: The barriers.
        origin: Origin of the maps, for their tags.
    """
    built = options.built
    compared = compare_runs(
        output, folder, made_folder(output / COMPARISON), places=options.places,
        lines=[options.barriers] if options.barriers and built else (), built=built, origin=origin,
    )
    described = [
        {
            'name': item.name, 'length_m': item.length, 'height_m': item.height,
            'width_m': item.width, 'volume_m3': item.volume,
        }
        for item in barriers
    ]
    return {
        'built_s': built, 'barriers': described, 'effects': list(origin.effects or ()), **compared
    }


def print_comparison(compared: dict[str, Any]) -> None:
    """Print the areas and the places without and with barriers, and the written files."""
    for name, areas in compared['area_m2'].items():
        without, built = (area_words(areas[case]) for case in ('without', 'with'))
        print(f'{name:>13}: {without} without barriers, {built} with them')
    if compared['places']:
        texts = place_texts(
            compared['places'], is_ensemble='inundated' not in compared['area_m2']
        )
        print('\n'.join(table_lines(texts, '<>>>>'[:len(texts[0])])))
    print('\n'.join(f'written to {path}' for path in compared['files']))
