# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The reader process: reads the files of one request after another, in memory."""

from functools import partial
from importlib import import_module
import json
import logging
from queue import SimpleQueue
import socket
from typing import Any

from lava_ros.errors import LavaError, RefusalError, refusing
from lava_ros.files.reader import confinement
from lava_ros.files.reader.gdal import FOLDER
from lava_ros.files.reader.memory import ANSWER, Content, Output, REQUEST
from lava_ros.processes.received import receive_in_thread

#: Module and function of each task, which takes the contents of files by name, the output, and its
#: options, and returns plain data. A module is loaded with its first task.
TASKS = {
    'raster': ('rasters', 'read'),
    'tiles': ('rasters', 'tile_names'),
    'vectors': ('vectors', 'read'),
    'wkt': ('vectors', 'read_wkt'),
}


class _Log(logging.Handler):
    """Collects the warnings of a task for the process that logs them."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.found: list[tuple[str, int, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.found.append((record.name, record.levelno, _plain(record.getMessage())))


def _plain(text: str) -> str:
    """Return a message without the folder of the files in memory."""
    return text.replace(f'{FOLDER}/', '')


def main(descriptor: str) -> None:
    """Answer requests from a socket until it is closed."""
    # no thread may be without the filter
    confinement.deny_network_and_programs()
    log = _Log()
    logging.getLogger('lava_ros').addHandler(log)
    logging.getLogger('lava_ros').setLevel(logging.WARNING)
    requests: SimpleQueue[tuple[dict[str, Any], list[int]]] = SimpleQueue()
    # it is not closed: a closed one means the end of the parent
    connection = socket.socket(fileno=int(descriptor))
    receive_in_thread(partial(_received, connection), requests)
    while True:
        request, descriptors = requests.get()
        log.found.clear()
        _answer(connection, request, descriptors, log)


def _received(connection: socket.socket) -> tuple[dict[str, Any], list[int]]:
    """Return the next request with the descriptors of its output and its files."""
    head = connection.recv(REQUEST.size, socket.MSG_WAITALL)
    if len(head) < REQUEST.size:
        raise EOFError
    (length,) = REQUEST.unpack(head)
    text = connection.recv(length, socket.MSG_WAITALL)
    if len(text) < length:
        raise EOFError
    request: dict[str, Any] = json.loads(text)
    return request, [_received_file(connection) for _ in ('output', *request['files'])]


def _received_file(connection: socket.socket) -> int:
    _, descriptors, *_ = socket.recv_fds(connection, 1, 1)
    if not descriptors:
        raise EOFError
    return descriptors[0]


def _answer(
    connection: socket.socket, request: dict[str, Any], descriptors: list[int], log: _Log
) -> None:
    output = Output(descriptors[0])
    files = dict(zip(request.pop('files'), map(Content, descriptors[1:]), strict=True))
    module_name, function = TASKS[request.pop('task')]
    module = import_module(f'{__package__}.{module_name}')
    field, path = request['field'], request['path']
    data: dict[str, Any] = {}
    try:
        module.prepare()
        with (
            confinement.limited(sum(len(item.data) for item in files.values())),
            refusing(field, path, 'a file that GDAL can read'),
        ):
            data['result'] = getattr(module, function)(files, output, **request)
    except LavaError as error:
        value = error.value
        is_plain = isinstance(value, str | int | float | None)
        data['error'] = error.field, value if is_plain else repr(value), _plain(error.expected)
        data['is_refusal'] = isinstance(error, RefusalError)
    except MemoryError:
        data['error'] = field, path, confinement.MEMORY_LIMIT
    data |= {'log': log.found, 'arrays': output.arrays}
    place, length = output.write(json.dumps(data).encode())
    output.close()
    for item in files.values():
        item.close()
    connection.sendall(ANSWER.pack(place, length))

