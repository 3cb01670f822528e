# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure what the reader process costs, compared with rasterio in the process itself.

A process that reads a raster, and `lava effects` with an uncompressed one as terrain, are run in
turn with and without the reader. Times are medians, CPU times those of all processes. The output
is reader.csv:

    python docs/benchmarks/reader.py 'machine' > docs/benchmarks/reader.csv
"""

import csv
from pathlib import Path
import resource
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np
import rasterio

REPETITIONS = 9

#: Sides of the rasters [cells].
SIDES = (200, 5000)

#: Creation options of the files.
FORMS = {'uncompressed': {}, 'deflate': {'compress': 'deflate', 'predictor': 3, 'tiled': True}}

#: Reads a raster in the process itself.
IN_PROCESS = """
import sys
import numpy as np, rasterio
import lava_ros.files.rasters as rasters

def read_raster(field, path, formats=(), *, kind=None, max_bands=1, max_side=None):
    with rasterio.open(path) as source:
        values = source.read([1], out_dtype=kind, masked=True)
        colours = [item.name for item in source.colorinterp]
        return rasters.RasterContent(
            values, source.transform, source.crs, source.shape, source.count, source.dtypes,
            source.scales, source.offsets, source.units, source.descriptions, colours, {},
            source.tags(),
        )

rasters.read_raster = read_raster
"""

#: Reads the raster of the first argument.
READ = """
import sys
import numpy as np
import lava_ros.files.rasters as rasters

rasters.read_raster('a', sys.argv[1], kind=np.float32)
"""

#: Runs `lava` with arguments.
COMMAND = """
import sys
from lava_ros.cli.main import main

sys.exit(main(sys.argv[1:]))
"""


def write_raster(path, side, options):
    """Write a raster of hills and noise."""
    rows, columns = np.mgrid[:side, :side] * (5000.0 / side)
    noise = np.random.default_rng(0).normal(0.0, 0.3, (side, side))
    elevation = 1500.0 + 800.0 * np.sin(rows / 900.0) * np.cos(columns / 700.0) + noise
    place = rasterio.transform.from_origin(500_000.0, 4_200_000.0, 10.0, 10.0)
    with rasterio.open(
        path, 'w', driver='GTiff', width=side, height=side, count=1, dtype='float32',
        crs='EPSG:32633', nodata=-9999.0, transform=place, **options,
    ) as target:
        target.write(elevation.astype(np.float32), 1)


def timed(code, words):
    """Return the CPU time and the wall time [s] of a process."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run(
        [sys.executable, '-c', code, *words], check=True, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    wall, after = time.monotonic() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def main():
    """Print the table."""
    table = csv.writer(sys.stdout, lineterminator='\n')
    table.writerow(['work', 'raster', 'clock', 'reader_s', 'in_process_s', 'ratio', 'machine'])
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / 'a.tif'
        for side in SIDES:
            for form, options in FORMS.items():
                write_raster(path, side, options)
                place = f'{500_000 + 5 * side},{4_200_000 - 5 * side}'
                words = ['effects', '--terrain', str(path), '--vent', place]
                works = [('read', READ, [str(path)]), ('effects', COMMAND, words)]
                for work, code, more in works if form == 'uncompressed' else works[:1]:
                    # the first run reads the file and the libraries from the disk
                    pairs = [
                        (*timed(code, more), *timed(IN_PROCESS + code, more))
                        for _ in range(REPETITIONS + 1)
                    ][1:]
                    for clock, one, other in (('CPU', 0, 2), ('wall', 1, 3)):
                        own, theirs = (
                            statistics.median(pair[index] for pair in pairs)
                            for index in (one, other)
                        )
                        ratio = statistics.median(pair[one] / pair[other] for pair in pairs)
                        name = f'{side} x {side}, {form}'
                        row = [work, name, clock, f'{own:.3f}', f'{theirs:.3f}', f'{ratio:.2f}']
                        table.writerow([*row, sys.argv[1]])
                        sys.stdout.flush()


if __name__ == '__main__':
    main()
