# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measurement of the lava of a running simulation: columns, width and resolution."""

from dataclasses import replace
from functools import cache, partial
import math
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.column import normal_thickness
from lava_ros.effects.scales import Columns, Scales, volume_quantile
from lava_ros.scene import Scene, Terrain
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.memory import read
from lava_ros.simulation.output.diagnostics import SHOWN
from lava_ros.simulation.output.inundation import footprint_cells, standing_cells
from lava_ros.simulation.output.snapshot import ParticleSample, Snapshot
from lava_ros.simulation.resolution import is_extended, Resolution
from lava_ros.simulation.selection import has_left_its_vent, scales_of
from lava_ros.simulation.setup.course import course_of, NARROW

#: Maximum number of particles that are measured; of more, every n-th is.
MAX_COLUMNS = 4096

#: Minimum measured thickness [m] and slope.
MIN_MEASURED = 1e-6


def measured_scales(
    scene: Scene, effects: Effects, sample: ParticleSample, grids: Any, *, threshold: float,
    duration: float, emitted: float,
) -> Scales:
    """Return the scales of the lava that still flows; each is measured when it is first read.

    Args:
        scene: The scene.
        effects: Effects that the estimates include.
        sample: The particles, at least one.
        grids: Maps on the device, as for a snapshot (``diagnostics.snapshot_of``).
        threshold: Minimum thickness of lava that counts as inundation [m].
        duration: Time from the start of the eruption to the horizon [s].
        emitted: Fraction of the volume at the horizon that has been emitted.
    """
    some = slice(None, None, -(-len(sample.volume) // MAX_COLUMNS))
    terrain, cell = scene.terrain, scene.terrain.resolution
    here = _cells_of(terrain, sample.position[some])
    # all lava and solidified lava, copied on the device: later maps overwrite the grids
    maps = [wp.clone(grids[n]) for n in range(0, grids.shape[0] - len(SHOWN), 2)]
    thickness = cache(partial(read, maps[0]))
    inundated = wp.clone(grids[-len(SHOWN)])

    @cache
    def wet() -> np.ndarray:
        # cells that lava only touches would widen the flow, unless it is narrower than half a cell
        inside = footprint_cells(read(inundated))
        inside[_cells_of(terrain, sample.position)] = True
        return inside & standing_cells(thickness(), threshold)

    def fall() -> float:
        sources = np.reshape([vent.position for vent in scene.vents], (-1, 2))
        heights = terrain.elevations_at(np.concatenate([sample.position, sources]))
        return float(np.nanmax(heights) - np.nanmin(heights))

    own = np.maximum(sample.thickness[some], MIN_MEASURED)
    columns: Columns = Columns.on_demand(
        volume=sample.volume[some],
        thickness=own,
        normal_thickness=lambda: normal_thickness(own, columns.ground_slope, effects),
        slope=lambda: np.maximum(_measure_slopes(terrain, here, thickness()), MIN_MEASURED),
        ground_slope=lambda: _measure_slopes(terrain, here, *map(read, maps[1:])),
        temperature=sample.temperature[some],
        speed=lambda: np.hypot(*sample.velocity[some].T),
        width=lambda: measure_widths(wet(), cell)[here],
    )
    return scales_of(
        scene,
        effects,
        columns,
        fall=fall,
        duration=duration,
        emitted=emitted,
        is_measured=True,
        is_extended=lambda: has_left_its_vent(
            np.count_nonzero(wet()) * cell**2,
            course_of(scene, effects, horizon=duration),
        ),
    )


def current_resolution(snapshot: Snapshot, accuracy: Accuracy, expected: Resolution) -> Resolution:
    """Measure how well the particles resolve a flow, and its kind.

    Args:
        snapshot: The flow on the cells of its terrain.
        accuracy: Its resolution, with all automatic values filled in.
        expected: The expected resolution, with the spacing of the simulation.

    Returns:
        The measured resolution; while the flow is too small to measure, the expected one. The kind
        is measured as soon as there is lava: a small flow may be one that no lava forms.
    """
    assert accuracy.thickness is not None
    wet, cell, kind = snapshot.standing, snapshot.terrain.resolution, expected.kind
    if snapshot.inundated is not None and (wet & snapshot.footprint).any():
        # not the cells that lava only touches
        wet = wet & snapshot.footprint
    count = np.count_nonzero(wet)
    if not count:
        return expected
    thickness, width = snapshot.thickness[wet], measure_widths(wet, cell)[wet]
    middle = volume_quantile(thickness, thickness, 0.5)
    narrow = volume_quantile(width, thickness, NARROW)
    if kind is not None:
        slope = _measure_slopes(snapshot.terrain, np.nonzero(wet), snapshot.thickness)
        stress = kind.weight * thickness * slope / np.hypot(1.0, slope)
        kind = replace(
            kind, thickness=middle, width=narrow, diameter=2.0 * cell * math.sqrt(count / math.pi),
            stress=volume_quantile(stress, thickness, 0.5), is_measured=True,
        )
    distance = expected.spacing * np.sqrt(accuracy.thickness / thickness)
    if not is_extended(count * cell**2, float(np.median(distance))):
        return replace(expected, kind=kind)
    return Resolution(
        spacing=expected.spacing,
        thickness=middle,
        width=narrow,
        across=volume_quantile(width / distance, thickness, NARROW),
        cell=cell,
        limit='measured',
        kind=kind,
        method=accuracy.method,
    )


def measure_widths(wet: np.ndarray, cell: float) -> np.ndarray:
    """Measure the width of a flow at each of its cells: the shortest chord through the cell.

    The chords run along rows, columns and both diagonals.

    Args:
        wet: The cells with lava, bool, shape [rows, columns].
        cell: Size of a cell [m].

    Returns:
        The width [m], float64, same shape, 0 without lava.
    """
    found, (i, j) = np.zeros(wet.shape), np.nonzero(wet)
    if i.size:
        straight = np.minimum(_measure_runs(i, j), _measure_runs(j, i))
        diagonal = np.minimum(_measure_runs(i + j, i), _measure_runs(i - j, i))
        found[wet] = np.minimum(straight * cell, diagonal * (math.sqrt(2.0) * cell))
    return found


def _measure_runs(line: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return the length of the run of adjacent cells that contains each cell [cells].

    ``line`` and ``place`` are the number of a cell's line and its place on that, shape [cells].
    """
    # cells of different lines are not adjacent
    number = line * (np.ptp(place) + 2) + place
    order = np.argsort(number, kind='stable')
    ends = np.flatnonzero(np.diff(number[order]) != 1) + 1
    lengths = np.diff(ends, prepend=0, append=number.size)
    found = np.empty_like(number)
    found[order] = np.repeat(lengths, lengths)
    return found


def _measure_slopes(
    terrain: Terrain, here: tuple[np.ndarray, np.ndarray], *layers: np.ndarray
) -> np.ndarray:
    """Return the slope of some cells, rise over run, 0 next to cells without data.

    ``layers`` are thicknesses of lava on the terrain [m], shape [rows, columns].
    """
    places, last = np.stack(here), np.subtract(terrain.shape, 1)[:, None]

    def heights(*cells: np.ndarray) -> np.ndarray:
        ground = terrain.elevation[cells].astype(np.float64)
        return sum((np.fmax(layer[cells], 0.0) for layer in layers), ground)

    rises = []
    for step in np.eye(2, dtype=int)[:, :, None]:
        low, high = np.maximum(places - step, 0), np.minimum(places + step, last)
        rises.append((heights(*high) - heights(*low)) / np.maximum((high - low).sum(axis=0), 1))
    return np.nan_to_num(np.hypot(*rises) / terrain.resolution)


def _cells_of(terrain: Terrain, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns of the (nearest) cells at map positions [m]."""
    found = np.floor((places - terrain.origin) / terrain.resolution).astype(int)
    rows, columns = terrain.shape
    return np.clip(found[:, 1], 0, rows - 1), np.clip(found[:, 0], 0, columns - 1)
