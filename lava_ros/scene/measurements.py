# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Errors of measured inputs by the method of measurement: effusion rates and elevations."""

from collections.abc import Mapping
from dataclasses import dataclass
import re

from lava_ros.scene.distributions import Distribution, Roughness

_HARRIS = (
    'Harris, A. J. L., Dehn, J. and Calvari, S. (2007). Lava effusion rate definition and '
    'measurement: a review. Bulletin of Volcanology 70, 1-22: errors of up to 50 %'
)

#: Factor on effusion rates by the method of measurement. A rate by satellite lies between two
#: bounds, for a hot and a cold surface, without a most likely value between them. In the field the
#: errors of width, depth and speed are independent, so that small errors are more likely.
RATE_ERRORS: Mapping[str, Distribution] = {
    'satellite': Distribution('uniform', (0.5, 1.5), source=f'by satellite: {_HARRIS}'),
    'field': Distribution('triangular', (0.5, 1.0, 1.5), source=f'in the field: {_HARRIS}'),
}

#: Method of effusion rates whose method is not stated: that with the larger error.
USUAL_RATE = 'satellite'

#: Maximum side of the cells of a terrain that only an airborne survey can have [m].
FINE_CELL = 5.0


@dataclass(frozen=True)
class Survey:
    """Vertical errors of a survey.

    Attributes:
        title: Name, for people.
        deviation: Standard deviation [m].
        source: Reference of the deviation.
        cell: Side of a cell of the original data [m].
        words: Words in descriptions and names of files of such surveys, in lower case.
    """

    title: str
    deviation: float
    source: str
    cell: float
    words: tuple[str, ...]

    @property
    def roughness(self) -> Roughness:
        """Errors of the terrain.

        The correlation is 1/e at 70 m, so that it ends at the largest range, 120 m, of the errors
        in Oksanen and Sarjakoski (2005). It is at least that of three cells, which the filters of
        global models smooth.
        """
        source = f'{self.title}: {self.source}; {_OKSANEN}'
        return Roughness(self.deviation, max(70.0, 3.0 * self.cell), source)


_OKSANEN = (
    'correlation by Oksanen, J. and Sarjakoski, T. (2005). Error propagation of DEM-based surface '
    'derivatives. Computers & Geosciences 31, 1015-1027'
)

#: Surveys by name in scene files. Errors at 90 and 95 % are 1.645 and 1.96 standard deviations.
SURVEYS: Mapping[str, Survey] = {
    'lidar': Survey(
        'airborne lidar',
        0.15,
        'USGS (2012), Lidar Base Specification, quality level 2: 0.3 m at 95 % under plants',
        1.0,
        ('lidar', 'laser'),
    ),
    'tandem-x': Survey(
        'TanDEM-X, Copernicus DEM',
        2.4,
        'Airbus (2020), Copernicus DEM product handbook: below 4 m at 90 %',
        30.0,
        ('tandem', 'tdx', 'tdm1', 'copernicus', 'cop30', 'cop-dem', 'glo30', 'glo-30', 'worlddem'),
    ),
    'srtm': Survey(
        'SRTM',
        3.8,
        'Rodriguez, E., Morris, C. S. and Belz, J. E. (2006). A global assessment of the SRTM '
        'performance. Photogrammetric Engineering and Remote Sensing 72, 249-260: 6.2 m at 90 % '
        'in Eurasia',
        30.0,
        ('srtm',),
    ),
    'aster': Survey(
        'ASTER GDEM',
        8.7,
        'Gesch, D., Oimoen, M., Zhang, Z., Meyer, D. and Danielson, J. (2012). Validation of the '
        'ASTER global digital elevation model version 2 over the conterminous United States. '
        'ISPRS Archives XXXIX-B4, 281-286: RMSE of 8.68 m',
        30.0,
        ('aster', 'gdem'),
    ),
    'usgs': Survey(
        'National Elevation Dataset of the USGS',
        2.44,
        'Gesch, D. B. (2007). The National Elevation Dataset. In Maune, D. (ed.), Digital '
        'Elevation Model Technologies and Applications, 99-118: RMSE of 2.44 m',
        30.0,
        ('usgs', 'united states geological survey', 'u.s. geological survey', '3dep'),
    ),
}


#: Standard deviation of the ground that is interpolated from contours, and correlation length, in
#: intervals of the contours.
CONTOUR_DEVIATION, CONTOUR_CORRELATION = 0.095, 3.0

_CONTOURS = re.compile(
    r'(\d+(?:\.\d+)?)[ -]?m(?:etres?|eters?)?[ -]contours?\b'
    r'|\bcontours?(?: lines?)?(?: intervals?)?(?: of| at| every)? (\d+(?:\.\d+)?) ?m\b',
    re.IGNORECASE,
)


def contour_errors(interval: float) -> Roughness:
    """Return the errors of a ground that is interpolated from contours.

    They are those of a thin plate without every second and without three of four contours of La
    Palma (docs/VALIDATION.md), on slopes of about 10 degrees. Relief between contours adds to
    them: map standards allow 0.3 intervals.

    Args:
        interval: Difference in elevation of neighboring contours [m].
    """
    source = (
        f'interpolated from contours every {interval:g} m: {CONTOUR_DEVIATION:g} intervals by '
        'leaving out contours of La Palma (docs/benchmarks/contours.csv), below the 0.3 that the '
        'United States National Map Accuracy Standards (1947) allow'
    )
    return Roughness(CONTOUR_DEVIATION * interval, CONTOUR_CORRELATION * interval, source)


def contours_in(description: str) -> tuple[str, float] | None:
    """Return the words of a description that name contours, and their interval [m]."""
    found = _CONTOURS.search(description)
    interval = 0.0 if found is None else float(found[1] or found[2])
    return (found[0], interval) if found is not None and interval > 0.0 else None


def usual_errors(description: str, cell: float) -> tuple[Roughness, str]:
    """Return the likely errors of a terrain, and how its survey was found.

    Args:
        description: Description of the data, or the name of their file.
        cell: Side of a cell [m].
    """
    by_name = f'by its name, {description}'
    if (contours := contours_in(description)) is not None:
        return contour_errors(contours[1]), by_name
    text = description.lower()
    for survey in SURVEYS.values():
        if any(word in text for word in survey.words):
            return survey.roughness, by_name
    name = 'lidar' if cell < FINE_CELL else 'tandem-x'
    return SURVEYS[name].roughness, f'not stated, as usual for cells of {cell:.3g} m'
