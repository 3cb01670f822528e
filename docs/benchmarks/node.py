# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""How soon the node publishes its first grid, and what publishing costs it, over DDS.

It makes node_h200.csv; what follows the machine may be left out:

    python docs/benchmarks/node.py cuda:0 'machine' 2000 1000000 5 > node_h200.csv

Start: from the start of the process `lava node` with a scene file, its terrain and one vent to its
first grid in a subscriber's process that was there before. The kernel cache is a new folder: the
first start compiles, the others find it full.

Publishing: the node goes on from a checkpoint with that many particles, in steps of fixed length,
as fast as it can. It publishes a grid ten times a second to the subscriber, or every other
second, by the file of layers; steps by the node's own diagnostics, turn about.
"""

import csv
from itertools import pairwise
import json
import os
from pathlib import Path
import signal
from statistics import median
import subprocess
import sys
import tempfile
import time

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
import yaml

from lava_ros.bag.checkpoints import MEDIA_TYPE, NAME
from lava_ros.bag.writer import BagWriter
from lava_ros.files.resources import find_file
from lava_ros.ros import qos
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field

#: How long a node may take to its first grid [s]: it may have to compile.
PATIENCE = 150.0

#: Time over which steps are counted, and up to then [s].
SPAN, SETTLE = 6.0, 2.0

#: Grids a second, often and seldom [Hz].
OFTEN, SELDOM = 10.0, 0.5


def listen():
    """Be the subscriber: a line for each grid and each pair of stamp and steps."""
    from diagnostic_msgs.msg import DiagnosticArray
    from nav_msgs.msg import OccupancyGrid

    rclpy.init()
    node = rclpy.create_node('listener')
    seen = [None]

    def grid(data):
        # the bytes as they come: to make a message of them is not the node's affair
        print(json.dumps({'grid': time.time(), 'size': len(data)}), flush=True)

    def diagnostics(message):
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            pair = (values.get('frame_stamp_ns'), values.get('steps'))
            if pair[1] and pair != seen[0]:
                seen[0] = pair
                particles = int(values['particles'])
                line = {'stamp': 1e-9 * int(pair[0]), 'steps': int(pair[1]), 'n': particles}
                print(json.dumps(line), flush=True)

    node.create_subscription(
        OccupancyGrid, 'height', grid, qos.ros_profile(qos.LATCHED), raw=True
    )
    node.create_subscription(
        DiagnosticArray, '/diagnostics', diagnostics, qos.ros_profile(qos.DIAGNOSTICS)
    )
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    print(json.dumps({'ready': time.time()}), flush=True)
    while True:
        executor.spin_once()


class Listener:
    """The subscriber's process."""

    def __init__(self, folder, env):
        """Start it, and wait until it listens."""
        self.path = folder / 'listener.txt'
        self.file = self.path.open('w')
        command = [sys.executable, __file__, 'listen']
        self.process = subprocess.Popen(command, stdout=self.file, env=env)
        self.wait('ready')

    def lines(self):
        """What it has written so far."""
        text = self.path.read_text()
        return [json.loads(line) for line in text[: text.rfind('\n') + 1].splitlines()]

    def wait(self, key, since=0.0, count=1, node=None):
        """The lines with a key from a moment on, when there are some; a node lives until then."""
        end = time.monotonic() + PATIENCE
        while True:
            lines = [line for line in self.lines() if line.get(key, -1.0) >= since]
            if len(lines) >= count:
                return lines
            assert time.monotonic() < end, f'{len(lines)} {key} in time'
            assert self.process.poll() is None, 'the listener has ended'
            assert node is None or node.process.poll() is None, node.log.read_text()[-2000:]
            time.sleep(0.01)

    def stop(self):
        """End it."""
        self.process.kill()
        self.process.wait()


class Node:
    """A process `lava node`."""

    def __init__(self, folder, env, **parameters):
        """Start it."""
        words = [f'{name}:={value}' for name, value in parameters.items()]
        command = [sys.executable, '-m', 'lava_ros.cli.main', 'node', '--ros-args']
        for word in words:
            command += ['-p', word]
        self.log = folder / 'node.txt'
        self.start = time.time()
        with self.log.open('w') as log:
            self.process = subprocess.Popen(
                command, env=env, stdout=log, stderr=subprocess.STDOUT
            )

    def stop(self):
        """End it as Ctrl+C does."""
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(15.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


def layers_file(folder, rate):
    """A file with the default layer `height` alone, at another rate."""
    data = yaml.safe_load(Path(find_file('default.yaml', 'msg_configs')).read_text())
    data['layers'] = {'height': {**data['layers']['height'], 'rate': rate}}
    path = folder / f'layers_{rate:g}.yaml'
    path.write_text(yaml.safe_dump(data))
    return path


def scene_file(folder, cells):
    """A slope with one vent."""
    x = np.arange(cells) * 5.0
    rough = np.random.default_rng(1).normal(scale=0.2, size=(cells, cells))
    np.savez(folder / 'ground.npz', elevation=2000.0 - 0.1 * x + rough, resolution=5.0)
    scene = {
        'terrain': {'file': 'ground.npz'},
        'vents': [{'position': [cells, 2.5 * cells], 'discharge': 20.0}],
    }
    path = folder / 'scene.yaml'
    path.write_text(yaml.safe_dump(scene))
    return path


def checkpoint_bag(folder, device, cells, particles):
    """A bag to resume from: a field of lava."""
    simulation = lava_field(particles, effect_sets()['green'], device, cells=cells)
    path = folder / 'bag'
    with BagWriter(path, custom_data={}) as writer:
        writer.attach(NAME, MEDIA_TYPE, simulation.checkpoint().to_bytes(), time.time_ns())
    return path


def first_grids(folder, env, device, cells, repetitions):
    """Seconds from each start of the node to its first grid; the first compiles."""
    scene, config = scene_file(folder, cells), layers_file(folder, OFTEN)
    times = []
    for _ in range(repetitions + 1):
        listener = Listener(folder, env)
        node = Node(folder, env, scene=scene, device=device, msg_config=config)
        try:
            times.append(listener.wait('grid', node=node)[0]['grid'] - node.start)
        finally:
            node.stop()
            listener.stop()
    return times


def step_rate(folder, env, device, bag, rate):
    """Steps a second of a node that publishes at a rate, grids a second, and particles."""
    listener = Listener(folder, env)
    node = Node(
        folder,
        env,
        resume=bag,
        device=device,
        msg_config=layers_file(folder, rate),
        time_scale=1e6,
        checkpoint_period=0.0,
    )
    try:
        begin = listener.wait('grid', node=node)[0]['grid'] + SETTLE
        time.sleep(max(0.0, begin + SPAN - time.time()))
        pairs = listener.wait('stamp', begin, 3, node)
        grids = listener.wait('grid', begin, 2, node)
    finally:
        node.stop()
        listener.stop()
    passed = pairs[-1]['stamp'] - pairs[0]['stamp']
    arrived = (len(grids) - 1) / (grids[-1]['grid'] - grids[0]['grid'])
    return (pairs[-1]['steps'] - pairs[0]['steps']) / passed, arrived, pairs[-1]['n']


def main():
    """Print the table."""
    device, machine = sys.argv[1:3]
    cells, particles, repetitions = (int(word) for word in (*sys.argv[3:6], 2000, 1000000, 5)[:3])
    command = ' '.join(['python docs/benchmarks/node.py', device, f"'{machine}'", *sys.argv[3:]])
    table = csv.writer(sys.stdout, lineterminator='\n')
    table.writerow(['benchmark', 'case', 'value', 'unit', 'low', 'high', 'machine', 'command'])

    def tell(benchmark, values, unit):
        case = f'{cells} x {cells} cells'
        numbers = [f'{value:.4g}' for value in (median(values), min(values), max(values))]
        table.writerow([benchmark, case, numbers[0], unit, *numbers[1:], machine, command])
        sys.stdout.flush()

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        env = os.environ | {
            'ROS_DOMAIN_ID': str(100 + os.getpid() % 100),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'WARP_CACHE_PATH': str(folder / 'kernels'),
            'ROS_LOG_DIR': str(folder),
        }
        times = first_grids(folder, env, device, cells, repetitions)
        tell('start to the first grid, empty kernel cache', times[:1], 's')
        tell('start to the first grid, full kernel cache', times[1:], 's')
        bag = checkpoint_bag(folder, device, cells, particles)
        seldom, often = [step_rate(folder, env, device, bag, SELDOM)], []
        for _ in range(repetitions):
            often.append(step_rate(folder, env, device, bag, OFTEN))
            seldom.append(step_rate(folder, env, device, bag, SELDOM))
        tell('particles', [one[2] for one in often], '')
        tell('steps, a grid every other second', [one[0] for one in seldom], 'steps/s')
        tell('steps, ten grids a second', [one[0] for one in often], 'steps/s')
        around = [0.5 * (one[0] + two[0]) for one, two in pairwise(seldom)]
        slower = [1.0 - one[0] / two for one, two in zip(often, around, strict=True)]
        tell('steps slow by', [100.0 * share for share in slower], '%')
        tell('grids that arrive', [one[1] for one in often], '1/s')


if __name__ == '__main__':
    listen() if sys.argv[1] == 'listen' else main()
