# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulation of a hard scene, with checks of the invariants and of two comparisons of runs.

halving   With steps half as long the radius of the inundated area changes by no more than the
          preset's stated error of the edge, a cell of the border, and scatter. A cell: two, one
          more and one less, or as many as symmetric images in a footprint that is its own mirror
          image. With few particles the scatter is whole cells, because they are emitted, leave and
          fall at the ends of steps: equivalent runs differ. It is measured for any scene in one
          way, as the change against ``DRAWS`` runs whose steps are shorter by up to ``SHORTER``
          (their error is the same except for that fraction) and whose positions are shifted by
          ``SHAKEN``. In 99 of 100 cases one more such run, like the halved one if it has no error
          of its own, is below their mean and ``STUDENT`` standard deviations. They only run if the
          change exceeds the bound without scatter. Of hundreds of runs some exceed the bound by
          chance: such a run is repeated with a quarter of the steps, and fails if the change is
          as large. An error of first order in the step then changes by half as much again.
symmetry  At ``reference`` a mirrored scene's thickness differs from its mirror image by no more
          than ``MIRRORED`` of the largest, at every frame until the scene's ``mirrored_until``.
left, rest, distinct, spread, cost, solidified
          Requirements of single scenes: ``case.HardScene``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
import math
import time as wall_clock
from typing import Any

import numpy as np

from hard import cells
from hard.case import HardScene, PHYSICS
from hard.ground import is_on_cells, terrain_of
from hard.invariants import Violation, Watch
from lava_ros.effects import Effects
from lava_ros.simulation import Particles, Simulation, Snapshot
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.cells import state as cell_state
from lava_ros.simulation.output.snapshot import ParticleSample
from lava_ros.simulation.particles.layout import TIME
from lava_ros.simulation.presets import preset_accuracy, PRESETS

#: The presets that have to keep the invariants.
KEPT = ('draft', 'standard', 'fine', 'reference')

#: The presets that have to keep the invariants, by method. On cells `fine` equals `standard`.
PRESETS_OF = {'particles': KEPT, 'cells': tuple(name for name in KEPT if name != 'fine')}

#: Maximum difference of a mirrored scene's thickness from its mirror image, over the largest.
MIRRORED = 1e-6

#: Number of runs for estimating the scatter of a footprint.
DRAWS = 8

#: Maximum relative shortening of their steps, and shift of positions in cells: too small to change
#: the error of the step, or the flow.
SHORTER, SHAKEN = 0.125, 1e-2

#: Student's t of 99 % with ``DRAWS`` - 1 degrees of freedom, for one additional draw.
STUDENT = 2.998 * math.sqrt(1.0 + 1.0 / DRAWS)


@dataclass
class Outcome:
    """Result of a scene at a preset, both by name; times are in seconds.

    Attributes:
        time: Simulated time reached, of ``until``.
        evaluations: Velocity evaluations.
        smallest_step: Minimum mean step of a frame.
        cost: Maximum number of evaluations per simulated second of a frame.
        volume_error: Maximum fraction of the volume that is unaccounted for.
        footprint_change: Relative change of the footprint's radius with steps half as long.
        footprint_bound: Maximum of that change.
        asymmetry: Difference from the mirror image over the largest thickness; NaN if unchecked.
        is_cut: True if the run was stopped before its end.
    """

    scene: str
    preset: str
    time: float = 0.0
    until: float = math.nan
    particles: int = 0
    steps: int = 0
    evaluations: int = 0
    smallest_step: float = math.inf
    cost: float = 0.0
    volume_error: float = 0.0
    footprint_change: float = math.nan
    footprint_bound: float = math.nan
    asymmetry: float = math.nan
    violations: list[Violation] = field(default_factory=list)
    wall_time: float = 0.0
    is_cut: bool = False

    @property
    def verdict(self) -> str:
        """The violated invariants, or ``holds``."""
        names = sorted({item.invariant for item in self.violations})
        if names:
            return ' '.join(names)
        return 'cut off' if self.is_cut else 'holds'


def play(
    item: HardScene, preset: str, *, method: str = 'particles', device: str | None = 'cpu',
    compare: bool = True, wall_limit: float | None = None,
) -> Outcome:
    """Run a scene at a preset with checks, and stop it after a wall time [s].

    ``compare`` runs it again with steps half as long.
    """
    start = wall_clock.monotonic()
    outcome = Outcome(item.name, preset, until=item.until)
    accuracy = replace(preset_accuracy(preset), method=method, thickness=item.thickness)
    if item.longest_step is not None:
        accuracy = replace(accuracy, longest_step=item.longest_step)
    simulation = simulation_of(item, accuracy, device)
    watch = Watch(simulation, dry=item.dry, raises=False)
    before, lengths = simulation.sample(), []
    for moment in _moments(item, accuracy.fixed_step):
        begun = simulation.time, simulation.steps
        outcome.is_cut = not _advance(simulation, item, moment, start, wall_limit)
        lengths.append((simulation.time - begun[0]) / max(simulation.steps - begun[1], 1))
        snapshot = simulation.snapshot()
        watch.check(snapshot)
        outcome.volume_error = max(outcome.volume_error, snapshot.budget.error)
        if preset == 'reference' and item.mirrored and moment <= item.mirrored_until:
            outcome.asymmetry = max(asymmetry(snapshot), np.nan_to_num(outcome.asymmetry))
        if watch.violations or outcome.is_cut:
            break
    outcome.violations = list(watch.violations)
    snapshot = simulation.snapshot()
    outcome.time, outcome.particles = simulation.time, simulation.particle_count
    outcome.steps, outcome.evaluations = snapshot.steps.count, snapshot.steps.evaluations
    outcome.smallest_step, outcome.cost = watch.cost.smallest_step, watch.cost.highest
    if not outcome.violations and not outcome.is_cut:
        for asked in _requirements(item, outcome, before, simulation):
            _require(outcome, *asked)
        if compare and item.halved:
            _compare(item, outcome, simulation, lengths)
    outcome.wall_time = wall_clock.monotonic() - start
    return outcome


def _requirements(
    item: HardScene, outcome: Outcome, before: ParticleSample, simulation: Simulation
) -> Iterator[tuple[str, float, float]]:
    """Yield the requirements of a single scene: the invariant, its value, and its maximum."""
    places = simulation.sample().position
    if item.still:
        moved = math.inf
        if len(places) == len(before.position):
            one, other = (array[np.lexsort(array.T)] for array in (before.position, places))
            moved = float(np.abs(one - other).max())
            if is_on_cells(simulation):
                moved += float(np.abs(before.thickness - simulation.sample().thickness).max())
        # a float32 has 2^-24 of half the map
        yield 'rest', moved, 2.0**-22 * max(simulation.scene.terrain.extent)
    if item.distinct:
        yield 'distinct', len(places) - len(np.unique(places, axis=0)), 0
    if outcome.preset in item.most_steps and not is_on_cells(simulation):
        yield 'cost', outcome.steps, item.most_steps[outcome.preset]
    if item.reaches:
        yield 'spread', -float(np.hypot(*places.T).max(initial=0.0)), -item.reaches
    if item.solidified < 1.0:
        budget = simulation.budget()
        yield 'solidified', budget.solidified, item.solidified * budget.emitted
    if item.closed:
        yield 'left', simulation.budget().lost, 0.0
    if outcome.preset == 'reference' and item.mirrored:
        yield 'symmetry', outcome.asymmetry, MIRRORED


def simulation_of(item: HardScene, accuracy: Accuracy, device: str | None) -> Simulation:
    """Return the scene's simulation at its start."""
    # determined by the cells, not by the flow: the challenge of a scene is in its ground
    spacing = accuracy.spacing or item.scene.terrain.resolution / accuracy.refinement
    effects: Effects | dict[str, bool] = PHYSICS[item.physics] if item.physics else {}
    if accuracy.formulation == 'as-published':
        without = dict.fromkeys(('inertia', 'helmholtz'), False)
        effects = replace(effects, **without) if isinstance(effects, Effects) else without
    if accuracy.method == 'cells' and isinstance(effects, Effects):
        effects = cells.without_missing(effects)
    simulation = Simulation(
        item.scene, effects=effects, accuracy=replace(accuracy, spacing=spacing), device=device,
        particles=item.lava(spacing) if item.lava else None,
    )
    solver: Any = simulation.solver
    if is_on_cells(simulation):
        solver.clock[cell_state.TIME] = item.since
    else:
        clock = solver.state.clock.numpy()
        clock[TIME] = item.since
        solver.state.clock.assign(clock)
    return simulation


def _moments(item: HardScene, step: float | None = None) -> list[float]:
    """Return times of frames and events; with fixed steps, after 1, 2, 4, ... steps."""
    span = item.until - item.since
    moments = [span * (index + 1) / item.frames for index in range(item.frames)]
    moments += [time for vent in item.scene.vents for time, _ in vent.series if time > 0.0]
    if step is not None:
        moments += [step * 2.0**k for k in range(40)]
    if math.isfinite(item.mirrored_until):
        moments.append(item.mirrored_until)
    moments = [item.since + moment for moment in moments if moment <= span]
    return sorted({*moments, *item.events})


def _advance(
    simulation: Simulation, item: HardScene, moment: float, start: float, limit: float | None
) -> bool:
    """Advance to a moment; return False if the wall time was up before."""
    _happen(simulation, item)
    left = None if limit is None else limit - (wall_clock.monotonic() - start)
    return simulation.advance(moment, wall_limit=left) >= moment


def _happen(simulation: Simulation, item: HardScene) -> None:
    """Let an event of the current time happen, right after the check of its moment."""
    if simulation.time in item.events:
        item.events[simulation.time](simulation)


def _require(outcome: Outcome, name: str, value: float, most: float) -> None:
    if not value <= most:
        outcome.violations.append(Violation(name, value, most, outcome.time))


def _compare(
    item: HardScene, outcome: Outcome, simulation: Simulation, lengths: Sequence[float]
) -> None:
    """Compare the footprint with that of a run with steps half as long (module docstring).

    ``lengths`` are the mean steps until each moment [s].
    """
    accuracy, device = simulation.accuracy, simulation.device
    is_by_length = is_on_cells(simulation)
    least = accuracy.inundation_threshold if is_by_length else 0.0
    whole = footprint(simulation.snapshot(), least)

    def change(fraction: float, played: HardScene = item) -> float:
        """Return the change of the footprint with steps of a fraction of their length."""
        shorter = {name: fraction * getattr(accuracy, name)
                   for name in ('courant_number', 'longest_step')}
        other = simulation_of(played, replace(accuracy, **shorter), device)
        for moment, length in zip(_moments(item), lengths, strict=True):
            _happen(other, item)
            if is_by_length:
                cells.limit_steps(other, fraction * length)
            other.advance(moment)
        return footprint_change(whole, footprint(other.snapshot(), least))

    found = change(0.5)
    # a cell of the solver may be several of the terrain
    ratio = terrain_of(simulation).resolution / simulation.scene.terrain.resolution
    cell = _cell_fraction(whole) * max(ratio, 1.0) ** 2
    bound = PRESETS[outcome.preset].errors['edge'] + cell
    if found > bound:
        # scatter only adds to the bound: without it the verdict is the same. Largest difference
        # between this run and one more, of equivalent runs
        draws = [
            change(1.0 - SHORTER * index / DRAWS, _shaken(item, index))
            for index in range(1, DRAWS + 1)
        ]
        bound += float(np.mean(draws) + STUDENT * np.std(draws, ddof=1))
    if found > bound:
        found = change(0.25)
    outcome.footprint_change, outcome.footprint_bound = found, bound
    _require(outcome, 'halving', found, bound)


def _cell_fraction(whole: np.ndarray) -> float:
    """Return the number of cells equivalent to a cell of the border, for ``footprint_change``."""
    images = [image for grid in (whole, whole.T) for image in (grid, grid[::-1])]
    images += [image[:, ::-1] for image in images]
    alike = sum(np.array_equal(image, whole) for image in images)
    return max(alike, 2) / (2.0 * max(float(whole.sum()), 1.0))


def _shaken(item: HardScene, seed: int) -> HardScene:
    """Return the scene with its particles and vents shifted by ``SHAKEN`` of a cell."""
    random, lava = np.random.default_rng(seed), item.lava
    scene, terrain = item.scene, item.scene.terrain
    size = SHAKEN * terrain.resolution
    vents = []
    for vent in scene.vents:
        place = tuple(np.asarray(vent.position) + random.uniform(-size, size, 2))
        vents.append(replace(vent, position=place) if terrain.covers(*place) else vent)

    def shaken_lava(spacing: float) -> Particles:
        assert lava is not None
        particles = lava(spacing)
        places = particles.position + random.uniform(-size, size, particles.position.shape)
        inside = np.array([terrain.covers(*place) for place in places])
        places[~inside] = particles.position[~inside]
        return replace(particles, position=places)

    shaken = replace(scene, vents=tuple(vents))
    return replace(item, scene=shaken, lava=None if lava is None else shaken_lava)


def footprint(snapshot: Snapshot, least: float = 0.0) -> np.ndarray:
    """Return the cells with lava thicker than ``least`` [m], bool, shape [rows, columns]."""
    return np.nan_to_num(snapshot.thickness) > least


def footprint_change(one: np.ndarray, other: np.ndarray) -> float:
    """Return the distance of two footprints' borders over their radius, 0 if both are empty.

    It is the area that only one of them covers over twice the mean area: dR / R for discs.
    """
    area = one.sum() + other.sum()
    return float((one ^ other).sum() / area) if area else 0.0


def asymmetry(snapshot: Snapshot) -> float:
    """Return the largest asymmetry of the thickness in x, over the largest thickness."""
    thickness = np.nan_to_num(snapshot.thickness)
    largest = float(thickness.max())
    return float(np.abs(thickness - thickness[:, ::-1]).max()) / largest if largest else 0.0
