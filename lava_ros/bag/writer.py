# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Writing of rosbag2 bags: a directory with one or more MCAP files and metadata.yaml."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
import os
from pathlib import Path
import secrets
from typing import BinaryIO

from mcap.writer import CompressionType, LIBRARY_IDENTIFIER, Writer

from lava_ros import validation
from lava_ros.bag import metadata as bag_metadata
from lava_ros.bag.metadata import FileRecord, Topic
from lava_ros.bag.qos import profiles_to_yaml, QosProfile
from lava_ros.bag.schemas import message_schema, MessageSchema
from lava_ros.errors import LavaError, refusing

#: Uncompressed size at which a chunk is closed [bytes]; ``flush`` also closes it.
CHUNK_SIZE = 4 * 1024 * 1024

#: Size of CDR's encapsulation header, with which every serialised message starts [bytes].
_CDR_HEADER_SIZE = 4


class _Directory:
    """A new directory that is kept open, so that links cannot redirect its files.

    All methods raise OSError if the system call fails.
    """

    def __init__(self, path: Path) -> None:
        """Create the directory and missing parents."""
        self._path = path
        path.mkdir(parents=True)
        self._number = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)

    def create(self, name: str) -> BinaryIO:
        """Create a file in the directory and open it for writing."""
        return open(name, 'xb', opener=self._open)

    def put(self, name: str, text: str) -> None:
        """Write a file atomically."""
        # never write to an existing file
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
        """Check that the directory and one of its files still have their paths.

        If one was removed, moved or replaced, readers would not find data written later.
        """
        gone = None
        # the directory last, because without it its file is missing too
        for path, opened in ((self._path / file.name, file.fileno()), (self._path, self._number)):
            is_same = False
            with suppress(OSError):
                there = os.stat(path, follow_symlinks=False)
                is_same = os.path.samestat(there, os.fstat(opened))
            gone = gone if is_same else path
        if gone is not None:
            raise OSError(f'{gone} was removed, moved or replaced')

    def close(self) -> None:
        os.close(self._number)

    def remove(self, name: str) -> None:
        """Close the directory, and remove it with its only file, if they are still in place."""
        with suppress(OSError):
            os.unlink(name, dir_fd=self._number)
        self.close()
        # if a link has replaced the directory, the link stays
        with suppress(OSError):
            self._path.rmdir()

    def _open(self, name: str, flags: int) -> int:
        return os.open(name, flags | os.O_NOFOLLOW, 0o666, dir_fd=self._number)


class _File:
    """A self-contained MCAP file: definitions, QoS, description, index and counts.

    Methods that write raise OSError if the file cannot be written.

    Attributes:
        record: The file's entry in metadata.yaml.
        custom_data: The current description, which a later ``flush`` writes if it has changed.
    """

    def __init__(self, directory: _Directory, name: str, custom_data: Mapping[str, str]) -> None:
        """Create the file and write its header and metadata."""
        self.record = FileRecord(name)
        self.custom_data = custom_data
        # channel ID of each topic, and its number of messages in this file
        self._channels: dict[str, tuple[int, Topic]] = {}
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
            self._describe()
            self._mcap.flush()
        except OSError:
            self._stream.close()
            raise

    @property
    def size(self) -> int:
        """Bytes written so far, without those of the current chunk."""
        return self._stream.tell()

    def write(self, topic: Topic, data: bytes, log_time: int, publish_time: int) -> None:
        """Append a message that is played back at the log time [ns]."""
        channel_id, counted = self._channels.get(topic.name) or self._register(topic)
        self._mcap.add_message(channel_id, log_time, data, publish_time, topic.count)
        for item in (counted, topic, self.record):
            item.count += 1
        if self.record.start_ns is None:
            self.record.start_ns = log_time
        self.record.end_ns = log_time

    def attach(self, name: str, media_type: str, data: bytes, log_time: int) -> None:
        """Append an attachment, after flushing all messages and the current description."""
        self._mcap.flush()
        if self.custom_data is not self._described:
            self._describe()
        self._mcap.add_attachment(log_time, log_time, name, media_type, data)

    def flush(self) -> None:
        """Pass all buffered data to the operating system.

        A changed description is written again only after the file has grown by twice its size, so
        that descriptions never fill most of the file.

        Raises:
            OSError: If the file cannot be written or was removed.
        """
        self._mcap.flush()
        if self.custom_data is not self._described:
            grown = self.size - self._described_at
            if grown >= 2 * sum(map(len, self.custom_data.values())):
                self._describe()
                self._mcap.flush()
        self._directory.check(self._stream)

    def finish(self) -> None:
        """Write the index and close the file, even after an error.

        Raises:
            OSError: As in ``flush``.
        """
        with self._stream:
            self._mcap.flush()
            self._describe()
            self._mcap.finish()
            self._directory.check(self._stream)

    def _register(self, topic: Topic) -> tuple[int, Topic]:
        schema = topic.schema
        kind = topic.message_type
        if kind not in self._schema_ids:
            text = schema.text.encode()
            self._schema_ids[kind] = self._mcap.register_schema(kind, schema.encoding, text)
        known = {
            'offered_qos_profiles': profiles_to_yaml([topic.qos]),
            'topic_type_hash': schema.type_hash,
        }
        number = self._mcap.register_channel(topic.name, 'cdr', self._schema_ids[kind], known)
        self._channels[topic.name] = number, replace(topic, count=0)
        return self._channels[topic.name]

    def _describe(self) -> None:
        topics = (topic for _, topic in self._channels.values())
        data = bag_metadata.describe([self.record], topics, self.custom_data)
        self._mcap.add_metadata(bag_metadata.RECORD, bag_metadata.to_record(data))
        self._described, self._described_at = self.custom_data, self.size


class BagWriter:
    """Records serialised messages in a new bag.

    The newest file is readable up to the latest ``flush``, even if the process is killed. Only one
    thread may use a writer. After an OSError (a full disk) it can only be closed.

    With a limit on size or duration, the bag continues in a new file whenever a file reaches it:
    ``<bag>_0.mcap``, ``<bag>_1.mcap``, ... Each file is self-contained: it starts with the newest
    message of each latched topic, logged at the file's start with its original publish time.
    Messages with the same stamp (one frame) are always in the same file. A file whose repeated
    messages take up more than half of the limit continues until new messages take up as much.
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
            custom_data: Description of the recording: free text by name.
            max_size: Size at or above which a new file starts [bytes]; 0: no limit.
            max_duration: Duration in log time after which a new file starts [s]; 0: no limit.

        Raises:
            LavaError: If the directory exists or cannot be created, custom data is not text, or a
                limit is not valid.
            OSError: If the first file cannot be written. The directory is then removed.
        """
        self._custom_data = _texts(custom_data)
        self._max_size = validation.number('max_size', max_size, at_least=0.0, unit='bytes')
        duration = validation.number('max_duration', max_duration, at_least=0.0, unit='s')
        self._max_duration_ns = round(duration * 1e9)
        self.directory = Path(directory).absolute()
        if os.path.lexists(self.directory):
            expected = 'a directory that does not exist yet; choose another name or remove it'
            raise LavaError('bag', str(directory), expected)
        with refusing('bag', str(directory), 'a directory that can be created', OSError):
            self._directory = _Directory(self.directory)
        self._topics: dict[str, Topic] = {}
        # newest messages that the next file has to repeat, with their stamps [ns]
        self._latest: dict[str, tuple[bytes, int]] = {}
        self._records: list[FileRecord] = []
        self._last_stamp_ns: int | None = None
        self._end_ns = self._repeated_size = self._finished_size = 0
        self._closed = False
        self._file: _File | None = None
        try:
            self._open_file()
        except OSError:
            self._directory.remove(f'{self.directory.name}_0.mcap')
            raise

    @property
    def message_count(self) -> int:
        """Number of messages written so far, including repeated ones."""
        return sum(item.count for item in self._records)

    @property
    def size(self) -> int:
        """Bytes written so far, without those of the current chunk."""
        return self._finished_size + (self._file.size if self._file is not None else 0)

    @property
    def file_count(self) -> int:
        """Number of files."""
        return len(self._records)

    def set_custom_data(self, custom_data: Mapping[str, str]) -> None:
        """Replace the description of the recording; the next ``flush`` writes it to the file.

        Raises:
            LavaError: If a key or a value is not text, or the bag is closed.
        """
        self._open().custom_data = self._custom_data = _texts(custom_data)

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
        """Append a message, in a new file if the current one has reached a limit.

        Players and readers order by log time, which never decreases: a time before the latest one
        (after a reset or jump of the ROS clock) is replaced by the latest one. The publish time is
        always ``stamp_ns``, and the stamps inside ``data`` are unchanged.

        Args:
            topic: Absolute topic name.
            message_type: Type such as ``nav_msgs/msg/OccupancyGrid``.
            data: The message, serialised to CDR.
            stamp_ns: ROS time of the message [ns].
            qos: Profile that the topic's publisher offers; the same for each message of the topic.
            schema: Definition of the type; None looks it up among the installed packages.
            log_time_ns: Log time of a message that is copied [ns]; None: ``stamp_ns``.

        Raises:
            LavaError: If an argument is not valid, or the bag is closed.
            OSError: If the file cannot be written.
        """
        file = self._open()
        if not isinstance(stamp_ns, int) or not 0 <= stamp_ns < 2**63:
            raise LavaError('stamp_ns', stamp_ns, 'a ROS time in nanoseconds, at least 0')
        if len(data) < _CDR_HEADER_SIZE:
            raise LavaError('data', data, 'a message serialised to CDR')
        if topic not in self._topics and (not topic.startswith('/') or topic.endswith('/')):
            raise LavaError('topic', topic, 'an absolute topic name such as /lava/height')
        item = self._topics.get(topic) or Topic(
            topic, schema or message_schema(message_type), qos
        )
        first = (item.message_type, item.qos)
        if first != (message_type, qos):
            expected = f'the type and QoS of its first message: {first[0]}, {first[1]}'
            raise LavaError(f'message on {topic}', (message_type, qos), expected)
        log_time = max(stamp_ns if log_time_ns is None else log_time_ns, self._end_ns)
        if stamp_ns != self._last_stamp_ns and self._is_full(file, log_time):
            self.start_next_file()
            file = self._open()
            for other, (message, stamp) in self._latest.items():
                if other != topic:
                    file.write(self._topics[other], message, log_time, stamp)
            file.flush()
            self._repeated_size = file.size
        self._last_stamp_ns, self._end_ns = stamp_ns, log_time
        self._topics[topic] = item
        file.write(item, data, log_time, stamp_ns)
        if qos.is_latched and (self._max_size or self._max_duration_ns):
            self._latest[topic] = data, stamp_ns

    def attach(self, name: str, media_type: str, data: bytes, stamp_ns: int) -> None:
        """Append an attachment, which players ignore and ``bag.checkpoints`` finds.

        Names need not be unique. The log time is ``stamp_ns`` [ns] or, if later, the latest log
        time.

        Raises:
            LavaError: If the bag is closed.
            OSError: If the file cannot be written.
        """
        log_time = max(stamp_ns, self._end_ns)
        self._open().attach(name, media_type, data, log_time)

    def start_next_file(self) -> None:
        """Finish the current file and start a new one, without repeated messages.

        Raises:
            LavaError: If the bag is closed.
            OSError: If one of the files cannot be written.
        """
        file, self._file = self._open(), None
        self._finished_size += file.size
        file.finish()
        self._repeated_size = 0
        self._open_file()

    def flush(self) -> None:
        """Pass everything written so far to the operating system, as a complete chunk.

        The data then survive the end of this process, but not a loss of power.

        Raises:
            LavaError: If the bag is closed.
            OSError: If the file cannot be written, or is no longer in the bag.
        """
        self._open().flush()

    def close(self) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing.

        Raises:
            OSError: If the file cannot be written; it is then closed unfinished.
        """
        if self._closed:
            return
        self._closed = True
        try:
            if self._file is not None:
                self._file.finish()
            data = bag_metadata.describe(self._records, self._topics.values(), self._custom_data)
            text = bag_metadata.to_text({bag_metadata.ROOT: data})
            self._directory.put(bag_metadata.FILE_NAME, text)
        finally:
            self._directory.close()

    def __enter__(self) -> 'BagWriter':
        """Return the writer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the bag, even after an error, to keep the data written so far."""
        self.close()

    def _open(self) -> _File:
        if self._closed or self._file is None:
            raise LavaError('bag', str(self.directory), 'an open bag; this one is closed')
        return self._file

    def _open_file(self) -> None:
        name = f'{self.directory.name}_{len(self._records)}.mcap'
        self._file = _File(self._directory, name, self._custom_data)
        self._records.append(self._file.record)

    def _is_full(self, file: _File, log_time: int) -> bool:
        start_ns = file.record.start_ns
        if start_ns is None:
            return False
        if self._max_duration_ns and log_time - start_ns >= self._max_duration_ns:
            return True
        minimum = max(self._max_size, 2 * self._repeated_size)
        return bool(self._max_size) and file.size >= minimum


def _texts(custom_data: Mapping[str, str]) -> dict[str, str]:
    for key, value in custom_data.items():
        if not isinstance(key, str) or not isinstance(value, str):
            raise LavaError(f'custom_data[{key!r}]', value, 'text, and text as its key')
    return dict(custom_data)
