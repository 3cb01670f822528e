# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Table of the maps that are written as rasters, and the QGIS style of each.

Everything that a GeoTIFF states about its values follows from this table: unit, description, no
data, and colours. A map without a row cannot be written.
"""

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from lava_ros.files import write_output
from lava_ros.products.colours import limits_of, STYLES

#: Value of cells without data, in every file.
NODATA = -9999


@dataclass(frozen=True)
class RasterLayer:
    """A map as a raster: one band of a GeoTIFF, or one variable of a NetCDF file.

    Attributes:
        drawn: How it is drawn: a key of ``colours.STYLES``.
        unit: Unit of the values, as in the band of a GeoTIFF.
        meaning: Definition of the values, and of cells without data.
        is_whole: True if the values are whole numbers, which are stored as int16.
    """

    drawn: str
    unit: str
    meaning: str
    is_whole: bool = False

    def cells(self, values: np.ndarray) -> np.ndarray:
        """Return the values as stored in a file, NaN without data.

        Files have no data where a thickness or a change is 0.
        """
        is_known = {'thickness': values > 0.0, 'change': values != 0.0}.get(self.drawn)
        return values if is_known is None else np.where(is_known, values, np.float32(np.nan))

    def stored(self, values: np.ndarray) -> np.ndarray:
        """Return ``cells`` as float32 or int16, with ``NODATA`` in place of NaN."""
        cells = self.cells(values)
        kind = np.int16 if self.is_whole else np.float32
        return np.where(np.isfinite(cells), cells, NODATA).astype(kind)


#: Lava that counts, with the tag of its minimum thickness.
_INUNDATING = 'lava at or above the threshold thickness (inundation_threshold_m)'

#: All maps by name.
RASTER_LAYERS = {
    'thickness': RasterLayer(
        'thickness', 'm', 'thickness of the standing lava; no data: no lava'
    ),
    'peak_thickness': RasterLayer(
        'thickness', 'm', 'largest lava thickness in any map; no data: no lava'
    ),
    'temperature': RasterLayer(
        'temperature', 'degC', 'depth-averaged temperature of the lava; no data: no lava'
    ),
    'hazard': RasterLayer(
        'hazard', '1',
        'hazard index: 0: no lava so far, 1 to 99: harmful (50: lava has drained away), '
        '100: lethal; no data: outside the terrain',
        is_whole=True,
    ),
    'arrival': RasterLayer(
        'arrival', 's',
        f'simulated time at which {_INUNDATING} reached the cell; no data: it did not',
    ),
    'inundated': RasterLayer(
        'inundated', '1',
        f'fraction of the cell that {_INUNDATING} has covered so far, at '
        'least 0.02 where it has touched the cell; no data: outside the terrain',
    ),
    'inundation_probability': RasterLayer(
        'probability', '%',
        f'probability that {_INUNDATING} reaches the cell '
        'within the horizon (horizon_s); 0: in no member, a probability below unseen_percent; no '
        'data: outside the terrain',
    ),
    'probability_change': RasterLayer(
        'change', '%',
        'probability of inundation with the barriers minus that without them, in percentage '
        'points; no data: no change, or outside the terrain',
    ),
    'expected_peak_thickness': RasterLayer(
        'thickness', 'm', 'mean over the members of the largest lava thickness; no data: no lava'
    ),
    'largest_peak_thickness': RasterLayer(
        'thickness', 'm',
        'largest lava thickness of any member, which another eruption exceeds with a probability '
        'below unseen_percent; no data: no lava',
    ),
    'arrival_time_earliest': RasterLayer(
        'arrival', 's',
        f'time from the start of the earliest arrival of {_INUNDATING} '
        'in any member; it comes earlier with a probability below unseen_percent; '
        'no data: it reached the cell in no member within the horizon (horizon_s)',
    ),
    **{
        f'arrival_time_p{percent}': RasterLayer(
            'arrival', 's',
            f'time from the start by which {_INUNDATING} '
            f'has reached the cell in {percent} % of all members, to arrival_error_s and a time '
            f'step; it comes earlier with a probability of arrives_before_p{percent}_percent; no '
            'data: it reached the cell in fewer members within the horizon (horizon_s)',
        )
        for percent in (10, 50, 90)
    },
    'elevation': RasterLayer(
        'elevation', 'm', 'elevation of the ground without lava; no data: unknown'
    ),
    'runs': RasterLayer(
        'probability', '%',
        'runs whose lava reached the cell, in percent of all; no data: outside the terrain',
    ),
    'comparison': RasterLayer(
        'comparison', '1',
        '0: neither, 1: hit, 2: miss, 3: false alarm; no data: outside the terrain',
        is_whole=True,
    ),
}


def write_style(path: Path, name: str, values: np.ndarray) -> Path:
    """Write the QGIS style of a map next to its GeoTIFF, and return its path (.qml).

    Cells without lava are transparent. Colours and their limits match printed pages.

    Args:
        path: The GeoTIFF.
        name: Key of the map in ``RASTER_LAYERS``.
        values: The map, NaN without data; any shape.

    Raises:
        LavaError: If the file cannot be written.
    """
    layer = RASTER_LAYERS[name]
    style = STYLES[layer.drawn]
    root = ElementTree.Element('qgis', version='3.22', styleCategories='Symbology')
    look = {'band': '1', 'opacity': '0.85', 'alphaBand': '-1', 'nodataColor': ''}
    pipe = ElementTree.SubElement(root, 'pipe')
    low, high = limits_of(layer.drawn, layer.cells(values))
    drawn = ElementTree.SubElement(pipe, 'rasterrenderer', look, type='singlebandpseudocolor')
    drawn.set('classificationMin', repr(low))
    drawn.set('classificationMax', repr(high))
    shader = ElementTree.SubElement(drawn, 'rastershader')
    shader = ElementTree.SubElement(
        shader, 'colorrampshader', classificationMode='1', clip='0',
        # a discrete ramp uses a colour for all values up to the value of the item
        colorRampType='DISCRETE' if style.classes else 'INTERPOLATED',
        minimumValue=repr(low), maximumValue=repr(high),
    )
    ends = style.classes or {
        value: _label(layer, value)
        for value in np.linspace(low, high, len(style.colours)).tolist()
    }
    stops = [
        (value, colour, '255', label)
        for (value, label), colour in zip(ends.items(), style.colours, strict=True)
    ]
    # a value of 0 means that there is no lava
    if layer.drawn in ('thickness', 'hazard', 'inundated', 'probability', 'comparison'):
        if not style.classes:
            stops[0] = (1e-3 * high, *stops[0][1:3], f'above 0{_unit(layer)}')
        none = 'in no member' if layer.drawn == 'probability' else 'no lava'
        stops.insert(0, (0.0, style.colours[0], '0', none))
    for value, colour, alpha, label in stops:
        item = {'value': repr(value), 'color': colour, 'alpha': alpha, 'label': label}
        ElementTree.SubElement(shader, 'item', item)
    ElementTree.SubElement(root, 'blendMode').text = '0'
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding='unicode')
    head = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
    output = path.with_suffix('.qml')
    write_output('output', output, head + text + '\n')
    return output


def _unit(layer: RasterLayer) -> str:
    return {'1': '', 'degC': ' °C'}.get(layer.unit, f' {layer.unit}')


def _label(layer: RasterLayer, value: float) -> str:
    """Return the label of a colour; times are in hours."""
    if layer.unit == 's':
        return f'{value / 3600.0:.3g} h'
    return f'{value:.4g}{_unit(layer)}'
