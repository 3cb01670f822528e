# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Run Lava2d on a flow of codes.py, which starts this script in a separate process.

Heat, crystals and crust are switched off; numerical settings are those of Lava2d's example. The
cells have the same positions relative to the vent as in the other codes.
"""

import os
from pathlib import Path
import sys
import tempfile
import time

from codes import DISCHARGE, FLOWS, VENT_RADIUS
import numpy as np
import rasterio

from lava_ros.verification.cases.case import ISOTHERMAL

#: Thermal diffusivity at which nothing freezes in a day [m2/s].
NO_DIFFUSIVITY = 1e-20


def main():
    """Write thickness and CPU time of a run."""
    folder, name, cell, output = sys.argv[1], sys.argv[2], float(sys.argv[3]), sys.argv[4]
    os.chdir(folder)
    sys.path.insert(0, folder)
    import globals as state
    import post
    import sim

    flow = FLOWS[name]
    x0, y0, x1, y1 = flow.window
    # 2^n + 1 cells; Lava2d fails if lava comes near the border
    wide, high = (cell * 2 ** np.ceil(np.log2(1.3 * side / cell)) for side in (x1 - x0, y1 - y0))
    west, south = (
        round(0.5 * (a + b - side) / cell) * cell
        for a, b, side in ((x0, x1, wide), (y0, y1, high))
    )
    half = 0.5 * cell
    x, y = np.meshgrid(
        np.arange(west - 4 * cell, west + wide + 4 * cell, cell),
        np.arange(south + high + 4 * cell, south - 4 * cell, -cell),
    )
    with tempfile.TemporaryDirectory() as place:
        ground = Path(place) / 'ground.tif'
        # Lava2d does not transform geographic coordinates
        with rasterio.open(
            ground,
            'w',
            driver='GTiff',
            width=x.shape[1],
            height=x.shape[0],
            count=1,
            dtype='float64',
            crs='EPSG:4326',
            transform=rasterio.Affine(cell, 0.0, x[0, 0], 0.0, -cell, y[0, 0]),
        ) as file:
            file.write(flow.ground(x - half, y - half) + 1000.0, 1)
        sim.set_topo(str(ground), 0.0, 0.0, west, south, west + wide, south + high)
    sim.set_init()
    sim.set_vent_props(ISOTHERMAL.reference_temperature - 273.0, ISOTHERMAL.viscosity, 0.0)
    sim.set_lava_props(ISOTHERMAL.density, lava_diffusivity=NO_DIFFUSIVITY)
    sim.set_rheo(phi_inf=0.5)
    sim.set_ambient()
    # keeps the cell size constant at all speeds
    sim.set_numerics(efficiency_max=np.inf, dt_max=5.0)
    sim.set_runtime(max_time_hr=flow.end / 3600.0, out_times=[])
    line = [half - VENT_RADIUS, half, half + VENT_RADIUS, half, 2.0 * VENT_RADIUS, DISCHARGE]
    sim.set_sources([[[0.0, *line], [flow.end, *line]]])
    # its plot and its file are not timed
    post.make_all_physics_grids = sim.write_nc = lambda *_: None
    begin = time.process_time()
    sim.run()
    seconds = time.process_time() - begin
    x, y = state.grids.x[0] - half, state.grids.y[:, 0] - half
    thickness = (state.grids.h_n + state.grids.B_n - state.grids.B0)[
        np.ix_((y > y0) & (y < y1), (x > x0) & (x < x1))
    ]
    volume = thickness.sum() * cell**2
    # after an error it still writes its report, and it may end a step late
    if abs(volume / (DISCHARGE * flow.end) - 1.0) > 0.005:
        sys.exit(f'Lava2d holds {volume:g} m3 at the end of {name}')
    np.savez(output, thickness=thickness[::-1], seconds=seconds)


if __name__ == '__main__':
    main()
