# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Soak test of a real node (`make soak`): memory, deadlines, bag and CPU time.

A node in a separate process simulates, and records in files of one minute. A thread of this
process opens and closes vents, also in storms, changes the terrain, sends invalid messages,
resets, and adds and removes subscribers; a third process subscribes. The criteria are:

memory      Resident memory, once a second. The first fifth, at least a minute, is warm-up. In the
            rest, the median of the last quarter is at most 5 % above that of the first.
deadline    Time between two received messages of a grid: at most the publish period plus
            ``BOUND``.
bag         Each received message is in the bag once, except repetitions at the start of a file;
            each message in the bag was received while the listener was connected; each file is
            readable to its end and without the others.
inputs      Only bad messages are refused, and all of them, except those in a storm that never
            arrive because messages come too fast.
"""

import argparse
from collections import Counter
import os
from pathlib import Path
import platform
import statistics
import sys
import tempfile
import threading
import time
from typing import Any

from nav_msgs.msg import OccupancyGrid
import numpy as np

from lava_ros.bag import BagReader
from ros.conftest import Graph, Listener
from ros.graph_listener import line_of
from ros_domain import own_domain
from soak.feeder import Feeder, GRIDS

#: Maximum delay of a grid [s]: a step, a snapshot, a reset, and other load on the CPU.
BOUND = 2.0

#: Time between two messages of a grid in msg_configs/default.yaml [s].
PERIOD = 1.0

#: Particle spacing [m], for a few thousand particles.
SPACING = 3.0

#: Maximum growth of memory, as a fraction.
GROWTH = 0.05

#: The time at which each message was received [s], and its content.
Received = list[tuple[float, dict[str, Any]]]


def memory_of(pid: int) -> int:
    """Return the resident memory of a process [bytes]."""
    pages = Path(f'/proc/{pid}/statm').read_text().split()[1]
    return int(pages) * os.sysconf('SC_PAGE_SIZE')


def processor_time_of(pid: int) -> float:
    """Return the CPU time of a process [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def receive(listener: Listener, received: Received, seconds: float) -> None:
    """Add what arrives within a time [s]."""
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0:
        try:
            item = listener.next(left)
        except AssertionError:
            return
        received.append((time.monotonic(), item))


def soak(seconds: float, directory: Path, seed: int) -> dict[str, Any]:
    """Keep a node busy for a time [s], with a bag in a directory; return figures by name.

    ``seed`` determines the actions.
    """
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    graph, feeder = Graph(directory), Feeder(own_domain(), seed)
    received: Received = []
    memory: list[tuple[float, int]] = []
    try:
        recording = {'bag_directory': 'soak', 'bag_root': str(directory), 'bag_max_duration': 60.0}
        node = graph.node(
            program=('-m', 'lava_ros.ros.node'), msg_config='default.yaml', device='cpu',
            time_scale=20.0, spacing=SPACING, record=True, **recording,
        )
        listener, pid = graph.listener(*GRIDS), node.child.pid
        feeder.publish('vents', 'terrain_info', 'terrain')
        listener.wait_for_topic('height', lambda grid: grid['wet'] > 0)
        start, processor = time.monotonic(), processor_time_of(pid)
        received += [(start - 1.0, item) for item in listener.seen]
        feeding = threading.Thread(target=feeder.run, args=(seconds,), daemon=True)
        feeding.start()
        while time.monotonic() - start < seconds:
            receive(listener, received, 1.0)
            if node.child.poll() is not None:
                raise RuntimeError(f'the node has ended:\n{node.log}')
            memory.append((time.monotonic() - start, memory_of(pid)))
        wall, busy = time.monotonic() - start, processor_time_of(pid) - processor
        feeding.join(60.0)
        if not feeder.has_ended:
            raise RuntimeError('what feeds the node has failed, or hangs')
        feeder.call('record', False)
        receive(listener, received, 3.0)
        code = node.end()
    finally:
        graph.close()
        feeder.close()
    statuses = [item['status'] for _, item in received if item['topic'] == 'diagnostics']
    states = Counter(item['lava: simulation']['state'] for item in statuses)
    return {
        'seconds': round(wall, 1),
        'done': dict(feeder.done),
        'processor_share': round(busy / wall, 3),
        'exit_code': code,
        'states': dict(states),
        'refused': int(statuses[-1]['lava: inputs']['rejected']),
        'tracebacks': node.log.count('Traceback'),
        **memory_figures(memory),
        **deadline_figures(received, start, start + seconds),
        **bag_figures(directory / 'soak', received),
    }


def memory_figures(memory: list[tuple[float, int]]) -> dict[str, Any]:
    """Return the growth of memory after the warm-up."""
    end = memory[-1][0]
    warm = min(max(60.0, 0.2 * end), 0.5 * end)
    sizes = [size / 1e6 for at, size in memory if at >= warm]
    quarter = max(len(sizes) // 4, 1)
    first, last = (statistics.median(part) for part in (sizes[:quarter], sizes[-quarter:]))
    return {
        'memory_first_mb': round(first, 1),
        'memory_last_mb': round(last, 1),
        'memory_growth': round(last / first - 1.0, 4),
    }


def deadline_figures(received: Received, start: float, end: float) -> dict[str, Any]:
    """Return the times between two messages of each grid."""
    gaps: list[float] = []
    for topic in GRIDS:
        moments = [at for at, item in received if item['topic'] == topic and start <= at <= end]
        gaps += np.diff(moments).tolist()
    return {
        'gap_median_s': round(float(np.median(gaps)), 3),
        'gap_99_percent_s': round(float(np.quantile(gaps, 0.99)), 3),
        'gap_longest_s': round(max(gaps), 3),
    }


def bag_figures(bag: Path, received: Received) -> dict[str, Any]:
    """Compare the received messages with those in the bag."""
    reader = BagReader(bag)
    recorded: Counter[tuple[str, int]] = Counter()
    digests: dict[tuple[str, int], str] = {}
    for message in reader.messages():
        key = message.topic.strip('/'), message.publish_ns
        is_repeated = message.publish_ns < message.stamp_ns
        if not is_repeated and key[0] in (*GRIDS, 'diagnostics'):
            recorded[key] += 1
            if key[0] in GRIDS:
                digests[key] = line_of(key[0], OccupancyGrid, bytes(message.data))['cells']
    known = {(item['topic'], item['stamp_ns']): item.get('cells') for _, item in received}
    first = min(stamp for _, stamp in known)
    # messages before the bag was opened, or after it was closed, are not in it
    begin, end = (pick(stamp for _, stamp in recorded) for pick in (min, max))
    for path in reader.files:
        alone = BagReader(path)
        assert alone.message_count == sum(1 for _ in alone.messages())
        assert {'/terrain', '/terrain_info', '/vents'} <= set(alone.topics), path
    return {
        'bag_files': len(reader.files),
        'bag_mb': round(reader.size / 1e6, 2),
        'bag_finished': not reader.recovered,
        'received_not_recorded': sum(
            begin <= key[1] <= end and key not in recorded for key in known
        ),
        'recorded_not_received': sum(key[1] >= first and key not in known for key in recorded),
        'differs': sum(digest != known.get(key, digest) for key, digest in digests.items()),
        'recorded_twice': sum(count - 1 for count in recorded.values()),
    }


def verdicts(figures: dict[str, Any]) -> list[tuple[str, str, str, bool]]:
    """Return name, measured value, requirement and result of each criterion."""
    done, refused = figures['done'], figures['refused']
    bad, storms = done.get('bad message', 0), done.get('storm', 0)
    most, gap = bad + done.get('bad in storms', 0), figures['gap_longest_s']
    growth, longest = figures['memory_growth'], PERIOD + BOUND
    none_of = {
        'received, not in the bag': figures['received_not_recorded'],
        'in the bag, not received': figures['recorded_not_received'],
        'grids that differ from the wire': figures['differs'],
        'in the bag twice': figures['recorded_twice'],
        'failures of the simulation': figures['states'].get('failed', 0),
        'tracebacks in the log': figures['tracebacks'],
        'exit status': figures['exit_code'],
    }
    is_finished = figures['bag_finished']
    return [
        ('memory growth after warm-up', f'{growth:+.2%}', f'<= {GROWTH:.0%}', growth <= GROWTH),
        ('longest time between two grids', f'{gap:.2f} s', f'<= {longest:g} s', gap <= longest),
        *((name, str(count), '0', count == 0) for name, count in none_of.items()),
        ('bag finished', str(is_finished), 'True', is_finished),
        ('bad messages refused', str(refused), f'{bad} to {most}', bad <= refused <= most),
        ('storms of vents', str(storms), '>= 1', storms >= 1),
    ]


def main() -> int:
    """Run the soak test, print the table, and return 0 if all criteria are met."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', 1)[0])
    parser.add_argument('--minutes', type=float, default=30.0, help='how long (default: 30)')
    parser.add_argument('--seed', type=int, default=1, help='chooses what is done')
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix='lava_soak_', ignore_cleanup_errors=True) as folder:
        figures = soak(60.0 * args.minutes, Path(folder), args.seed)
    rows = verdicts(figures)
    print(f'{args.minutes:g} minutes, {platform.machine()}, {os.cpu_count()} cores')
    for name, value, asked, holds in rows:
        print(f'  {name:34} {value:>14}  {asked:>10}  {"holds" if holds else "FAILS"}')
    for name, figure in figures.items():
        print(f'  {name:34} {figure}')
    return 0 if all(holds for *_, holds in rows) else 1


if __name__ == '__main__':
    sys.exit(main())
