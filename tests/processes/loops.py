# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A loop of requests whose child process waits, computes, sends or fails, as a test asks."""

import os
import threading

from lava_ros.errors import LavaError
from lava_ros.processes.requests import ChildProcess, RequestLoop

#: Many times the size of the buffer of a connection [bytes].
LARGE = 4 << 20


class UnloadableError(Exception):
    """An exception that is pickled, but cannot be rebuilt."""

    def __init__(self, member, problem):
        super().__init__(f'member {member} {problem}')


class AlteredError(Exception):
    """An exception whose message changes when it is rebuilt."""

    def __init__(self, member):
        super().__init__(f'member {member} is bad')


def unpicklable():
    """Return an exception that cannot be pickled."""
    error = KeyError('member 3')
    error.lock = threading.Lock()
    return error


#: Exceptions by name, and the type and the text of what arrives.
ERRORS = {
    'LavaError': (LavaError('job', 7, 'another'), LavaError, 'job is 7, expected another'),
    'OSError': (OSError(28, 'No space left'), OSError, '[Errno 28] No space left'),
    'unpicklable': (unpicklable(), RuntimeError, "KeyError: 'member 3'"),
    'altered': (AlteredError(3), RuntimeError, 'AlteredError: member 3 is bad'),
    'unloadable': (
        UnloadableError(3, 'is bad'), RuntimeError, 'UnloadableError: member 3 is bad'
    ),
}


class Loop(RequestLoop):
    """Executes the requests of tests."""

    def wait(self):
        """Reply with the ID of this process."""
        self._answer('begun', pids=[os.getpid()])

    def compute(self):
        """Compute without end."""
        self.wait()
        while True:
            pass

    def send(self):
        """Send more than a connection buffers."""
        self.wait()
        self._answer('large', data=bytes(LARGE))

    def start(self):
        """Start another process, and wait for it without end."""
        child = ChildProcess(f'{__name__}:Loop')
        child.request('compute')
        self._answer('begun', pids=[os.getpid(), *reply_of(child)['pids']])
        child.reply(3600.0)

    def echo(self, data):
        """Reply with the data."""
        self._answer('echo', data=data)

    def fail(self, kind):
        """Raise an exception."""
        raise ERRORS[kind][0]

    def send_what_cannot_be_pickled(self):
        """Reply with a lock."""
        self._answer('lock', lock=threading.Lock())

    def leave(self, status):
        """End the process, by a signal if the status is negative."""
        os._exit(status) if status >= 0 else os.kill(os.getpid(), -status)

    def describe(self):
        """Reply with the open files of this process."""
        names = [f'/proc/self/fd/{name}' for name in os.listdir('/proc/self/fd')]
        files = [os.readlink(name) for name in names if os.path.exists(name)]
        self._answer('files', files=files)


def reply_of(child):
    """Return the values of the next reply."""
    reply = child.reply(180.0)
    assert reply is not None
    return reply[1]
