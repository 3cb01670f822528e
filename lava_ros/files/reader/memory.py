# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Memory that the reader process shares with its client: files and answers."""

import ctypes
import math
import mmap
import os
import struct
from typing import Any

from lava_ros.files.reader.confinement import opening

#: Length of a request; position and length of the JSON in an answer.
REQUEST, ANSWER = struct.Struct('<I'), struct.Struct('<QQ')

#: Flags of shared memory: all pages at once, if the system supports it.
MAP_FLAGS = mmap.MAP_SHARED | getattr(mmap, 'MAP_POPULATE', 0)

#: Flags of a file in memory. GDAL needs its address, which Python states only for a writable
#: mapping; changes of a private one do not reach the file.
_FILE_FLAGS = mmap.MAP_PRIVATE | getattr(mmap, 'MAP_NORESERVE', 0)


class Content:
    """A file that the process received.

    Attributes:
        descriptor: Its descriptor.
        data: Its bytes, which are read when they are used.
        memory: Their memory for functions in C.
    """

    def __init__(self, descriptor: int) -> None:
        """Map an open file."""
        self.descriptor = descriptor
        size = os.fstat(descriptor).st_size
        # an empty file cannot be mapped
        mapped = mmap.mmap(descriptor, size, _FILE_FLAGS) if size else bytearray()
        self.data = memoryview(mapped)
        self.memory = (ctypes.c_char * size).from_buffer(mapped)

    def close(self) -> None:
        """Close the file; its bytes remain."""
        os.close(self.descriptor)


class Output:
    """A file in memory with arrays and a text.

    Attributes:
        arrays: Type, shape and place of each array.
    """

    def __init__(self, descriptor: int) -> None:
        """Write into an open, empty file."""
        self._file = descriptor
        self._size = 0
        self.arrays: list[tuple[str, tuple[int, ...], int]] = []

    def array(self, kind: str, itemsize: int, shape: tuple[int, ...]) -> ctypes.Array[Any]:
        """Add an array, and return its memory to be filled.

        Args:
            kind: Name of the type in NumPy.
            itemsize: Size of an element [bytes].
            shape: Length of each dimension.
        """
        memory, place = self._more(math.prod(shape) * itemsize)
        self.arrays.append((kind, shape, place))
        return (ctypes.c_char * len(memory)).from_buffer(memory)

    def write(self, text: bytes) -> tuple[int, int]:
        """Add a text, and return its position and length."""
        place = self._size
        os.lseek(self._file, place, os.SEEK_SET)
        written = 0
        while written < len(text):
            written += os.write(self._file, memoryview(text)[written:])
        return place, len(text)

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)

    def _more(self, size: int) -> tuple[mmap.mmap, int]:
        place = self._size
        pages = -(-max(size, 1) // mmap.PAGESIZE)
        self._size += pages * mmap.PAGESIZE
        try:
            os.ftruncate(self._file, self._size)
            with opening():
                memory = mmap.mmap(self._file, pages * mmap.PAGESIZE, MAP_FLAGS, offset=place)
        except OSError as error:
            raise MemoryError from error
        return memory, place
