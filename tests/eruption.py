# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0


"""A synthetic eruption as the folder of a case: a valley, a vent and a mapped flow."""

from pathlib import Path

import numpy as np

#: Side of a cell [m], lower-left corner and shape of the grids.
CELL, CORNER, SHAPE = 20.0, (500_000.0, 4_180_000.0), (60, 40)

#: The vent, in the coordinates of the elevation [m].
VENT = (CORNER[0] + 410.0, CORNER[1] + 1010.0)

#: Lava for a case of an hour.
LAVA = 'lava: {viscosity: 2.0e+4, yield_strength: 200}\n'


def elevation() -> np.ndarray:
    """Return the elevation of a valley that falls to the south [m], row 0 in the south."""
    y, x = (np.indices(SHAPE) + 0.5) * CELL
    return 1000.0 + 0.2 * y + 0.0008 * (x - 410.0) ** 2


def footprint() -> np.ndarray:
    """Return a tongue from the vent down the valley, 1 where the ground is covered."""
    y, x = (np.indices(SHAPE) + 0.5) * CELL
    return ((np.abs(x - 410.0) < 70.0) & (y > 400.0) & (y < 1030.0)).astype(float)


def write_grid(path: Path, values: np.ndarray, *, corner: tuple[float, float] = CORNER,
               cell: float = CELL) -> None:
    """Write an ESRI ASCII grid of values, row 0 in the south; NaN becomes -9999."""
    rows, columns = values.shape
    header = f'ncols {columns}\nnrows {rows}\nxllcorner {corner[0]}\nyllcorner {corner[1]}\n'
    header += f'cellsize {cell}\nNODATA_value -9999\n'
    lines = [' '.join(f'{v:.3f}' for v in row) for row in np.nan_to_num(values, nan=-9999.0)]
    path.write_text(header + '\n'.join(reversed(lines)) + '\n', encoding='utf-8')


def write_case(folder: Path, *, hours: float = 3.0, yaml: str = '') -> Path:
    """Write a case that runs in seconds, with an eruption of some hours.

    ``yaml`` is the text of ``case.yaml``, empty for none.
    """
    folder.mkdir(parents=True)
    write_grid(folder / 'elevation.asc', elevation())
    write_grid(folder / 'footprint.asc', footprint())
    (folder / 'vent.csv').write_text(f'x,y\n{VENT[0]},{VENT[1]}\n', encoding='utf-8')
    end = 3600.0 * hours
    table = f'start_s,end_s,discharge_m3_per_s\n0,{end / 2},20\n{end / 2},{end},10\n'
    (folder / 'effusion_rate.csv').write_text(table, encoding='utf-8')
    if yaml:
        (folder / 'case.yaml').write_text(yaml, encoding='utf-8')
    return folder


def write_case_in_degrees(folder: Path, *, hours: float = 3.0) -> tuple[Path, tuple[float, float]]:
    """Write the case as GeoTIFFs in degrees; return its folder, and the vent as (x, y)."""
    from rasterio.transform import from_bounds, from_origin
    from rasterio.warp import reproject, transform, transform_bounds

    from geodata import write_raster

    # lava that its coarse cells resolve
    folder = write_case(folder, hours=hours, yaml='lava: {viscosity: 1.0e+5}\n')
    rows, columns = SHAPE
    north = CORNER[1] + rows * CELL
    there = from_bounds(
        *transform_bounds('EPSG:32633', 'EPSG:4326', *CORNER, CORNER[0] + columns * CELL, north),
        columns, rows,
    )
    for name, values in (('elevation', elevation()), ('footprint', footprint())):
        warped = np.full(SHAPE, -9999.0)
        reproject(
            np.flipud(values), warped, src_crs='EPSG:32633', dst_crs='EPSG:4326',
            src_transform=from_origin(CORNER[0], north, CELL, CELL), dst_transform=there,
            dst_nodata=-9999.0,
        )
        write_raster(
            folder / f'{name}.tif', warped.astype('float32'), crs='EPSG:4326', transform=there,
            nodata=-9999.0,
        )
        (folder / f'{name}.asc').unlink()
    (x,), (y,) = transform('EPSG:32633', 'EPSG:4326', [VENT[0]], [VENT[1]])
    (folder / 'vent.csv').write_text(f'x,y\n{x},{y}\n', encoding='utf-8')
    return folder, (x, y)
