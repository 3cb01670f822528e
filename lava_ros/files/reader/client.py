# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The client of the reader process, used in commands and nodes.

A process starts its reader with its first file, and all its threads share it. A request has the
name of a task, its options, and files by descriptor: the reader opens none. The answer is JSON and
arrays in memory that both processes share.
"""

from collections.abc import Iterable
import fcntl
import json
import logging
import mmap
import os
from pathlib import Path
import signal
import socket
import subprocess
import threading
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError, RefusalError
from lava_ros.files import open_input
from lava_ros.files.reader.confinement import MEMORY_LIMIT, SWITCHES, TIME_LIMIT
from lava_ros.files.reader.memory import ANSWER, MAP_FLAGS, REQUEST
from lava_ros.processes.child import Child

#: Maximum size of an answer [bytes].
MAX_ANSWER = 8 << 30

#: Types of arrays in an answer.
KINDS = (
    'int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'int64', 'uint64', 'float32',
    'float64',
)

#: A file for the reader: its name in the reader, and its path or its bytes.
File = tuple[str, Path | bytes]


class Answer(NamedTuple):
    """Result of a task: plain data, and arrays."""

    data: Any
    arrays: list[np.ndarray]


class _Reader(Child):
    """A running reader process."""

    def __init__(self) -> None:
        super().__init__(
            'lava_ros.files.reader.process',
            # hooks of .pth files are not run: they take longer than Python itself
            switches=['-I', '-S'], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            cwd='/', env={**os.environ, **SWITCHES},
        )

    def ask(self, request: dict[str, Any], files: Iterable[File]) -> Answer:
        """Send a request and its files, and return the answer.

        Raises:
            ChildProcessError: If the reader ended.
        """
        with _shared_file() as shared:
            try:
                items = list(files)
                text = json.dumps({**request, 'files': [name for name, _ in items]}).encode()
                self.channel.sendall(REQUEST.pack(len(text)) + text)
                socket.send_fds(self.channel, [b'.'], [shared.fileno()])
                for _, content in items:
                    with _opened(content) as file:
                        socket.send_fds(self.channel, [b'.'], [file.fileno()])
                place, length = ANSWER.unpack(_receive(self.channel, ANSWER.size))
                return _read_answer(shared, place, length)
            except (EOFError, BrokenPipeError, ConnectionResetError) as error:
                raise self.ended() from error


_LOCK = threading.Lock()
_readers: list[_Reader] = []


def start() -> None:
    """Start the reader, which then loads GDAL while this process does other work."""
    with _LOCK:
        _running()


def _running() -> _Reader:
    if not (_readers and _readers[0].is_usable):
        _readers[:] = [_Reader()]
    return _readers[0]


def read_in_process(
    field: str, value: object, task: str, files: Iterable[File], **options: Any
) -> Answer:
    """Run a task with files in the reader process.

    Args:
        field: Name of the field in errors.
        value: Value of the field in errors.
        task: A task of ``process.TASKS``.
        files: Names in the reader, and the path or the bytes of each file.
        options: Further arguments of the task, plain data.

    Raises:
        LavaError: As the task, or if a file needs more time or memory than allowed.
        OSError: If a file cannot be opened.
    """
    request = {'task': task, 'field': field, 'path': str(value), **options}
    with _LOCK:
        reader = _running()
        try:
            answer = reader.ask(request, files)
        except ChildProcessError as error:
            status = reader.exit_status() or 0
            reader.end()
            if status > 0:
                problem = f'The process that reads {field} {value} ended with status {status}'
                raise RefusalError(field, problem, "Run 'lava check install'") from error
            raise LavaError(field, str(value), _limit(status)) from error
        except BaseException:
            # an interrupted exchange cannot be continued
            reader.end()
            raise
    for name, level, message in answer.data.get('log', ()):
        logging.getLogger(str(name)).log(int(level), '%s', message)
    if 'error' in answer.data:
        kind = RefusalError if answer.data.get('is_refusal') else LavaError
        raise kind(*answer.data['error'])
    return answer


def _limit(status: int) -> str:
    """Describe a valid file, given the exit status of the reader that failed."""
    if -status == signal.SIGXCPU:
        return TIME_LIMIT
    if -status in (signal.SIGKILL, signal.SIGABRT, 0):
        return MEMORY_LIMIT
    return f'an undamaged file: its reader ended with signal {-status}'


def _shared_file() -> BinaryIO:
    """Return an empty file in memory."""
    if not hasattr(os, 'memfd_create'):
        from tempfile import TemporaryFile

        return TemporaryFile()
    return os.fdopen(os.memfd_create('lava', os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING), 'w+b')


def _opened(content: Path | bytes) -> BinaryIO:
    if isinstance(content, Path):
        return open_input(content)
    file = _shared_file()
    file.write(content)
    file.flush()
    return file


def _receive(channel: socket.socket, size: int) -> bytes:
    data = b''
    while len(data) < size:
        more = channel.recv(size - len(data))
        if not more:
            raise EOFError
        data += more
    return data


def _read_answer(shared: BinaryIO, place: int, length: int) -> Answer:
    if hasattr(os, 'memfd_create'):
        # if the reader shrank the file, access to its memory would end this process
        fcntl.fcntl(shared, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK)
    size = os.fstat(shared.fileno()).st_size
    if not place + length <= size <= MAX_ANSWER:
        raise EOFError
    memory = mmap.mmap(shared.fileno(), size, MAP_FLAGS)
    data = json.loads(memory[place : place + length])
    arrays = [
        np.ndarray(tuple(shape), validation.choice('type', kind, KINDS), memory, int(offset))
        for kind, shape, offset in data.get('arrays', ())
    ]
    return Answer(data, arrays)
