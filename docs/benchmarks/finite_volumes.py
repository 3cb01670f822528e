# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Both schemes of finite_volumes.c, compiled when they are first used."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from pathlib import Path
import subprocess
import tempfile
from typing import Any, NamedTuple

import numpy as np

#: Time step of the plain scheme, as a fraction of the stable step.
STEP_FRACTION = 0.9

#: Maximum displacement in a step of the scheme in stages, in cells.
DISPLACEMENT = 2.0

#: Maximum square of the ground's gradient in the factor of steep slopes: 60 degrees, as in MODEL.
STEEPEST = 3.0


class _Ground(ctypes.Structure):
    """Pointers to float32 arrays on the cells (``Ground`` in finite_volumes.c)."""

    _fields_ = [
        (name, ctypes.c_void_p)
        for name in ('along', 'across', 'factor_along', 'factor_across', 'source')
    ]


class Layer(NamedTuple):
    """Thickness at the end and the largest thickness so far [m], shape [rows, columns]."""

    thickness: np.ndarray
    peak: np.ndarray


@lru_cache
def library() -> Any:
    """Compile the schemes."""
    with tempfile.TemporaryDirectory() as folder:
        shared, part = Path(folder) / 'finite_volumes.so', Path(folder) / 'finite_volumes.o'
        source = Path(__file__).with_suffix('.c')
        options = ['-O3', '-march=native', '-ffast-math', '-fPIC', '-c']
        subprocess.run(['cc', *options, '-o', part, source], check=True)
        # linking with -ffast-math would set subnormal numbers of the whole process to 0
        subprocess.run(['cc', '-shared', '-o', shared, part], check=True)
        found = ctypes.CDLL(str(shared))
    cells, floats = (np.ctypeslib.ndpointer(kind, flags='C') for kind in (np.float64, np.float32))
    box, long, double = np.ctypeslib.ndpointer(np.int64, flags='C'), ctypes.c_long, ctypes.c_double
    found.advance.argtypes = [*[cells] * 4, box, long, long, *[double] * 4]
    found.advance_in_stages.argtypes = [
        cells, floats, ctypes.POINTER(_Ground), box, long, long, *[double] * 4,
    ]
    found.advance.restype = found.advance_in_stages.restype = long
    return found


def plain(
    elevation: np.ndarray, cell: float, source: np.ndarray, factor: float, end: float
) -> np.ndarray:
    """Return the thickness [m] by the plain scheme.

    Args:
        elevation: Ground at the centres of cells [m], shape [rows, columns].
        cell: Side of a cell [m].
        source: Emitted thickness a second [m/s], same shape.
        factor: g / (3 nu) [1/(m s)].
        end: Simulated time [s].
    """
    thickness, change = np.zeros_like(elevation), np.zeros_like(elevation)
    library().advance(
        thickness, change, elevation, source, _box(source), *elevation.shape, cell, factor,
        STEP_FRACTION, end,
    )
    return thickness


def in_stages(
    elevation: np.ndarray, cell: float, source: np.ndarray, factor: float, end: float, *,
    steep: bool = False,
) -> Layer:
    """Return the lava by the scheme in stages; the arguments are those of ``plain``.

    ``steep`` multiplies the flow by cos^4 of the ground's slope (docs/MODEL.md).

    Raises:
        RuntimeError: If the volume differs from the emitted one by more than 0.01 %.
    """
    drops = [np.zeros(elevation.shape, np.float32) for _ in range(2)]
    drops[0][:, :-1] = elevation[:, :-1] - elevation[:, 1:]
    drops[1][:-1] = elevation[:-1] - elevation[1:]
    factors = [np.ones(elevation.shape, np.float32) for _ in range(2)]
    if steep:
        across, along = np.gradient(elevation, cell)
        slopes = [
            (drops[0][:, :-1] / cell) ** 2 + (0.5 * (across[:, :-1] + across[:, 1:])) ** 2,
            (drops[1][:-1] / cell) ** 2 + (0.5 * (along[:-1] + along[1:])) ** 2,
        ]
        squares = [1.0 / (1.0 + np.minimum(slope, STEEPEST)) for slope in slopes]
        factors[0][:, :-1], factors[1][:-1] = (square**2 for square in squares)
    arrays = (*drops, *factors, source.astype(np.float32))
    ground = _Ground(*(array.ctypes.data for array in arrays))
    thickness, peak = np.zeros_like(elevation), np.zeros(elevation.shape, np.float32)
    library().advance_in_stages(
        thickness, peak, ctypes.byref(ground), _box(source), *elevation.shape, cell, factor,
        DISPLACEMENT, end,
    )
    if not abs(thickness.sum() / (source.sum() * end) - 1.0) < 1e-4:
        raise RuntimeError(f'the scheme in stages is unstable on cells of {cell:g} m')
    return Layer(thickness, peak)


def _box(source: np.ndarray) -> np.ndarray:
    """Return the first and the last row and column with a source."""
    rows, columns = np.nonzero(source)
    return np.array([rows.min(), rows.max(), columns.min(), columns.max()])
