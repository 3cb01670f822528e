# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compute a hazard atlas on the ground of a mapped eruption, and measure the wall time.

The output is atlas_h200.csv. CASE is a folder for `lava run CASE`, FOLDER is that of the atlas:

    python docs/benchmarks/atlas.py CASE FOLDER --members 1000 --device cuda:0 --machine M

The vent of a member is within some kilometres of the mapped vent. Eruptions last 1 to 45 days and
emit 1 to 35 million m3: the class of the shortest and smallest eruptions of Etna in Proietti, C.,
De Beni, E., Coltelli, M. and Branca, S. (2011), Annals of Geophysics 54, 480-490. The discharge is
largest after a tenth of the duration (Zuccarello, F., Bilotta, G., Cappello, A. and Ganci, G.
(2022), Remote Sensing 14, 1366: after 0.5 to 29 %).
"""

import argparse
from contextlib import redirect_stdout
import csv
import json
from pathlib import Path
import sys
import time

import numpy as np
import rasterio
import yaml

from lava_ros.cli import main as cli
from lava_ros.hindcast.case import load_case

DAY = 86400.0

#: Standard deviations of the vent's easting and northing [m], and its radius [m].
SCATTER, RADIUS = (600.0, 1200.0), 20.0

#: Volumes of eruptions [m3], and discharge [m3/s] by fraction of the duration.
VOLUMES, CURVE = (1e6, 35e6), ((0.0, 4.0), (0.1, 20.0), (1.0, 0.0))


def scene(case, folder, days):
    """Write the scene and the possible positions of its vent."""
    with rasterio.open(folder / 'elevation.tif', 'w', **_profile(case)) as file:
        file.write(np.flipud(case.scene.terrain.elevation).astype(np.float32), 1)
    (vent,) = case.scene.vents[:1]
    terrain = case.scene.terrain
    rows, columns = terrain.shape
    x = terrain.origin[0] + terrain.resolution * np.arange(columns)
    y = terrain.origin[1] + terrain.resolution * np.arange(rows)
    east, north = (x - vent.position[0]) / SCATTER[0], (y - vent.position[1]) / SCATTER[1]
    likely = np.exp(-0.5 * (north[:, None] ** 2 + east**2))
    likely[~np.isfinite(terrain.elevation)] = 0.0
    with rasterio.open(folder / 'where.tif', 'w', **_profile(case)) as file:
        file.write(np.flipud(likely).astype(np.float32), 1)
    eruption = {
        'name': 'short and small', 'probability': 1,
        'duration': {
            'distribution': 'loguniform', 'low': DAY * min(1.0, 0.1 * days), 'high': DAY * days
        },
        'volume': {'distribution': 'loguniform', 'low': VOLUMES[0], 'high': VOLUMES[1]},
    }
    plain = {
        'terrain': {'file': 'elevation.tif'},
        'vents': [{
            'position': [float(value) for value in vent.position], 'radius': RADIUS,
            'discharge': [[DAY * days * part, value] for part, value in CURVE],
        }],
        'lava': {'material': 'etna_basalt'},
        'uncertainty': {'eruption': [eruption]},
    }
    path = folder / 'volcano.yaml'
    path.write_text(yaml.safe_dump(plain))
    return path


def _profile(case):
    terrain = case.scene.terrain
    rows, columns = terrain.shape
    step = terrain.resolution
    west, north = terrain.extent[0], terrain.extent[3]
    return {
        'driver': 'GTiff', 'dtype': 'float32', 'count': 1, 'height': rows, 'width': columns,
        'nodata': float('nan'),
        'transform': rasterio.transform.from_origin(west, north, step, step),
    }


def main():
    """Compute the atlas, and print a CSV."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('case', type=Path)
    parser.add_argument('folder', type=Path)
    parser.add_argument('--members', type=int, default=1000)
    parser.add_argument('--days', type=float, default=45.0)
    parser.add_argument('--device', default='cpu')
    parser.add_argument('--machine', required=True)
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    case = load_case(args.case)
    path, result = scene(case, args.folder, args.days), args.folder / 'atlas.json'
    words = ['run', str(path), '-o', str(args.folder / 'atlas'), '--json', str(result)]
    words += ['--susceptibility', str(args.folder / 'where.tif'), '--preset', 'draft']
    words += ['--until', f'{24 * args.days}h']
    words += ['--members', str(args.members), '--device', args.device]
    start = time.perf_counter()
    # standard output is the table
    with redirect_stdout(sys.stderr):
        status = cli.main(words)
    if status:
        sys.exit(1)
    taken = time.perf_counter() - start
    result_data = json.loads(result.read_text())
    rows = csv.writer(sys.stdout, lineterminator='\n')
    rows.writerow(('benchmark', 'value', 'unit', 'members', 'machine', 'command'))
    command = f'python docs/benchmarks/atlas.py {args.case.name} atlas --members {args.members}'
    for what, value, unit in (
        ('time', taken, 's'),
        ('members a minute', 60.0 * args.members / taken, '1/min'),
        ('standard error near 50 %', result_data['sampling_error_percent'], '%'),
        ('members whose lava left the map', result_data['members_beyond'], ''),
    ):
        rows.writerow((what, f'{value:.4g}', unit, args.members, args.machine, command))


if __name__ == '__main__':
    main()
