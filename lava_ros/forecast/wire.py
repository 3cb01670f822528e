# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Messages between the node and the process of its forecasts: a header in JSON, and a body."""

from collections.abc import Mapping
import json
import struct
from typing import Any, IO

import numpy as np

#: Largest body that is read [bytes].
MAX_BODY = 1 << 33

_SIZES = struct.Struct('>IQ')


def write(stream: IO[bytes], header: Mapping[str, Any], body: bytes = b'') -> None:
    """Write a message.

    Args:
        stream: A pipe.
        header: Plain data.
        body: Whatever goes with it.

    Raises:
        OSError: The other end is closed.
    """
    text = json.dumps(header).encode()
    stream.write(_SIZES.pack(len(text), len(body)) + text)
    stream.write(body)
    stream.flush()


def read(stream: IO[bytes]) -> tuple[dict[str, Any], bytes] | None:
    """Read a message.

    Returns:
        Header and body; None at the end, also in the middle of a message.

    Raises:
        ValueError: What was read is no message.
    """
    sizes = stream.read(_SIZES.size)
    if len(sizes) < _SIZES.size:
        return None
    length, size = _SIZES.unpack(sizes)
    if size > MAX_BODY:
        raise ValueError(f'a body of {size} bytes, expected at most {MAX_BODY}')
    text, body = stream.read(length), stream.read(size)
    if len(text) < length or len(body) < size:
        return None
    return json.loads(text), body


def packed(*arrays: np.ndarray) -> bytes:
    """The bytes of float32 arrays of one shape, one after the other."""
    return b''.join(np.asarray(array, '<f4').tobytes() for array in arrays)


def packed_masks(*masks: np.ndarray) -> bytes:
    """The bytes of masks of one shape, a bit for each cell."""
    return np.packbits(np.stack(masks)).tobytes()


def unpacked_masks(body: bytes, shape: tuple[int, int], count: int = 2) -> list[np.ndarray]:
    """The masks of a shape that bytes hold.

    Raises:
        ValueError: They do not hold such masks.
    """
    bits = np.unpackbits(np.frombuffer(body, np.uint8), count=count * shape[0] * shape[1])
    return list(bits.astype(bool).reshape(count, *shape))


def unpacked(body: bytes, shape: tuple[int, int]) -> list[np.ndarray]:
    """The float32 arrays of a shape that bytes hold.

    Raises:
        ValueError: They do not hold such arrays.
    """
    return list(np.frombuffer(body, '<f4').astype(np.float32).reshape(-1, *shape))
