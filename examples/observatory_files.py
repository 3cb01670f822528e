# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write typical files of an observatory, with which the commands of the documents can be tried.

`python observatory_files.py [FOLDER]` writes files of artificial slopes on Etna:

- lidar.tif, elevations in cells of 10 m in UTM zone 33 north with heights above the EGM96 geoid,
  a compound coordinate system like that of lidar surveys;
- fissure.kml, a fissure drawn in Google Earth;
- rates.csv, effusion rates of intervals with dates and errors;
- etna.tif, elevations in cells of 50 m of a slope of 3 x 7 km;
- seen.tif, an observed flow on it, and where.tif, the likelihood of a vent;
- dams.geojson, a planned barrier, and places.geojson, a village below it.
"""

import json
from pathlib import Path
import sys

import numpy as np
import rasterio
from rasterio.transform import from_origin
from rasterio.warp import transform

folder = Path(sys.argv[1] if len(sys.argv) > 1 else '.')
north = 4_180_000.0


def write_raster(name: str, values: np.ndarray, west: float, cell: float, crs: str) -> None:
    """Write a GeoTIFF of values, rows from the north."""
    rows, columns = values.shape
    with rasterio.open(
        folder / name, 'w', driver='GTiff', height=rows, width=columns, count=1, dtype='float32',
        crs=crs, transform=from_origin(west, north, cell, cell), nodata=-9999.0,
    ) as file:
        file.write(values.astype('float32'), 1)


def write_features(file: str, kind: str, coordinates: list, **properties: object) -> None:
    """Write a feature in UTM zone 33 north as GeoJSON."""
    geometry = {'type': kind, 'coordinates': coordinates}
    feature = {'type': 'Feature', 'properties': properties, 'geometry': geometry}
    crs = {'type': 'name', 'properties': {'name': 'EPSG:32633'}}
    collection = {'type': 'FeatureCollection', 'crs': crs, 'features': [feature]}
    (folder / file).write_text(json.dumps(collection, indent=1), encoding='utf-8')


# 1.2 km wide and 1.6 km high, a valley that falls to the south by 12 degrees
y, x = (np.indices((160, 120)) + 0.5) * 10.0
elevation = 2600.0 - 0.21 * y + 0.0006 * (x - 600.0) ** 2
elevation[-3:, :3] = -9999.0
write_raster('lidar.tif', elevation, 500_000.0, 10.0, 'EPSG:32633+5773')

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

# a rough slope that falls to the south by 9 degrees, from the place of a vent in the north
y, x = (np.indices((140, 60)) + 0.5) * 50.0
elevation = 2000.0 - 0.15 * y + 20.0 * np.sin(x / 400.0)
elevation[-1, 0] = -9999.0
seen = np.hypot(x - 1500.0, y - 900.0) < 200.0
for name, values in (('etna.tif', elevation), ('seen.tif', seen), ('where.tif', seen)):
    write_raster(name, values, 499_000.0, 50.0, 'EPSG:32633')

dam = [[500_300.0, 4_178_200.0], [500_900.0, 4_178_100.0]]
write_features('dams.geojson', 'LineString', dam, name='upper dam', height=10.0, width=80.0)
village = [[[500_400.0, 4_177_600.0], [500_700.0, 4_177_600.0], [500_700.0, 4_177_900.0],
            [500_400.0, 4_177_900.0], [500_400.0, 4_177_600.0]]]
write_features('places.geojson', 'Polygon', village, name='village')
