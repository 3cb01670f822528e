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

"""A bag while it is written: its directory, whatever its name leads to, and one MCAP file."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
import os
from pathlib import Path
import secrets
from typing import BinaryIO

from mcap.writer import CompressionType, LIBRARY_IDENTIFIER, Writer

from lava_ros.bag import metadata as bag_metadata
from lava_ros.bag.metadata import BagMetadata, FileRecord, TopicRecord
from lava_ros.bag.qos import profiles_to_yaml
from lava_ros.bag.schemas import MessageSchema

#: Uncompressed size at which a chunk is closed [bytes]; ``flush`` closes it earlier.
CHUNK_SIZE = 4 * 1024 * 1024


class Directory:
    """A new directory that is kept open: files go into it and not where a link leads.

    All methods raise OSError where the system refuses.
    """

    def __init__(self, path: Path) -> None:
        """Make it, and its parents where they are missing."""
        self._path = path
        path.mkdir(parents=True)
        self._number = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)

    def create(self, name: str) -> BinaryIO:
        """Open a new file in it for writing."""
        return open(name, 'xb', opener=self._open)

    def put(self, name: str, text: str) -> None:
        """Write a file: either the whole of it is there afterwards or none."""
        # nothing that somebody has put there is written to
        partial = f'.{name}.{secrets.token_hex(4)}.partial'
        try:
            with open(partial, 'x', encoding='utf-8', opener=self._open) as stream:
                stream.write(text)
            os.replace(partial, name, src_dir_fd=self._number, dst_dir_fd=self._number)
        except OSError:
            with suppress(FileNotFoundError):
                os.unlink(partial, dir_fd=self._number)
            raise

    def check(self, file: BinaryIO) -> None:
        """Check that the directory and a file of it are still found by their names.

        If one was removed, moved or replaced, what is written next is lost to readers.
        """
        for path, opened in ((self._path, self._number), (self._path / file.name, file.fileno())):
            is_same = False
            with suppress(OSError):
                there = os.stat(path, follow_symlinks=False)
                is_same = os.path.samestat(there, os.fstat(opened))
            if not is_same:
                raise OSError(f'{path} was removed, moved or replaced')

    def close(self) -> None:
        """Close the directory's descriptor."""
        os.close(self._number)

    def _open(self, name: str, flags: int) -> int:
        return os.open(name, flags | os.O_NOFOLLOW, 0o666, dir_fd=self._number)


class McapOutput:
    """A file that can be read by itself: definitions, QoS, description, index and counts.

    Whatever writes raises OSError where the file cannot be written.

    Attributes:
        record: What metadata.yaml says of the file.
    """

    def __init__(self, directory: Directory, name: str, custom_data: Mapping[str, str]) -> None:
        """Create the file and write its header and metadata."""
        self.record = FileRecord(name)
        self._custom_data = custom_data
        # the channel id of each topic, and its messages in this file
        self._channels: dict[str, tuple[int, TopicRecord]] = {}
        self._schema_ids: dict[str, int] = {}
        self._directory = directory
        self._stream = directory.create(name)
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
        """Append a message in CDR; the first message of a topic registers its channel.

        ``topic.message_count`` is the number of messages of the topic already in the bag.
        ``log_time`` [ns] is the time at which the message is played back, ``publish_time`` [ns]
        that at which it was published.
        """
        channel_id, counted = self._channels.get(topic.name) or self._register(topic, schema)
        self._mcap.add_message(channel_id, log_time, data, publish_time, topic.message_count)
        counted.message_count += 1
        if self.record.start_ns is None:
            self.record.start_ns = log_time
        self.record.end_ns = log_time
        self.record.message_count += 1

    def attach(self, name: str, media_type: str, data: bytes, *, log_time: int) -> None:
        """Put data beside the messages, after those so far; players pass over it."""
        self._mcap.flush()
        self._mcap.add_attachment(log_time, log_time, name, media_type, data)

    def flush(self) -> None:
        """Hand everything to the operating system; OSError also for a file that was removed."""
        self._mcap.flush()
        if not self._is_described:
            self._write_metadata_record()
            self._mcap.flush()
        self._directory.check(self._stream)

    def finish(self) -> None:
        """Write the index and close the file, as it is after an error; OSError as in ``flush``."""
        with self._stream:
            self._mcap.flush()
            self._write_metadata_record()
            self._mcap.finish()
            self._directory.check(self._stream)

    def _register(self, topic: TopicRecord, schema: MessageSchema) -> tuple[int, TopicRecord]:
        kind = topic.message_type
        if kind not in self._schema_ids:
            text = schema.text.encode()
            self._schema_ids[kind] = self._mcap.register_schema(kind, schema.encoding, text)
        known = {
            'offered_qos_profiles': profiles_to_yaml([topic.qos]),
            'topic_type_hash': schema.type_hash,
        }
        number = self._mcap.register_channel(topic.name, 'cdr', self._schema_ids[kind], known)
        self._channels[topic.name] = number, replace(topic, message_count=0)
        return self._channels[topic.name]

    def _write_metadata_record(self) -> None:
        topics = tuple(topic for _, topic in self._channels.values())
        metadata = BagMetadata((self.record,), topics, self._custom_data)
        self._mcap.add_metadata(bag_metadata.RECORD, bag_metadata.to_record(metadata))
        self._is_described = True
