# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Decoding of messages to objects and arrays, and the simulated times of a bag."""

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise
import math
import re
import struct
from typing import Any, NamedTuple

import numpy as np

from lava_ros.bag.reader import BagMessage, BagReader
from lava_ros.errors import LavaError, refusing

# A fixed-length array takes memory for the length in its definition, whatever a message contains.
_FIXED = re.compile(rb'^\s*[^#\s]+\[\d', re.MULTILINE)

# An array of int8: the decoder makes a Python integer of each item, but bytes of uint8.
_INT8 = re.compile(r'\bint8\[\]')

#: Maximum plausible simulated time in a bag [s]: 30,000 years.
MAX_TIME = 1e12


class Decoder:
    """Decodes the messages of one bag to objects with the fields of their type."""

    def __init__(self, bag: BagReader) -> None:
        """Initialize with the definitions in a bag."""
        from mcap.records import Schema
        from mcap_ros2.decoder import DecoderFactory

        self._factory = DecoderFactory()
        self._schemas = {
            name: Schema(
                number, _INT8.sub('uint8[]', topic.schema.text).encode(), 'ros2msg',
                topic.message_type,
            )
            for number, (name, topic) in enumerate(bag.topics.items(), start=1)
        }

    def decode(self, message: BagMessage, take: Callable[[Any], Any] = lambda item: item) -> Any:
        """Decode a message and return ``take(message)``; ``take`` returns the message by default.

        Raises:
            LavaError: If the data do not match their definition, or ``take`` fails.
        """
        schema = self._schemas[message.topic]
        if _FIXED.search(schema.data):
            expected = 'a definition without arrays of fixed length'
            raise LavaError(f'definition of {schema.name}', schema.data.decode(), expected)
        # a library parses the untrusted definition, and its fields can be of any type
        size = f'{len(message.data)} bytes'
        with refusing(f'message on {message.topic}', size, f'a {schema.name}'):
            decode = self._factory.decoder_for('cdr', schema)
            assert decode is not None
            return take(decode(message.data))


class Grid(NamedTuple):
    """A nav_msgs/OccupancyGrid: side of a cell [m], position of the corner [m], int8 cells."""

    resolution: float
    origin: tuple[float, float]
    cells: np.ndarray


def read_grid(decoder: Decoder, message: BagMessage) -> Grid:
    """Read an occupancy grid.

    Raises:
        LavaError: If the message is truncated or is not an occupancy grid.
    """

    def read(grid: Any) -> Grid:
        info, place = grid.info, grid.info.origin.position
        cells = np.frombuffer(grid.data, np.int8).reshape(info.height, info.width)
        return Grid(info.resolution, (place.x, place.y), cells)

    result: Grid = decoder.decode(message, read)
    return result


#: numpy type of each sensor_msgs/PointField datatype: INT8 is 1, FLOAT64 is 8.
POINT_TYPES = dict(enumerate(('i1', 'u1', 'i2', 'u2', 'i4', 'u4', 'f4', 'f8'), start=1))

#: numpy type of each image encoding that terrain may have.
IMAGE_TYPES = {'32FC1': 'f4', '16UC1': 'u2'}


def image_array(image: Any, name: str) -> np.ndarray:
    """Return a view of an image's pixels, shape [height, width], in the type of its encoding.

    Errors refer to the message as ``name``.

    Raises:
        LavaError: If the encoding is not in ``IMAGE_TYPES``, or size, step and data disagree.
    """
    if image.encoding not in IMAGE_TYPES:
        raise LavaError(f'{name}.encoding', image.encoding, f'one of {", ".join(IMAGE_TYPES)}')
    dtype = np.dtype(('>' if image.is_bigendian else '<') + IMAGE_TYPES[image.encoding])
    rows, columns = image.height, image.width
    if rows == 0 or columns == 0:
        raise LavaError(f'{name}.size', f'{columns} x {rows}', 'at least one pixel')
    least = columns * dtype.itemsize
    expected = f'at least {least} bytes for {columns} pixels of {image.encoding}'
    _check_rows(image, name, 'step', least, expected)
    strides = (image.step, dtype.itemsize)
    pixels: np.ndarray = np.ndarray((rows, columns), dtype, image.data, strides=strides)
    return pixels


def cloud_columns(
    cloud: Any, name: str, required: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, np.ndarray]:
    """Read fields of a point cloud, organised or not, in any order, type and padding.

    Errors refer to the message as ``name``.

    Returns:
        Values by field name, float64, shape [height x width], of the required fields and of the
        optional ones present. A cloud without points has empty arrays of the required fields.

    Raises:
        LavaError: If a field is missing or malformed, or size, steps and data disagree.
    """
    rows, columns = cloud.height, cloud.width
    if rows == 0 or columns == 0:
        if size := len(cloud.data):
            expected = f'none for {columns} x {rows} points'
            raise LavaError(f'{name}.data', f'{size} bytes', expected)
        return {key: np.empty(0) for key in required}
    by_name = {item.name: item for item in cloud.fields}
    if missing := [key for key in required if key not in by_name]:
        expected = f'{", ".join(required)}; missing: {", ".join(missing)}'
        raise LavaError(f'{name}.fields', list(by_name), expected)
    least = columns * cloud.point_step
    _check_rows(cloud, name, 'row_step', least, f'at least width x point_step = {least} bytes')
    result = {}
    for key in [*required, *(key for key in optional if key in by_name)]:
        item, where = by_name[key], f'{name}.fields.{key}'
        if item.datatype not in POINT_TYPES or item.count != 1:
            found = f'datatype {item.datatype}, count {item.count}'
            raise LavaError(where, found, 'a datatype from 1 (INT8) to 8 (FLOAT64), count 1')
        dtype = np.dtype(('>' if cloud.is_bigendian else '<') + POINT_TYPES[item.datatype])
        if item.offset + dtype.itemsize > cloud.point_step:
            expected = f'a field inside a point of {cloud.point_step} bytes (point_step)'
            raise LavaError(f'{where}.offset', item.offset, expected)
        steps = (cloud.row_step, cloud.point_step)
        view = np.ndarray((rows, columns), dtype, cloud.data, item.offset, steps)
        # The data may have any bit pattern, including a signalling NaN.
        with np.errstate(invalid='ignore'):
            result[key] = view.astype(np.float64).ravel()
    return result


def _check_rows(message: Any, name: str, field: str, least: int, expected: str) -> None:
    """Check that a row has at least ``least`` bytes, and that the data are complete."""
    step = getattr(message, field)
    if step < least:
        raise LavaError(f'{name}.{field}', step, expected)
    if len(message.data) != step * message.height:
        expected = f'{field} x height = {step * message.height} bytes'
        raise LavaError(f'{name}.data', f'{len(message.data)} bytes', expected)


DIAGNOSTICS = '/diagnostics'

#: Minimum jump of a clock that a recorder continues over [ns].
MIN_JUMP_NS = 10**9


@dataclass(frozen=True)
class Moment:
    """The diagnostics of one frame: ROS time [ns], simulated time [s], and texts by name.

    In a timeline, ROS times continue where the clock jumped (``Timeline.ros_time``). An example of
    a name in ``values`` is ``volume_emitted_m3``. ``node`` is the full name of the node
    of the simulation, empty if it is unknown.
    """

    stamp_ns: int
    time: float
    values: Mapping[str, str]
    node: str = ''

    def number(self, name: str) -> float:
        """Return a value as a number, NaN if it is missing or not a number."""
        try:
            return float(self.values.get(name, 'nan'))
        except ValueError:
            return float('nan')


def stamp_of(message: BagMessage) -> int:
    """Return the stamp of a message that begins with a header or a time [ns].

    A recorder may run on another clock than the node, so that its times differ from the stamps. A
    message without a stamp has the time of its publication.
    """
    order = '<' if message.data[1:2] == b'\1' else '>'
    try:
        seconds, nanoseconds = struct.unpack_from(f'{order}iI', message.data, 4)
    except struct.error:
        # a truncated message is refused when it is decoded
        seconds = nanoseconds = 0
    return seconds * 10**9 + nanoseconds or message.publish_ns


class Timeline:
    """The diagnostics of a simulation over time, which relate simulated times to stamps.

    Attributes:
        moments: The newest diagnostics of each frame, in the order of stamps.
        last_run: Moments since simulated time last went back.
        nodes: Full names of the nodes whose simulations the diagnostics describe, in order.
    """

    def __init__(
        self, bag: BagReader, decoder: Decoder, topic: str = DIAGNOSTICS, *, is_own: bool = False
    ) -> None:
        """Read the diagnostics of a bag on a topic, if there are any.

        ``is_own`` is True if the node recorded the bag: publish times then come from the same
        clock as the stamps. Other recorders may use another clock.
        """
        found = []
        # differences between log times and the clock [ns], and the log times at which they begin
        self._shifts, self._shift_times = [0], [0]
        for message in bag.messages([topic]):
            shift = message.stamp_ns - message.publish_ns if is_own else 0
            if abs(shift - self._shifts[-1]) >= MIN_JUMP_NS:
                self._shifts.append(shift)
                self._shift_times.append(message.stamp_ns)
            moments = decoder.decode(message, _moments)
            found += [(moment, message.stamp_ns) for moment in moments]
        self._arrange([
            (replace(moment, stamp_ns=self.ros_time(moment.stamp_ns, log_time)), log_time)
            for moment, log_time in found
        ])

    def ros_time(self, stamp_ns: int, log_time_ns: int) -> int:
        """Return the stamp of a message [ns], continued where the clock of its node jumped.

        A looping clock repeats its stamps; log times do not go back. A message after a jump may
        have a stamp from before the jump.
        """
        index = bisect_right(self._shift_times, log_time_ns) - 1
        near = self._shifts[max(index - 1, 0) : index + 2]
        times = [stamp_ns + shift for shift in near if stamp_ns + shift <= log_time_ns]
        return max(times, default=stamp_ns + self._shifts[index])

    def of(self, node: str) -> 'Timeline':
        """Return the timeline of one of the nodes."""
        result = copy(self)
        result._arrange([item for item in self._found if item[0].node == node])
        return result

    def _arrange(self, found: list[tuple[Moment, int]]) -> None:
        """Sort moments, each with the log time of its message [ns]."""
        self._found = found
        newest = {moment.stamp_ns: (moment, log_time) for moment, log_time in found}
        ordered = [newest[stamp] for stamp in sorted(newest)]
        self.moments = tuple(moment for moment, _ in ordered)
        self._log_times = [log_time for _, log_time in ordered]
        self.nodes = sorted({moment.node for moment, _ in found})
        pairs = enumerate(pairwise(self.moments), start=1)
        starts = [index for index, (before, after) in pairs if after.time < before.time]
        self.last_run = self.moments[max(starts, default=0) :]
        self._times = np.array([item.time for item in self.moments], float)

    def log_time_at(self, time: float | None) -> int | None:
        """Return the log time of the diagnostics [ns] of the newest frame up to a simulated time.

        ``time`` [s] is None for the newest of all frames; None is returned without any.
        """
        upto = np.flatnonzero(self._times <= (math.inf if time is None else time))
        return self._log_times[upto[-1]] if upto.size else None

    def time_at(self, stamp_ns: int) -> float | None:
        """Return the simulated time at a stamp [s], None if it is unknown."""
        moments = self.moments
        if not moments or not moments[0].stamp_ns <= stamp_ns <= moments[-1].stamp_ns:
            return None
        index = bisect_right(moments, stamp_ns, key=lambda item: item.stamp_ns) - 1
        if index == len(moments) - 1:
            return moments[-1].time
        # integers: a float64 cannot represent nanoseconds since 1970 exactly
        start, end = moments[index : index + 2]
        part = (stamp_ns - start.stamp_ns) / (end.stamp_ns - start.stamp_ns)
        return start.time + part * (end.time - start.time)

    @property
    def last_time(self) -> float:
        """The largest simulated time [s]; infinity without any."""
        return float(self._times.max()) if self._times.size else math.inf

    @property
    def span(self) -> str:
        """Range of simulated times of the last run as a text for errors."""
        if not self.last_run:
            return 'absent: the bag does not contain simulated times'
        return f'{self.last_run[0].time:.10g} to {self.last_run[-1].time:.10g} s'


def newest_moments(bag: BagReader, decoder: Decoder, topic: str = DIAGNOSTICS) -> list[Moment]:
    """Return the moments of the newest message of diagnostics in a bag."""
    for message in bag.newest([topic], (bag.end_ns or 0) + 1):
        found: list[Moment] = decoder.decode(message, _moments)
        return found
    return []


def _moments(message: Any) -> list[Moment]:
    return [item for item in map(moment_of, message.status) if item is not None]


def places_in(message: Any) -> dict[str, tuple[float, float]]:
    """Read the map positions [m] of the places in a message of arrivals at places, by name."""
    result = {}
    for status in message.status:
        values = {item.key: item.value for item in status.values}
        try:
            x, y = float(values['x_m']), float(values['y_m'])
        except (KeyError, ValueError):
            # recorded before positions were published
            continue
        if math.isfinite(x) and math.isfinite(y):
            result[str(status.name)] = (x, y)
    return result


def moment_of(status: Any) -> Moment | None:
    """Read the moment of the newest frame from a simulation's status; None for other statuses."""
    values = {item.key: item.value for item in status.values}
    try:
        stamp, time = int(values['frame_stamp_ns']), float(values['simulated_time_s'])
    except (KeyError, ValueError):
        # not the status of a simulation
        return None
    is_usable = abs(time) <= MAX_TIME and 0 <= stamp < 2**63
    return Moment(stamp, time, values, node_of(status)) if is_usable else None


def node_of(status: Any) -> str:
    """Return the full name of the node that a status names before a colon, empty without one."""
    node, colon, _ = str(status.name).partition(':')
    return f'/{node.strip("/")}' if colon else ''
