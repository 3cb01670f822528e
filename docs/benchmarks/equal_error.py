# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare the CPU time of two versions of the package at equal actual error.

    python docs/benchmarks/equal_error.py equal_error.csv --before CHECKOUT --processes 14

The lava of each scene has a constant viscosity. The reference is the scheme in stages of
finite_volumes.c, on the true ground in cells of about 1 m, with cos^4 of the slope. Both versions
run `standard` with the effects that they choose. The version of this script also runs the other
presets, and `draft` and `standard` with spacings that differ from the one before by factors of
sqrt(2). Errors are compared on the cells of the scene:

    inundated    one minus the Jaccard index of the covered fractions of cells, as the version
                 itself counts them, and those of the reference
    thickness    absolute difference of the thickness at the end, over the volume

Times are CPU seconds of one thread, with kernels compiled before; the median of three if short.
"""

import argparse
from concurrent.futures import as_completed, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
import os
from pathlib import Path
from statistics import median
import subprocess
import sys
import tempfile
import time
from typing import Any

from bench_scenes import BenchScene
from error_scenes import error_scenes, isothermal
import finite_volumes
import numpy as np
from plan_scenes import held_out

#: Scenes, the number of smaller cells of the reference along a side of a cell, and the viscosity
#: in place of that at the vent [Pa s]. Thin lava of 300 Pa s is too slow to need inertia.
SCENES: dict[str, tuple[int, float | None]] = {
    'rough_5m': (4, None), 'rough_10m': (8, None), 'rough_20m': (16, None),
    'fractal': (8, None), 'thin': (4, 300.0), 'dome': (2, None), 'slope_40': (4, None),
    'steep_slope': (3, None), 'oblique_valley': (8, None), 'valley': (3, None), 'plain': (4, None),
    'gullies': (3, None), 'terrace': (4, None), 'cone': (5, None), 'hills': (4, None),
    'pond': (3, None),
}

#: Spacings over that of `standard` before; the closest only if that run took less time [s].
FACTORS, SHORT = tuple(2.0 ** (0.5 * power) for power in range(-1, 7)), 40.0

#: Minimum thickness of lava that inundates ground [m]: that of the version before.
THRESHOLD = 0.1

#: Runs that take less are repeated [s].
REPEATED_BELOW, REPETITIONS = 2.0, 3

#: Sample points along a side of a cell, for the vents of the reference.
N_POINTS = 8


def scene_of(name: str, finer: int = 1) -> BenchScene:
    """Return a scene with lava of constant viscosity, on smaller cells by a factor ``finer``."""
    item = next(
        item for item in (*error_scenes(finer), *held_out(finer)) if item.name == name
    )
    scene, (_, viscosity) = item.scene, SCENES[name]
    lava = isothermal(viscosity or scene.lava.viscosity_at(scene.vents[0].temperature))
    return replace(item, scene=replace(scene, lava=lava))


def reference(name: str, finer: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the inundated fraction and the thickness [m] of cells, by finite volumes."""
    scene, duration = scene_of(name, finer).scene, scene_of(name).duration
    terrain, lava = scene.terrain, scene.lava
    z, cell, (x0, y0) = np.asarray(terrain.elevation, float), terrain.resolution, terrain.origin
    shifts = ((np.arange(N_POINTS) + 0.5) / N_POINTS) * cell
    x, y = x0 + np.arange(z.shape[1]) * cell, y0 + np.arange(z.shape[0]) * cell
    source = np.zeros_like(z)
    for vent in scene.vents:
        inside = sum(
            (np.hypot(*np.meshgrid(x + dx - vent.position[0], y + dy - vent.position[1]))
             < vent.radius).astype(float)
            for dx in shifts for dy in shifts
        )
        source += vent.peak * inside / (inside.sum() * cell**2)
    factor = scene.gravity * lava.density / (3.0 * lava.viscosity)
    layer = finite_volumes.in_stages(z, cell, source, factor, duration, steep=True)
    rows, columns = (side // finer for side in z.shape)
    blocks = ((layer.peak >= THRESHOLD).astype(float), layer.thickness)
    first, second = (
        values.reshape(rows, finer, columns, finer).mean(axis=(1, 3)) for values in blocks
    )
    return first, second


def run(name: str, preset: str, spacing: float | None, output: str) -> None:
    """Run a scene with the package on the path, and write its maps."""
    from lava_ros.simulation import Simulation
    from lava_ros.simulation.presets import preset_accuracy

    item = scene_of(name)
    accuracy = preset_accuracy(preset, spacing=spacing)
    if hasattr(accuracy, 'threshold'):
        accuracy = replace(accuracy, threshold=THRESHOLD)

    def advanced(until: float) -> tuple[Any, Any]:
        simulation = Simulation(
            item.scene, accuracy=accuracy, device='cpu', horizon=item.horizon
        )
        simulation.advance(until)
        return simulation, simulation.snapshot()

    advanced(0.01 * item.duration)
    seconds: list[float] = []
    while len(seconds) < REPETITIONS and sum(seconds) < REPEATED_BELOW:
        begun = time.process_time()
        simulation, snapshot = advanced(item.duration)
        seconds.append(time.process_time() - begun)
    np.savez(
        output, inundated=np.nan_to_num(snapshot.inundated.astype(float)),
        thickness=np.nan_to_num(snapshot.thickness.astype(float)), cpu_s=median(seconds),
        particles=snapshot.particle_count, spacing_m=simulation.accuracy.spacing,
        effects=' '.join(simulation.effects),
    )


def made(root: Path, name: str, preset: str, spacing: float | None) -> dict[str, Any]:
    """Return the maps of a run in a process that imports the package from ``root``."""
    with tempfile.TemporaryDirectory() as folder:
        output = f'{folder}/run.npz'
        words = [sys.executable, __file__, '--run', name, preset, str(spacing or 0.0), output]
        one = {'PYTHONPATH': str(root), 'LAVA_THREADS': '1', 'OMP_NUM_THREADS': '1'}
        done = subprocess.run(
            words, env={**os.environ, **one}, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise RuntimeError(f'{name}, {preset}, {spacing}: {done.stderr[-2000:]}')
        with np.load(output) as file:
            return {key: file[key] if file[key].ndim else file[key].item() for key in file}


def errors(found: tuple[np.ndarray, np.ndarray], exact: tuple[np.ndarray, np.ndarray]) -> Any:
    """Return the errors of the inundated area and of the thickness."""
    from lava_ros.simulation.numerical_error import difference

    apart = np.abs(found[1] - exact[1]).sum() / exact[1].sum()
    return {'inundated': difference(found[0], exact[0]), 'thickness': float(apart)}


def main() -> None:
    """Run all scenes, and write the rows so far after each run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path, nargs='?')
    parser.add_argument('--before', type=Path, metavar='CHECKOUT', help='the version before')
    parser.add_argument('--scene', action='append', choices=SCENES, help='(default: all)')
    parser.add_argument('--processes', type=int, default=1)
    parser.add_argument('--run', nargs=4, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.run:
        name, preset, spacing, output = args.run
        run(name, preset, float(spacing) or None, output)
        return
    if args.output is None or args.before is None:
        parser.error('OUT.csv and --before CHECKOUT are needed')
    compare(args.output, args.before.resolve(), args.scene or list(SCENES), args.processes)


def compare(output: Path, before: Path, names: list[str], processes: int) -> None:
    """Run all versions, presets and spacings of scenes; write the rows so far after each run."""
    from lava_ros.simulation.backend.threads import use_threads
    from lava_ros.simulation.presets import preset_accuracy
    from lava_ros.verification.measure import machine_name
    from lava_ros.verification.rows import write_csv

    use_threads(1)
    here, machine = Path(__file__).resolve().parents[2], machine_name('cpu')
    finite_volumes.library()
    # compile the kernels in one process before many need them
    for root in (before, here):
        made(root, names[0], 'draft', 20.0)
    # presets that differ in more than their refinement
    settings = {
        replace(preset_accuracy(name), refinement=1.0): name for name in ('draft', 'standard')
    }.values()
    rows: list[dict[str, Any]] = []
    with (
        ThreadPoolExecutor(processes) as pool,
        ProcessPoolExecutor(max(1, processes // 3), mp_context=get_context('spawn')) as others,
    ):
        best = {
            name: [others.submit(reference, name, finer) for finer in _cells(name)]
            for name in names
        }
        waiting = {
            pool.submit(made, root, name, preset, None): (version, name, preset)
            for version, root, presets in (
                ('before', before, ('standard',)), ('after', here, ('standard', 'draft', 'fine')),
            )
            for name in names
            for preset in presets
        }
        while waiting:
            done = next(as_completed(waiting))
            version, name, preset = waiting.pop(done)
            result, (exact, coarse) = done.result(), (one.result() for one in best[name])
            cell = scene_of(name).scene.terrain.resolution
            row = {'scene': name, 'cell_m': cell, 'version': version, 'preset': preset}
            row |= {
                key: result[key] for key in ('spacing_m', 'particles', 'cpu_s', 'effects')
            }
            found = errors((result['inundated'], result['thickness']), exact)
            known = errors(coarse, exact)
            rows.append({
                **row, **found, **{f'reference_{key}': known[key] for key in known},
                'machine': machine,
            })
            print(name, version, preset, f'{result["spacing_m"]:.3g} m', flush=True)
            print(f'   {result["cpu_s"]:.3g} s', found, flush=True)
            write_csv(sorted(rows, key=_order), output)
            if version == 'before':
                for factor in FACTORS:
                    if factor >= 1.0 or result['cpu_s'] < SHORT:
                        spacing = float(f'{factor * result["spacing_m"]:.3g}')
                        for setting in settings:
                            waiting[pool.submit(made, here, name, setting, spacing)] = (
                                'after', name, f'{setting} at a spacing',
                            )


def _cells(name: str) -> tuple[int, int]:
    """Return the refinements of the reference, and of a coarser one that measures its error."""
    finer = SCENES[name][0]
    return finer, max(finer // 2, 1)


def _order(row: dict[str, Any]) -> tuple[Any, ...]:
    number = list(SCENES).index(row['scene'])
    return number, row['version'] == 'after', row['preset'], row['spacing_m']


if __name__ == '__main__':
    main()
