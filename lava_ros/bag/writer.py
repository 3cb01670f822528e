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

"""Writes rosbag2 bags: a directory with one MCAP file or several, and metadata.yaml."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lava_ros import validation
from lava_ros.bag import metadata as bag_metadata
from lava_ros.bag.mcap_output import Directory, McapOutput
from lava_ros.bag.metadata import BagMetadata, FileRecord, TopicRecord
from lava_ros.bag.qos import QosProfile
from lava_ros.bag.schemas import message_schema, MessageSchema
from lava_ros.errors import LavaError

#: Bytes of CDR's encapsulation header, which every serialised message starts with.
_CDR_HEADER_SIZE = 4


@dataclass
class _Topic:
    record: TopicRecord
    schema: MessageSchema
    # its newest message and that one's stamp, where the next file repeats it
    latest: tuple[bytes, int] | None = None


class BagWriter:
    """Records serialised messages into a new bag.

    The newest file is readable at any time up to the latest ``flush``, also when the process is
    killed. A writer belongs to one thread. After an OSError (a full disk) it can only be closed.

    With a limit on size or duration the bag goes on in a new file whenever a file has reached it:
    ``<bag>_0.mcap``, ``<bag>_1.mcap``, ... Each file can be read by itself: it starts with the
    newest message of every latched topic, logged at the file's start with the publish time it had.
    Messages with the same stamp, those of one frame, are never divided between files. A file
    whose repeated messages take up more than half of the limit goes on until what is new takes up
    as much.
    """

    def __init__(
        self,
        directory: str | Path,
        *,
        custom_data: Mapping[str, str],
        max_size: int = 0,
        max_duration: float = 0.0,
    ) -> None:
        """Create the bag's directory, with its parents, and open its first file.

        Args:
            directory: The bag.
            custom_data: Free text by name that describes the recording.
            max_size: Size from which on a file is not continued [bytes]; 0: no limit.
            max_duration: Log time after which a file is not continued [s]; 0: no limit.

        Raises:
            LavaError: The directory exists or cannot be created, custom data is not text, or a
                limit is not usable.
            OSError: The first file cannot be written.
        """
        self._custom_data = _texts(custom_data)
        self._max_size = validation.number('max_size', max_size, at_least=0.0, unit='bytes')
        duration = validation.number('max_duration', max_duration, at_least=0.0, unit='s')
        self._max_duration_ns = round(duration * 1e9)
        self.directory = Path(directory).absolute()
        try:
            self._directory = Directory(self.directory)
        except FileExistsError:
            right = 'a directory that does not exist yet; choose another name or remove it first'
            raise LavaError('bag', str(directory), right) from None
        except OSError as error:
            right = f'a directory that can be created ({error})'
            raise LavaError('bag', str(directory), right) from error
        self._topics: dict[str, _Topic] = {}
        self._finished: list[FileRecord] = []
        self._last_stamp_ns: int | None = None
        self._end_ns = self._repeated_size = self._finished_size = 0
        self._closed = False
        self._file: McapOutput | None = None
        try:
            self._file = self._open_file()
        except OSError:
            self._directory.close()
            raise

    @property
    def message_count(self) -> int:
        """Messages written so far, repeated ones included."""
        return sum(item.message_count for item in self._records())

    @property
    def size(self) -> int:
        """Bytes written so far, those of the chunk at hand left out."""
        return self._finished_size + (self._file.size if self._file is not None else 0)

    @property
    def file_count(self) -> int:
        """Files there are."""
        return len(self._records())

    def set_custom_data(self, custom_data: Mapping[str, str]) -> None:
        """Replace the description of the recording; the next ``flush`` writes it to the file.

        Raises:
            LavaError: A key or a value is not text, or the bag is closed.
        """
        file = self._open()
        self._custom_data = _texts(custom_data)
        file.describe(self._custom_data)

    def write(
        self,
        topic: str,
        message_type: str,
        data: bytes,
        stamp_ns: int,
        *,
        qos: QosProfile,
        schema: MessageSchema | None = None,
        log_time_ns: int | None = None,
    ) -> None:
        """Append a message, in a new file where the one at hand has reached a limit.

        Players and readers order by log time, which never decreases here: where a time lies
        before the latest one (a reset or jump of the ROS clock) it is that one. The publish time
        is always ``stamp_ns``, and the stamps inside ``data`` stay as they are.

        Args:
            topic: Absolute topic name.
            message_type: Type such as ``nav_msgs/msg/OccupancyGrid``.
            data: The message, serialised to CDR.
            stamp_ns: ROS time of the message [ns].
            qos: What the topic's publisher offers; the same for each message of the topic.
            schema: Definition of the type; None looks it up among the installed packages.
            log_time_ns: Log time of a message that is copied [ns]; None: ``stamp_ns``.

        Raises:
            LavaError: An argument is not usable, or the bag is closed.
            OSError: The file cannot be written.
        """
        file = self._open()
        if not isinstance(stamp_ns, int) or not 0 <= stamp_ns < 2**63:
            raise LavaError('stamp_ns', stamp_ns, 'a ROS time in nanoseconds, at least 0')
        if len(data) < _CDR_HEADER_SIZE:
            raise LavaError('data', data, 'a message serialised to CDR')
        item = self._topics.get(topic) or _topic(topic, message_type, qos, schema)
        first = (item.record.message_type, item.record.qos)
        if first != (message_type, qos):
            right = f'the type and QoS of its first message: {first[0]}, {first[1]}'
            raise LavaError(f'message on {topic}', (message_type, qos), right)
        log_time = max(stamp_ns if log_time_ns is None else log_time_ns, self._end_ns)
        if stamp_ns != self._last_stamp_ns and self._is_full(file, log_time):
            self.begin_file()
            self._repeat_latched(log_time, but=item)
        self._last_stamp_ns, self._end_ns = stamp_ns, log_time
        self._topics[topic] = item
        self._add(item, data, log_time, stamp_ns)
        if qos.is_latched and (self._max_size or self._max_duration_ns):
            item.latest = (data, stamp_ns)

    def attach(self, name: str, media_type: str, data: bytes, stamp_ns: int) -> None:
        """Put data beside the messages; players pass over it, ``bag.checkpoints`` finds it.

        Names need not differ. The data are logged at ``stamp_ns`` [ns], or at the latest log time
        where that is later.

        Raises:
            LavaError: The bag is closed.
            OSError: The file cannot be written.
        """
        self._open().attach(name, media_type, data, log_time=max(stamp_ns, self._end_ns))

    def begin_file(self) -> None:
        """Finish the file at hand and go on in a new one; nothing is repeated in it.

        Raises:
            LavaError: The bag is closed.
            OSError: One of them cannot be written.
        """
        file, self._file = self._open(), None
        self._finished.append(file.record)
        self._finished_size += file.size
        file.finish()
        self._file = self._open_file()
        self._repeated_size = 0

    def flush(self) -> None:
        """Hand everything written so far to the operating system, as a complete chunk.

        It survives the end of this process from here on, though not a loss of power.

        Raises:
            LavaError: The bag is closed.
            OSError: The file cannot be written, or is not in the bag any more.
        """
        self._open().flush()

    def close(self) -> None:
        """Finish the file and write metadata.yaml; does nothing the second time.

        Raises:
            OSError: The file cannot be written; it is closed as it is.
        """
        if self._closed:
            return
        self._closed = True
        try:
            if self._file is not None:
                self._file.finish()
            topics = tuple(item.record for item in self._topics.values())
            metadata = BagMetadata(tuple(self._records()), topics, self._custom_data)
            self._directory.put(bag_metadata.FILE_NAME, bag_metadata.to_text(metadata))
        finally:
            self._directory.close()

    def __enter__(self) -> 'BagWriter':
        """Return the writer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the bag, also after an error: what was written is worth keeping."""
        self.close()

    def _open(self) -> McapOutput:
        if self._closed or self._file is None:
            raise LavaError('bag', str(self.directory), 'an open bag; this one is closed')
        return self._file

    def _open_file(self) -> McapOutput:
        name = f'{self.directory.name}_{len(self._finished)}.mcap'
        return McapOutput(self._directory, name, self._custom_data)

    def _records(self) -> list[FileRecord]:
        return [*self._finished, *([self._file.record] if self._file is not None else [])]

    def _is_full(self, file: McapOutput, log_time: int) -> bool:
        start_ns = file.record.start_ns
        if start_ns is None:
            return False
        if self._max_duration_ns and log_time - start_ns >= self._max_duration_ns:
            return True
        least = max(self._max_size, 2 * self._repeated_size)
        return bool(self._max_size) and file.size >= least

    def _repeat_latched(self, log_time: int, *, but: _Topic) -> None:
        for item in self._topics.values():
            if item.latest is not None and item is not but:
                self._add(item, item.latest[0], log_time, item.latest[1])
        file = self._open()
        file.flush()
        self._repeated_size = file.size

    def _add(self, item: _Topic, data: bytes, log_time: int, publish_time: int) -> None:
        self._open().write(
            item.record, item.schema, data, log_time=log_time, publish_time=publish_time
        )
        item.record.message_count += 1


def _topic(
    name: str, message_type: str, qos: QosProfile, schema: MessageSchema | None
) -> _Topic:
    if not name.startswith('/') or name.endswith('/'):
        raise LavaError('topic', name, 'an absolute topic name such as /lava/height')
    schema = schema or message_schema(message_type)
    return _Topic(TopicRecord(name, message_type, qos, schema.type_hash, 0), schema)


def _texts(custom_data: Mapping[str, str]) -> dict[str, str]:
    for key, value in custom_data.items():
        if not isinstance(key, str) or not isinstance(value, str):
            raise LavaError(f'custom_data[{key!r}]', value, 'text, and text as its key')
    return dict(custom_data)
