# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare the CPU time of two versions of the package at equal actual error.

    python docs/benchmarks/equal_error.py equal_error.csv --before CHECKOUT --processes 14

The lava of each scene has a constant viscosity. The reference is the scheme in stages of
finite_volumes.c, on the true ground in cells of about 1 m, with cos^4 of the slope. Both versions
run `standard` with the effects that they choose. The version of this script also runs `draft`,
spacings that differ from the one before by factors of sqrt(2), and method cells on cells of twice,
once and half the size of the ground's. Errors are compared on the cells of the scene:

    inundated    one minus the Jaccard index of the covered fractions of cells, as the version
                 itself counts them, and those of the reference
    thickness    absolute difference of the thickness at the end, over the volume

Times are CPU seconds of one thread, with kernels compiled before; the median of three if short.
"""

import argparse
from concurrent.futures import as_completed, ProcessPoolExecutor
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

#: Presets of this version, and spacings over that of `standard` before; the closest one only if
#: that run took less time [s].
PRESETS = ('draft', 'standard')
FACTORS, SHORT = tuple(2.0 ** (0.5 * power) for power in range(-1, 6)), 5.0

#: Sizes of cells of method cells over those of the ground.
CELLS = (2.0, 1.0, 0.5)

#: Minimum thickness of lava that inundates ground [m]: that of the version before.
THRESHOLD = 0.1

#: The first run counts only if it takes longer, because it may compile kernels [s].
LONG = 10.0

#: Refinement of the run that compiles the kernels, over that of the preset.
COARSE = 0.25

#: Runs that take less are repeated [s].
REPEATED_BELOW, REPETITIONS = 0.5, 3

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


#: Preset, or ``cells``, and spacing [m] of a run; None is the spacing of the preset.
Setting = tuple[str, float | None]


def run(name: str, output: Path, settings: list[Setting]) -> None:
    """Run a scene with the package on the path, and write the maps of each setting."""
    from lava_ros.simulation import Simulation
    from lava_ros.simulation.presets import preset_accuracy

    item = scene_of(name)

    def advanced(accuracy: Any, until: float) -> tuple[Any, Any]:
        simulation = Simulation(
            item.scene, accuracy=accuracy, device='cpu', horizon=item.horizon
        )
        simulation.advance(until)
        return simulation, simulation.snapshot()

    # compiles the kernels, which may take longer than ``LONG``
    first = preset_accuracy(settings[0][0])
    advanced(replace(first, refinement=COARSE * first.refinement), item.duration)
    advanced(first, 1e-3)
    for number, (preset, spacing) in enumerate(settings):
        if preset == 'cells':
            accuracy = replace(preset_accuracy('standard', spacing=spacing), method='cells')
        else:
            accuracy = preset_accuracy(preset, spacing=spacing)
        if hasattr(accuracy, 'threshold'):
            accuracy = replace(accuracy, threshold=THRESHOLD)
        begun = time.process_time()
        simulation, snapshot = advanced(accuracy, item.duration)
        seconds = [time.process_time() - begun]
        if seconds[0] < LONG:
            # it may have compiled kernels
            seconds = []
        while len(seconds) < REPETITIONS and sum(seconds) < REPEATED_BELOW:
            begun = time.process_time()
            simulation, snapshot = advanced(accuracy, item.duration)
            seconds.append(time.process_time() - begun)
        np.savez(
            output / f'{number}.npz', inundated=np.nan_to_num(snapshot.inundated.astype(float)),
            thickness=np.nan_to_num(snapshot.thickness.astype(float)), cpu_s=median(seconds),
            particles=snapshot.particle_count, spacing_m=simulation.accuracy.spacing,
            effects=' '.join(simulation.effects),
        )


def made(root: Path, name: str, settings: list[Setting]) -> list[dict[str, Any]]:
    """Return the maps of runs, from a process that imports the package from ``root``."""
    with tempfile.TemporaryDirectory() as folder:
        words = [f'{preset}:{spacing or 0.0}' for preset, spacing in settings]
        # other packages may be on the path, too
        path = os.pathsep.join([str(root), os.environ.get('PYTHONPATH', '')]).rstrip(os.pathsep)
        one = {'PYTHONPATH': path, 'LAVA_THREADS': '1', 'OMP_NUM_THREADS': '1'}
        done = subprocess.run(
            [sys.executable, __file__, folder, '--run', name, *words],
            env={**os.environ, **one}, capture_output=True, text=True, check=False,
        )
        if done.returncode:
            raise RuntimeError(f'{name}: {done.stderr[-2000:]}')
        found = []
        for number in range(len(settings)):
            with np.load(Path(folder) / f'{number}.npz') as file:
                arrays = {key: file[key] for key in file}
            found.append({key: a if a.ndim else a.item() for key, a in arrays.items()})
        return found


def errors(found: tuple[np.ndarray, np.ndarray], exact: tuple[np.ndarray, np.ndarray]) -> Any:
    """Return the errors of the inundated area and of the thickness."""
    from lava_ros.simulation.numerical_error import difference

    apart = np.abs(found[1] - exact[1]).sum() / exact[1].sum()
    return {'inundated': difference(found[0], exact[0]), 'thickness': float(apart)}


def main() -> None:
    """Run all scenes, and write the rows so far after each one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--before', type=Path, metavar='CHECKOUT', help='the version before')
    parser.add_argument('--scene', action='append', choices=SCENES, help='(default: all)')
    parser.add_argument('--processes', type=int, default=1)
    parser.add_argument('--run', nargs='+', help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.run:
        name, *words = args.run
        pairs = (word.split(':') for word in words)
        run(name, args.output, [(preset, float(spacing) or None) for preset, spacing in pairs])
        return
    if args.before is None:
        parser.error('--before CHECKOUT is needed')
    compare(args.output, args.before.resolve(), args.scene or list(SCENES), args.processes)


def compare(output: Path, before: Path, names: list[str], processes: int) -> None:
    """Compare the versions on scenes, and write the rows so far after each one."""
    # not in the version before
    from table_text import lines_of

    from lava_ros.verification.rows import write_csv

    rows = lines_of(output.resolve()) if output.exists() else []
    known = {row['scene'] for row in rows}
    with ProcessPoolExecutor(processes, mp_context=get_context('spawn')) as pool:
        waiting = [pool.submit(compared, before, name) for name in names if name not in known]
        for done in as_completed(waiting):
            rows += done.result()
            rows.sort(key=lambda row: list(SCENES).index(row['scene']))
            write_csv(rows, output)


def compared(before: Path, name: str) -> list[dict[str, Any]]:
    """Return the rows of a scene, the version before first."""
    from lava_ros.simulation.backend.threads import use_threads
    from lava_ros.simulation.presets import preset_accuracy
    from lava_ros.verification.measure import machine_name

    use_threads(1)
    exact, coarse = (reference(name, finer) for finer in _cells(name))
    known = {f'reference_{key}': value for key, value in errors(coarse, exact).items()}
    (old,) = made(before, name, [('standard', None)])
    # settings of presets that differ in more than their refinement
    distinct = {
        replace(preset_accuracy(preset), refinement=1.0): preset for preset in PRESETS
    }.values()
    spacings = [float(f'{factor * old["spacing_m"]:.3g}') for factor in FACTORS]
    if old['cpu_s'] > SHORT:
        spacings = spacings[1:]
    settings: list[Setting] = [(preset, None) for preset in PRESETS]
    settings += [(preset, spacing) for preset in distinct for spacing in spacings]
    cell = scene_of(name).scene.terrain.resolution
    settings += [('cells', factor * cell) for factor in CELLS]
    rows = []
    results = [old, *made(Path(__file__).resolve().parents[2], name, settings)]
    for result, (preset, spacing) in zip(results, [('standard', None), *settings], strict=True):
        found = (result.pop('inundated'), result.pop('thickness'))
        rows.append({
            'scene': name, 'cell_m': cell, 'version': 'after' if rows else 'before',
            'preset': '' if spacing and preset != 'cells' else preset,
            **result, **errors(found, exact), **known, 'machine': machine_name('cpu'),
            'command': 'python docs/benchmarks/equal_error.py',
        })
        print(name, rows[-1]['version'], preset, f'{result["spacing_m"]:.3g} m, ', end='')
        print(f'{result["cpu_s"]:.3g} s', errors(found, exact), flush=True)
    return rows


def _cells(name: str) -> tuple[int, int]:
    """Return the refinements of the reference, and of a coarser one that measures its error."""
    finer = SCENES[name][0]
    return finer, max(finer // 2, 1)


if __name__ == '__main__':
    main()
