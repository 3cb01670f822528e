# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the cost of a mask with a heartbeat, and the masks that subscribers receive.

    python docs/benchmarks/masks.py 'MACHINE' > docs/benchmarks/masks.csv

The node publishes the shipped ``keepout_mask`` for terrains of several sizes, on this machine, to
a reliable and to a best-effort subscriber, each a process. The simulation has ended. The processor
times are those of a process during the measurement, in percent of a core.
"""

import csv
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

from nav_msgs.msg import OccupancyGrid
import numpy as np
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
import yaml

ROOT = Path(__file__).parents[2]

#: Columns and rows of the terrain, and heartbeats of the mask [s]; the long one is for comparison.
SIDES, HEARTBEATS = (256, 500, 1000, 2000), (0.5, 3600.0)

#: Duration of a measurement, and wait for the node and its subscribers [s].
SPAN, START = 30.0, 25.0


def listen(reliability):
    """Count masks during ``SPAN``; print their number and the processor time per second."""
    rclpy.init()
    node, count = rclpy.create_node(f'listener_{os.getpid()}'), 0

    def add(_):
        nonlocal count
        count += 1

    profile = QoSProfile(
        depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL,
        reliability=ReliabilityPolicy.get_from_short_key(reliability),
    )
    node.create_subscription(OccupancyGrid, 'keepout_mask', add, profile)
    end = time.monotonic() + START
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    count, before, end = 0, time.process_time(), time.monotonic() + SPAN
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    print(json.dumps([count, (time.process_time() - before) / SPAN]))


def processor_time(process):
    """Return the processor time of a process so far [s]."""
    fields = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
    return sum(map(int, fields[11:13])) / os.sysconf('SC_CLK_TCK')


def measure(folder, side, heartbeat):
    """Return the row of a terrain and a heartbeat."""
    slope = np.mgrid[0:side, 0:side][1].astype(np.float32)
    np.savez(folder / 'slope.npz', elevation=slope, resolution=10.0)
    layers = yaml.safe_load((ROOT / 'msg_configs/nav2_keepout.yaml').read_text())['layers']
    mask = {**layers['keepout_mask'], 'heartbeat': heartbeat}
    (folder / 'layers.yaml').write_text(yaml.safe_dump({'layers': {'keepout_mask': mask}}))
    vents = [{'position': [5.0 * side, 5.0 * side], 'discharge': 60.0, 'radius': 30.0}]
    scene = {'terrain': {'file': 'slope.npz'}, 'vents': vents}
    (folder / 'scene.yaml').write_text(yaml.safe_dump(scene))
    values = 'device:=cpu preset:=draft end_time:=60.0 time_scale:=60.0'
    values += f' msg_config:={folder}/layers.yaml'
    values += f' scene:={folder}/scene.yaml'
    words = [word for value in values.split() for word in ('-p', value)]
    module = [sys.executable, '-m', 'lava_ros.ros.node', '--ros-args', *words]
    with (folder / 'log').open('w') as log:
        node = subprocess.Popen(module, stdout=log, stderr=log)
    listeners = {
        name: subprocess.Popen(
            [sys.executable, __file__, '--listen', name], stdout=subprocess.PIPE
        )
        for name in ('reliable', 'best_effort')
    }
    try:
        time.sleep(START)
        before = processor_time(node)
        time.sleep(SPAN - 1.0)
        used = (processor_time(node) - before) / (SPAN - 1.0)
        heard = {name: json.loads(item.communicate()[0]) for name, item in listeners.items()}
    finally:
        for item in (node, *listeners.values()):
            item.kill()
            item.wait()
    return {
        'side': side, 'heartbeat_s': heartbeat, 'due': int(SPAN / heartbeat),
        **{f'{name}_received': received for name, (received, _) in heard.items()},
        'node_percent': f'{100.0 * used:.1f}',
        **{f'{name}_percent': f'{100.0 * part:.1f}' for name, (_, part) in heard.items()},
    }


def main():
    """Print the table."""
    if sys.argv[1] == '--listen':
        listen(sys.argv[2])
        return
    command, writer = f"python docs/benchmarks/masks.py '{sys.argv[1]}'", None
    for side in SIDES:
        for heartbeat in HEARTBEATS:
            with tempfile.TemporaryDirectory() as folder:
                row = measure(Path(folder), side, heartbeat)
            row |= {'span_s': SPAN, 'machine': sys.argv[1], 'command': command}
            if writer is None:
                writer = csv.DictWriter(sys.stdout, row, lineterminator='\n')
                writer.writeheader()
            writer.writerow(row)
            sys.stdout.flush()


if __name__ == '__main__':
    main()
