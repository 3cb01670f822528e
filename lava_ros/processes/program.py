# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A child process that is a program of its own, which Ctrl+C or the end of its parent ends."""

from queue import SimpleQueue
import runpy
import signal
import socket
import sys
import threading
import time

from lava_ros.processes.received import receive_in_thread

#: Time for a program to end in order after the end of its parent [s].
PATIENCE = 10.0


def main(descriptor: str, module: str, *arguments: str) -> None:
    """Run a module as ``python -m``, and interrupt it when the parent has gone."""
    connection = socket.socket(fileno=int(descriptor))

    def end() -> bytes:
        # nothing is ever sent
        connection.recv(1)
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
        time.sleep(PATIENCE)
        raise EOFError

    receive_in_thread(end, SimpleQueue())
    sys.argv[1:] = arguments
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    runpy.run_module(module, run_name='__main__', alter_sys=True)
