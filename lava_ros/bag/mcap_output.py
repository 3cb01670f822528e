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

"""One MCAP file of a bag while it is being written."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from mcap.writer import CompressionType, LIBRARY_IDENTIFIER, Writer

from lava_ros.bag import metadata as bag_metadata
from lava_ros.bag.metadata import BagMetadata, FileRecord, TopicRecord
from lava_ros.bag.qos import profiles_to_yaml
from lava_ros.bag.schemas import MessageSchema

#: Uncompressed size at which a chunk is closed [bytes]; ``flush`` closes it earlier.
CHUNK_SIZE = 4 * 1024 * 1024


@dataclass
class _Channel:
    """A topic of the file and the id its channel has there."""

    id: int
    topic: TopicRecord


class McapOutput:
    """A file that can be read by itself: definitions, QoS, description, index and counts.

    Attributes:
        record: What metadata.yaml says of the file.
    """

    def __init__(self, path: Path, custom_data: Mapping[str, str]) -> None:
        """Create the file and write what it begins with.

        Args:
            path: The file, which must not exist.
            custom_data: Free text by name that describes the recording.

        Raises:
            OSError: The file cannot be written.
        """
        self.record = FileRecord(path.name)
        self._custom_data = custom_data
        self._channels: dict[str, _Channel] = {}
        self._schema_ids: dict[str, int] = {}
        self._stream = path.open('xb')
        try:
            self._mcap = Writer(
                self._stream,
                chunk_size=CHUNK_SIZE,
                compression=CompressionType.ZSTD,
                enable_data_crcs=True,
            )
            self._mcap.start(profile='ros2', library=f'lava_ros {LIBRARY_IDENTIFIER}')
            self._write_metadata_record()
            self._mcap.flush()
        except OSError:
            self._stream.close()
            raise

    @property
    def size(self) -> int:
        """Bytes written so far, those of the chunk at hand left out."""
        return self._stream.tell()

    def describe(self, custom_data: Mapping[str, str]) -> None:
        """Replace what describes the recording; it is in the file after the next ``flush``."""
        self._custom_data = custom_data
        self._is_described = False

    def write(
        self,
        topic: TopicRecord,
        schema: MessageSchema,
        data: bytes,
        *,
        log_time: int,
        publish_time: int,
    ) -> None:
        """Append a message; the first one of a topic registers its channel.

        Args:
            topic: Its topic, with the number of its messages that came before in the bag.
            schema: Definition of its type.
            data: The message, serialised to CDR.
            log_time: When it is played [ns].
            publish_time: When it was published [ns].

        Raises:
            OSError: The file cannot be written.
        """
        channel = self._channels.get(topic.name) or self._register(topic, schema)
        self._mcap.add_message(
            channel.id,
            log_time=log_time,
            data=data,
            publish_time=publish_time,
            sequence=topic.message_count,
        )
        channel.topic = replace(channel.topic, message_count=channel.topic.message_count + 1)
        record = self.record
        self.record = replace(
            record,
            start_ns=log_time if record.start_ns is None else record.start_ns,
            end_ns=log_time,
            message_count=record.message_count + 1,
        )

    def attach(self, name: str, media_type: str, data: bytes, *, log_time: int) -> None:
        """Put data beside the messages, after those so far; players pass over it.

        Raises:
            OSError: The file cannot be written.
        """
        self._mcap.flush()
        self._mcap.add_attachment(
            create_time=log_time, log_time=log_time, name=name, media_type=media_type, data=data
        )

    def flush(self) -> None:
        """Hand everything written so far to the operating system, as a complete chunk.

        Raises:
            OSError: The file cannot be written.
        """
        self._mcap.flush()
        if not self._is_described:
            self._write_metadata_record()
            self._mcap.flush()

    def finish(self) -> None:
        """Write index and summary and close the file.

        Raises:
            OSError: The file cannot be written; it is closed as it is.
        """
        with self._stream:
            self._mcap.flush()
            self._write_metadata_record()
            self._mcap.finish()

    def _register(self, topic: TopicRecord, schema: MessageSchema) -> _Channel:
        kind = topic.message_type
        if kind not in self._schema_ids:
            self._schema_ids[kind] = self._mcap.register_schema(
                kind, schema.encoding, schema.text.encode()
            )
        channel_id = self._mcap.register_channel(
            topic.name,
            'cdr',
            self._schema_ids[kind],
            {
                'offered_qos_profiles': profiles_to_yaml([topic.qos]),
                'topic_type_hash': schema.type_hash,
            },
        )
        channel = _Channel(channel_id, replace(topic, message_count=0))
        self._channels[topic.name] = channel
        return channel

    def _write_metadata_record(self) -> None:
        topics = tuple(channel.topic for channel in self._channels.values())
        metadata = BagMetadata((self.record,), topics, self._custom_data)
        self._mcap.add_metadata(bag_metadata.RECORD, bag_metadata.to_record(metadata))
        self._is_described = True
