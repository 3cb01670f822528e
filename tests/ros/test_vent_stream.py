# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Monitoring systems that publish the vents several times a second."""

import random
import threading

import numpy as np
import pytest

from lava_ros.layers.recording import Recording
from lava_ros.ros.codec import header
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.presets import preset_accuracy
from ros.conftest import start_flow
from ros.graph_publisher import cloud, info, vents
from ros_messages import float_image
from waiting import wait_until

#: End of the run in simulated time [s], and simulated time per time of the clock [s/s].
END, SCALE = 600.0, 50.0

RATE = 5.0

COLUMNS = {
    'id': [3.0, 7.0], 'x': [60.0, 130.0], 'y': [105.0, 205.0], 'z': [0.0, 0.0],
    'discharge': [8.0, 4.0], 'temperature': [1100.0, 1080.0], 'radius': [20.0, 15.0],
}

LAVA = {'viscosity': 1e4, 'arrhenius': 0.0, 'emissivity': 0.0, 'convection': 0.0,
        'crust_cover': 0.0, 'latent_heat': 0.0, 'solidus': 0.0, 'yield_strength': 0.0,
        'crust_strength': 0.0}


def undisturbed(terrain: Terrain) -> Simulation:
    """Run the same eruption without a node, with the vents given once."""
    names = 'x', 'y', 'discharge', 'temperature', 'radius'
    vents = tuple(
        Vent((x, y), discharge, celsius + 273.15, radius=radius)
        for x, y, discharge, celsius, radius in zip(*(COLUMNS[n] for n in names), strict=True)
    )
    accuracy = preset_accuracy('standard', spacing=4.0)
    scene = Scene(terrain, vents, Lava.paper(**LAVA))
    simulation = Simulation(scene, accuracy=accuracy, device='cpu')
    simulation.advance(END)
    return simulation


def test_vents_that_vary_with_each_message_do_not_fill_the_log(local):
    # not by its momentum, for which kernels would be compiled
    node = start_flow(local, effects_off=['inertia'])
    node.run(1.0)
    start, chance = len(node.log), random.Random(0)
    for _ in range(20):
        # 1360 Celsius is probably meant in kelvin, which is a warning
        node.deliver('/vents', vents(
            discharge=chance.uniform(10.0, 30.0), temperature=chance.uniform(1350.0, 1370.0),
            x=chance.uniform(58.0, 62.0), radius=chance.uniform(11.0, 13.0),
        ))
        node.run(0.5)
    # a warning of the temperature, and nothing about the vents and the resolution
    texts = 'vents: ', 'vents[0].temperature', ' particles across '
    assert [node.log.count(text, start) for text in texts] == [0, 1, 0], node.log[start:]
    # a vent elsewhere is a change
    node.deliver('/vents', vents(x=120.0, discharge=40.0))
    node.run_commands()
    node.run(0.5)
    node.wait_for_log('vents: 1, 40 m3/s', after=start)


@pytest.mark.nightly
def test_stream_of_vents_does_not_change_the_flow(graph):
    # at 4 m a shift of the vents by 1 m changes 2 % of the cells; at 8 m, 3 %
    terrain = Terrain(np.tile(500.0 - np.arange(120.0), (60, 1)), 5.0)
    bag = graph.directory / 'stream'
    constants = {f'lava.{name}': value for name, value in LAVA.items()}
    node = graph.node(
        device='cpu', time_scale=SCALE, end_time=END, spacing=4.0, record=True,
        bag_directory=str(bag), **constants,
    )
    listener, publisher = graph.listener(), graph.publisher()
    for topic, message in (
        ('terrain', float_image(terrain.elevation, header('map', 0))),
        ('terrain_info', info(width=120, height=60, resolution=5.0)),
    ):
        wait_until(publisher.publishers[topic].get_subscription_count)
        publisher.publishers[topic].publish(message)
    sender = publisher.publishers['vents']
    wait_until(sender.get_subscription_count)
    sent, is_finished = 0, threading.Event()

    def stream() -> None:
        nonlocal sent
        while not is_finished.wait(1.0 / RATE):
            # a small shift and increase each time, like a tracker
            noise = 1e-3 * (sent % 2)
            changed = {name: np.add(COLUMNS[name], noise) for name in ('x', 'discharge')}
            sender.publish(cloud(COLUMNS | changed))
            sent += 1

    thread = threading.Thread(target=stream)
    thread.start()
    try:
        status = listener.wait_for_status('simulation', lambda item: item['state'] == 'finished')
    finally:
        is_finished.set()
        thread.join()
    assert node.end() == 0
    assert sent > 20

    expected = undisturbed(terrain)
    frame = Recording(bag).frame_at(END)
    thickness = frame.layers['thickness'].values
    wanted = expected.snapshot().thickness
    wet, dry = (thickness > 0.1) & (wanted > 0.1), (thickness > 0.1) | (wanted > 0.1)
    assert wet.sum() >= 0.97 * dry.sum() > 240
    # the maximum would depend on a single cell
    thick = [np.quantile(values[values > 0.1], 0.9) for values in (thickness, wanted)]
    assert thick[0] == pytest.approx(thick[1], rel=0.05)
    assert int(status['particles']) == pytest.approx(expected.particle_count, rel=0.05)
    assert float(status['volume_emitted_m3']) == pytest.approx(12.0 * END, rel=1e-3)
