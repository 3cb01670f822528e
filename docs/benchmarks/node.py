# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the start of the node to its first grid, and the cost of publishing over DDS.

The output is node_h200.csv; the arguments after the machine are optional:

    python docs/benchmarks/node.py cuda:0 'machine' 2000 1000000 5 > node_h200.csv

Start: time from the start of the process `lava ros node` with a scene file of a terrain and one
vent to its first grid in the process of a waiting subscriber. The kernel cache is a new folder, so
only the first start compiles.

Publishing: the node resumes from a checkpoint with that many particles, and runs at full speed in
steps of fixed length. It publishes a grid ten times a second or every other second, in
alternation. Steps are those in the node's diagnostics.
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

#: Timeout of the first grid, with compilation [s].
TIMEOUT = 150.0

#: Time of counting steps, and time before it [s].
SPAN, SETTLE = 6.0, 2.0

#: Two rates of grids [Hz].
OFTEN, SELDOM = 10.0, 0.5


def listen():
    """Run the subscriber: print a line for each grid and each pair of stamp and steps."""
    from diagnostic_msgs.msg import DiagnosticArray
    from nav_msgs.msg import OccupancyGrid

    rclpy.init()
    node = rclpy.create_node('listener')
    last = [None]

    def grid(data):
        # raw bytes: deserialization is not a cost of the node
        print(json.dumps({'grid': time.time(), 'size': len(data)}), flush=True)

    def diagnostics(message):
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            pair = (values.get('frame_stamp_ns'), values.get('steps'))
            if pair[1] and pair != last[0]:
                last[0] = pair
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
        """Start the process, and wait until it is ready."""
        self.path = folder / 'listener.txt'
        self.file = self.path.open('w')
        command = [sys.executable, __file__, 'listen']
        self.process = subprocess.Popen(command, stdout=self.file, env=env)
        self.wait('ready')

    def lines(self):
        """Return the lines written so far."""
        text = self.path.read_text()
        return [json.loads(line) for line in text[: text.rfind('\n') + 1].splitlines()]

    def wait(self, key, since=0.0, count=1, node=None):
        """Wait for lines with a key at or after a time, while the node runs; return them."""
        end = time.monotonic() + TIMEOUT
        while True:
            lines = [line for line in self.lines() if line.get(key, -1.0) >= since]
            if len(lines) >= count:
                return lines
            assert time.monotonic() < end, f'{len(lines)} {key} in time'
            assert self.process.poll() is None, 'the listener has ended'
            assert node is None or node.process.poll() is None, node.log.read_text()[-2000:]
            time.sleep(0.01)

    def stop(self):
        """Kill the process."""
        self.process.kill()
        self.process.wait()


class Node:
    """Process of `lava ros node`."""

    def __init__(self, folder, env, **parameters):
        """Start the process with parameters."""
        words = [f'{name}:={value}' for name, value in parameters.items()]
        command = [sys.executable, '-m', 'lava_ros.cli.main', 'ros', 'node', '--ros-args']
        for word in words:
            command += ['-p', word]
        self.log = folder / 'node.txt'
        self.start = time.time()
        with self.log.open('w') as log:
            self.process = subprocess.Popen(
                command, env=env, stdout=log, stderr=subprocess.STDOUT
            )

    def stop(self):
        """Stop the process like Ctrl+C."""
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(15.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


def layers_file(folder, rate):
    """Write a configuration of only the default layer `height`, with a rate [Hz]."""
    data = yaml.safe_load(Path(find_file('default.yaml', 'msg_configs')).read_text())
    data['layers'] = {'height': {**data['layers']['height'], 'rate': rate}}
    path = folder / f'layers_{rate:g}.yaml'
    path.write_text(yaml.safe_dump(data))
    return path


def scene_file(folder, cells):
    """Write a scene file of a slope with one vent."""
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
    """Write a bag with a checkpoint of a field of lava."""
    simulation = lava_field(particles, effect_sets()['green'], device, cells=cells)
    path = folder / 'bag'
    with BagWriter(path, custom_data={}) as writer:
        writer.attach(NAME, MEDIA_TYPE, simulation.checkpoint().to_bytes(), time.time_ns())
    return path


def first_grids(folder, env, device, cells, repetitions):
    """Return the times from each start of the node to its first grid [s]; the first compiles."""
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
    """Return steps and grids per second of a node that publishes at a rate, and its particles."""
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

    def write(benchmark, values, unit):
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
        write('start to the first grid, empty kernel cache', times[:1], 's')
        write('start to the first grid, full kernel cache', times[1:], 's')
        bag = checkpoint_bag(folder, device, cells, particles)
        seldom, often = [step_rate(folder, env, device, bag, SELDOM)], []
        for _ in range(repetitions):
            often.append(step_rate(folder, env, device, bag, OFTEN))
            seldom.append(step_rate(folder, env, device, bag, SELDOM))
        write('particles', [one[2] for one in often], '')
        write('steps, a grid every other second', [one[0] for one in seldom], 'steps/s')
        write('steps, ten grids a second', [one[0] for one in often], 'steps/s')
        around = [0.5 * (one[0] + two[0]) for one, two in pairwise(seldom)]
        slower = [1.0 - one[0] / two for one, two in zip(often, around, strict=True)]
        write('steps slow by', [100.0 * fraction for fraction in slower], '%')
        write('grids that arrive', [one[1] for one in often], '1/s')


if __name__ == '__main__':
    listen() if sys.argv[1] == 'listen' else main()
