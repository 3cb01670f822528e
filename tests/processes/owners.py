# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Programs with child processes: each prints their IDs at some moment, and waits to be ended."""

import atexit
from functools import partial
import os
from pathlib import Path
import threading
import time

from lava_ros.files.reader import client
from lava_ros.forecast.pool import Pool
from lava_ros.processes import child
from lava_ros.processes.requests import ChildProcess
from processes.loops import LARGE, Loop, reply_of

LOOP = f'{Loop.__module__}:{Loop.__name__}'


def starting():
    """Start a process whose start never ends."""
    process = ChildProcess('processes.hanging:Loop')
    return process, [process.pid]


def asked(request):
    """Start a loop, and wait until a request has begun."""
    process = ChildProcess(LOOP)
    process.request(request)
    return process, reply_of(process)['pids']


def while_both_send():
    """Send large requests to a process whose large replies are not read."""
    process, pids = asked('wait')

    def send():
        while True:
            process.request('echo', data=bytes(LARGE))

    threading.Thread(target=send, daemon=True).start()
    return process, pids


def reading(task):
    """Start the reader, with a task that never ends, or none."""
    child._CODE = child._CODE.replace('from', (
        'import lava_ros.files.reader.process as process, time; '
        'process.TASKS["hang"] = "vectors", "hang"; '
        'import lava_ros.files.reader.vectors as vectors; '
        'vectors.hang = lambda *_, **__: time.sleep(3600.0); from'
    ), 1)
    client.start()
    if task:
        read = partial(client.read_in_process, 'a', 'a', task, ())
        threading.Thread(target=read, daemon=True).start()
    return client._readers, [client._readers[0].pid]


def in_a_pool():
    """Run two jobs that never end."""
    folder = Path(os.environ['LAVA_TEST_FOLDER'])
    pool = Pool(partial(hang, folder), 2)
    threading.Thread(target=list, args=(pool(range(2)),), daemon=True).start()
    while len(list(folder.iterdir())) < 2:
        time.sleep(0.01)
    return pool, [int(path.name) for path in folder.iterdir()]


def hang(folder, job):
    """Note the ID of this process, and never return."""
    (folder / str(os.getpid())).touch()
    time.sleep(3600.0)


#: What a process does when its owner ends.
OWNERS = {
    'starts': starting,
    'waits': partial(asked, 'wait'),
    'computes': partial(asked, 'compute'),
    'sends': partial(asked, 'send'),
    'sends and receives': while_both_send,
    'has a child': partial(asked, 'start'),
    'waits for files': partial(reading, ''),
    'reads a file': partial(reading, 'hang'),
    'runs jobs': in_a_pool,
}


def main(name, then):
    """Start the processes, print their IDs, and wait or return."""
    # ends last, so that the other threads run on while this one ends
    atexit.register(time.sleep, 0.2)
    kept = OWNERS[name]()
    print(*kept[1], flush=True)
    if then == 'waits':
        time.sleep(3600.0)
