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

"""Writes rosbag2 bags: a directory with an MCAP file and metadata.yaml."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType

from mcap.writer import CompressionType, LIBRARY_IDENTIFIER, Writer

from lava_ros.bag import metadata as bag_metadata
from lava_ros.bag.metadata import BagMetadata, FileRecord, TopicRecord
from lava_ros.bag.qos import profiles_to_yaml, QosProfile
from lava_ros.bag.schemas import message_schema, MessageSchema
from lava_ros.errors import LavaError

#: Uncompressed size at which a chunk is closed [bytes]; ``flush`` closes it earlier.
CHUNK_SIZE = 4 * 1024 * 1024

#: Name of the MCAP metadata record that holds what metadata.yaml says.
METADATA_RECORD = 'rosbag2'

#: Bytes of CDR's encapsulation header, which every serialised message starts with.
_CDR_HEADER_SIZE = 4


@dataclass
class _Channel:
    """A topic being written and the id its channel has in the file."""

    id: int
    topic: TopicRecord


class BagWriter:
    """Records serialised messages into a new bag.

    The file is readable at any time up to the latest ``flush``, also when the process is killed.
    A writer belongs to one thread. After an OSError (a full disk) it can only be closed.
    """

    def __init__(self, directory: str | Path, *, custom_data: Mapping[str, str]) -> None:
        """Create the bag's directory and open its first file.

        Args:
            directory: The bag; its parents are created where they are missing.
            custom_data: Free text by name that describes the recording.

        Raises:
            LavaError: The directory exists or cannot be created, or custom data is not text.
        """
        self._custom_data = _texts(custom_data)
        self.directory = Path(directory).absolute()
        try:
            self.directory.mkdir(parents=True)
        except FileExistsError:
            raise LavaError(
                'bag',
                str(directory),
                'a directory that does not exist yet; choose another name or remove it first',
            ) from None
        except OSError as error:
            raise LavaError(
                'bag', str(directory), f'a directory that can be created ({error})'
            ) from error
        self._channels: dict[str, _Channel] = {}
        self._schema_ids: dict[str, int] = {}
        self._file_record = FileRecord(f'{self.directory.name}_0.mcap')
        self._closed = False
        self._file = (self.directory / self._file_record.path).open('xb')
        self._mcap = Writer(self._file, chunk_size=CHUNK_SIZE, compression=CompressionType.ZSTD)
        self._mcap.start(profile='ros2', library=f'lava_ros {LIBRARY_IDENTIFIER}')
        self._write_metadata_record()
        self._mcap.flush()

    @property
    def message_count(self) -> int:
        """Messages written so far."""
        return self._file_record.message_count

    def set_custom_data(self, custom_data: Mapping[str, str]) -> None:
        """Replace what describes the recording; it is in the file after the next ``flush``.

        Args:
            custom_data: Free text by name, all of it.

        Raises:
            LavaError: It is not text, or the bag is closed.
        """
        self._check_open()
        self._custom_data = _texts(custom_data)
        self._is_described = False

    def write(
        self,
        topic: str,
        message_type: str,
        data: bytes,
        stamp_ns: int,
        *,
        qos: QosProfile,
        schema: MessageSchema | None = None,
    ) -> None:
        """Append a message; the first one of a topic registers its channel.

        Players and readers order by log time, which never decreases here: it is ``stamp_ns``, or
        the latest log time where that is later (a reset or jump of the ROS clock). The publish
        time is always ``stamp_ns``, and the stamps inside ``data`` stay as they are.

        Args:
            topic: Absolute topic name.
            message_type: Type such as ``nav_msgs/msg/OccupancyGrid``.
            data: The message, serialised to CDR.
            stamp_ns: ROS time of the message [ns].
            qos: What the topic's publisher offers; the same for each message of the topic.
            schema: Definition of the type; None looks it up among the installed packages.

        Raises:
            LavaError: An argument is not usable, or the bag is closed.
            OSError: The file cannot be written.
        """
        self._check_open()
        if not isinstance(stamp_ns, int) or not 0 <= stamp_ns < 2**63:
            raise LavaError('stamp_ns', stamp_ns, 'a ROS time in nanoseconds, at least 0')
        if len(data) < _CDR_HEADER_SIZE:
            raise LavaError('data', data, 'a message serialised to CDR')
        channel = self._channels.get(topic) or self._register(topic, message_type, qos, schema)
        if (channel.topic.message_type, channel.topic.qos) != (message_type, qos):
            raise LavaError(
                f'message on {topic}',
                (message_type, qos),
                f'the type and QoS of its first message: {channel.topic.message_type}, '
                f'{channel.topic.qos}',
            )
        record = self._file_record
        log_time = stamp_ns if record.end_ns is None else max(stamp_ns, record.end_ns)
        self._mcap.add_message(
            channel.id,
            log_time=log_time,
            data=data,
            publish_time=stamp_ns,
            sequence=channel.topic.message_count,
        )
        channel.topic = replace(channel.topic, message_count=channel.topic.message_count + 1)
        self._file_record = replace(
            record,
            start_ns=log_time if record.start_ns is None else record.start_ns,
            end_ns=log_time,
            message_count=record.message_count + 1,
        )

    def flush(self) -> None:
        """Hand everything written so far to the operating system, as a complete chunk.

        It survives the end of this process from here on, though not a loss of power.

        Raises:
            LavaError: The bag is closed.
            OSError: The file cannot be written.
        """
        self._check_open()
        self._mcap.flush()
        if not self._is_described:
            self._write_metadata_record()
            self._mcap.flush()

    def close(self) -> None:
        """Finish the file and write metadata.yaml; does nothing the second time.

        Raises:
            OSError: The file cannot be written; it is closed as it is.
        """
        if self._closed:
            return
        self._closed = True
        with self._file:
            self._mcap.flush()
            self._write_metadata_record()
            self._mcap.finish()
        bag_metadata.write_metadata(self.directory, self._metadata())

    def __enter__(self) -> 'BagWriter':
        """Return the writer."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the bag, also after an error: what was written is worth keeping."""
        self.close()

    def _check_open(self) -> None:
        if self._closed:
            raise LavaError('bag', str(self.directory), 'an open bag; this one is closed')

    def _register(
        self, topic: str, message_type: str, qos: QosProfile, schema: MessageSchema | None
    ) -> _Channel:
        if not topic.startswith('/') or topic.endswith('/'):
            raise LavaError('topic', topic, 'an absolute topic name such as /lava/height')
        schema = schema or message_schema(message_type)
        if message_type not in self._schema_ids:
            self._schema_ids[message_type] = self._mcap.register_schema(
                message_type, schema.encoding, schema.text.encode()
            )
        record = TopicRecord(topic, message_type, qos, schema.type_hash, 0)
        channel_id = self._mcap.register_channel(
            topic,
            'cdr',
            self._schema_ids[message_type],
            {
                'offered_qos_profiles': profiles_to_yaml([qos]),
                'topic_type_hash': schema.type_hash,
            },
        )
        channel = self._channels[topic] = _Channel(channel_id, record)
        return channel

    def _metadata(self) -> BagMetadata:
        topics = tuple(channel.topic for channel in self._channels.values())
        return BagMetadata((self._file_record,), topics, self._custom_data)

    def _write_metadata_record(self) -> None:
        text = bag_metadata.serialize(self._metadata())
        self._mcap.add_metadata(METADATA_RECORD, {'serialized_metadata': text})
        self._is_described = True


def _texts(custom_data: Mapping[str, str]) -> dict[str, str]:
    for key, value in custom_data.items():
        if not isinstance(key, str) or not isinstance(value, str):
            raise LavaError(f'custom_data[{key!r}]', value, 'text under a name that is text')
    return dict(custom_data)
