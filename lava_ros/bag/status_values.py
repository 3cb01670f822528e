# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Values of the status of a simulation in diagnostics, by key; bags contain them as text."""

import numpy as np

from lava_ros.scene import KELVIN
from lava_ros.scene.projection import system_name
from lava_ros.simulation.carriers import across_key, count_key
from lava_ros.simulation.numerical_error import NumericalError
from lava_ros.simulation.output.snapshot import Snapshot
from lava_ros.simulation.resolution import Resolution


def resolution_values(resolution: Resolution) -> dict[str, object]:
    """Return the values that describe how well the carriers resolve the flow, and its kind."""
    kind = {} if resolution.kind is None else {
        'flow_kind': resolution.kind.text(),
        'flow_kind_warnings': '; '.join(resolution.kind.warnings()),
    }
    return {
        'method': resolution.method,
        'spacing_m': f'{resolution.spacing:.4g}',
        'flow_width_m': f'{resolution.width:.4g}',
        across_key(resolution.method): f'{resolution.across:.3g}',
        **kind,
    }


def numerical_error_values(error: NumericalError) -> dict[str, str]:
    """Return the values of a numerical error that has been measured, without its text."""
    area = error.inundated
    return {
        'numerical_error_inundated': f'{area.total:.2g}',
        'numerical_error_standing': f'{error.standing.total:.2g}',
        'numerical_error_lava': f'{area.lava:.2g}',
        'numerical_error_ground': f'{area.ground:.2g}',
        'numerical_error_time_s': repr(error.time),
    }


def snapshot_values(snapshot: Snapshot, stamp_ns: int) -> dict[str, object]:
    """Return the status values of a snapshot; ``stamp_ns`` is the stamp of its maps [ns]."""
    steps = snapshot.steps
    highest = float(np.fmax.reduce(snapshot.temperature, axis=None))
    areas = {'standing_area_m2': repr(snapshot.standing_area)}
    if snapshot.inundated is not None:
        areas['inundated_area_m2'] = repr(snapshot.area(snapshot.inundated))
        areas['inundation_threshold_m'] = repr(snapshot.threshold)
    terrain = snapshot.terrain
    georeference: dict[str, object] = {}
    if terrain.epsg is not None:
        georeference['epsg'] = terrain.epsg
    if terrain.has_system:
        georeference |= {
            'coordinate_system': system_name(terrain.epsg, terrain.wkt),
            'offset_easting': repr(terrain.offset[0]),
            'offset_northing': repr(terrain.offset[1]),
        }
    return {
        'simulated_time_s': repr(snapshot.time),
        'frame_stamp_ns': stamp_ns,
        count_key(snapshot.method): snapshot.particle_count,
        **areas,
        **snapshot.budget.texts(),
        'steps': steps.count,
        'step_s': f'{steps.length:.6g}',
        'step_limit': steps.limit,
        'step_stages': steps.stages,
        # NaN without lava
        'highest_temperature_c': f'{highest - KELVIN:.6g}',
        **georeference,
    }
