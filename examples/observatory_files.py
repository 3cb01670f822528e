# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write typical files of an observatory, for the tutorial on your own volcano.

`python observatory_files.py [FOLDER]` writes files of an artificial slope on Etna:

- lidar.tif, elevations in cells of 10 m in UTM zone 33 north with heights above the EGM96 geoid,
  a compound coordinate system like that of lidar surveys;
- fissure.kml, a fissure drawn in Google Earth;
- rates.csv, effusion rates of intervals with dates and errors.
"""

from pathlib import Path
import sys

import numpy as np
import rasterio
from rasterio.transform import from_origin
from rasterio.warp import transform

folder = Path(sys.argv[1] if len(sys.argv) > 1 else '.')

# 1.2 km wide and 1.6 km high, a valley that falls to the south by 12 degrees
cell, west, north = 10.0, 500_000.0, 4_180_000.0
y, x = (np.indices((160, 120)) + 0.5) * cell
elevation = (2600.0 - 0.21 * y + 0.0006 * (x - 600.0) ** 2).astype(np.float32)
elevation[-3:, :3] = -9999.0
with rasterio.open(
    folder / 'lidar.tif', 'w', driver='GTiff', height=160, width=120, count=1, dtype='float32',
    crs='EPSG:32633+5773', transform=from_origin(west, north, cell, cell), nodata=-9999.0,
) as file:
    file.write(elevation, 1)

ends = transform('EPSG:32633', 'EPSG:4326', [500_570.0, 500_630.0], [4_179_700.0, 4_179_660.0])
line = ' '.join(f'{lon:.7f},{lat:.7f},0' for lon, lat in zip(*ends, strict=True))
(folder / 'fissure.kml').write_text(
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>upper fissure</name>\n'
    f'<LineString><tessellate>1</tessellate><coordinates>{line}</coordinates></LineString>\n'
    '</Placemark></Document></kml>\n',
    encoding='utf-8',
)

(folder / 'rates.csv').write_text(
    '# satellite estimates, bulk\n'
    'Start;End;TADR (m3/s);Error (m3/s)\n'
    '2021-09-19T14:10:00Z;2021-09-19T14:30:00Z;12,0;3,0\n'
    '2021-09-19T14:30:00Z;2021-09-19T15:10:00Z;5,5;1,5\n',
    encoding='utf-8',
)
