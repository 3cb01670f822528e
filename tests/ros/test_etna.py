# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The first day of the Etna 2001 eruption in the node."""

import json
from pathlib import Path

import numpy as np
import pytest

from lava_ros.maps.frames import Recording

DATA = Path(__file__).parents[3] / 'shared' / 'data' / 'etna2001'

HOUR, DAY = 3600.0, 86400.0

#: Radius of the vent, and particle spacing [m].
RADIUS, SPACING = 20.0, 32.0


@pytest.mark.nightly
@pytest.mark.skipif(not DATA.is_dir(), reason='needs the Etna 2001 data next to the checkout')
def test_first_day_of_etna_2001_has_volume_area_and_direction(graph):
    easting, northing = np.loadtxt(DATA / 'vent.csv', delimiter=',', skiprows=1)
    table = np.loadtxt(DATA / 'effusion_rate.csv', delimiter=',', skiprows=1)
    scene = graph.directory / 'etna.yaml'
    vent = {
        'projected': [easting, northing],
        'discharge': [[start, flux] for start, _, flux in table.tolist()],
        'temperature': 1360.0,
        'radius': RADIUS,
    }
    terrain = {'file': str(DATA / 'elevation.asc')}
    scene.write_text(json.dumps({'terrain': terrain, 'vents': [vent]}))
    bag = graph.directory / 'etna'
    node = graph.node(
        device='cpu',
        # one step of a paused node, so that its map is in the bag on any machine
        time_scale=6.0 * HOUR,
        spacing=SPACING,
        terrain_allow_holes=True,
        record=True,
        bag_directory=str(bag),
        **{
            'lava.density': 2600.0, 'lava.viscosity': 1e4, 'lava.reference_temperature': 1360.0,
            'lava.arrhenius': 0.04, 'lava.convection': 0.0,
        },
    )
    listener, publisher = graph.listener('height'), graph.publisher()
    assert publisher.call('pause', True)['success']
    graph.process('-m', 'lava_ros.cli.main', 'feed', '--scene', str(scene))
    listener.wait_for_status('simulation', lambda status: status['state'] == 'paused')
    for hours in (6.0, 12.0, 18.0, 24.0):
        assert publisher.call('step')['success']
        status = listener.wait_for_status(
            'simulation',
            lambda status, end=hours * HOUR: float(status['simulated_time_s']) >= end,
            timeout=900.0,
        )
    emitted = float(status['volume_emitted_m3'])
    assert emitted == pytest.approx(table[0, 2] * DAY, rel=1e-6)
    assert float(status['volume_error']) < 1e-5
    assert float(status['volume_left_m3']) == 0.0
    assert node.end() == 0

    frames = [Recording(bag).frame_at(hours * HOUR) for hours in (6.0, 12.0, 24.0)]
    vent_height = 0.0
    lowest = []
    for frame in frames:
        thickness = frame.layers['thickness'].values
        wet = thickness > 0.0
        ground = frame.elevation[wet]
        (x, y), (x0, y0) = frame.vents[0], frame.origin
        row, column = int((y - y0) / frame.resolution), int((x - x0) / frame.resolution)
        vent_height = float(frame.elevation[row, column])
        rows, columns = np.nonzero(wet)
        away = np.hypot(
            x0 + (columns + 0.5) * frame.resolution - x, y0 + (rows + 0.5) * frame.resolution - y
        )
        # only particles at the edge of the vent are above its centre
        climbed = (away > RADIUS + SPACING) & (ground > vent_height)
        assert thickness[wet][climbed].sum() < 0.01 * thickness[wet].sum()
        lowest.append(float(ground.min()))
    assert vent_height > lowest[0] + 100.0
    assert lowest[0] > lowest[1] + 50.0 > lowest[2] + 100.0

    footprint = np.loadtxt(DATA / 'footprint.asc', skiprows=6)[::-1] > 0
    wet = frames[-1].layers['thickness'].values > 0.0
    # the mapped flow has a mean thickness of 11.6 m at the end
    mean_thickness = emitted / (wet.sum() * 100.0)
    assert 1.5 < mean_thickness < 8.0
    assert (wet & footprint).sum() / wet.sum() > 0.6
