# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The metadata.yaml of a bag, in the format of rosbag2 in ROS 2 Jazzy."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
import zlib

from lava_ros.bag.qos import QosProfile
from lava_ros.bag.schemas import MessageSchema
from lava_ros.errors import LavaError, refusing
from lava_ros.files.yaml import dump_yaml, parse_yaml, read_yaml
from lava_ros.validation import whole

FILE_NAME = 'metadata.yaml'

#: Version of rosbag2's metadata: the first in which QoS profiles are a list with named policies.
VERSION = 9

ROS_DISTRO = 'jazzy'

#: Name of the MCAP metadata record with the content of metadata.yaml.
RECORD = 'rosbag2'

#: Key of a checksum of that record: MCAP itself has none.
CHECKSUM = 'crc32'

_TEXT = 'serialized_metadata'

#: Key of all metadata in metadata.yaml.
ROOT = 'rosbag2_bagfile_information'

# rosbag2's start time for a bag without messages.
_NEVER = 2**63 - 1


@dataclass
class Topic:
    """A topic of a bag, with its number of messages and the definition of their type.

    ``qos`` is the profile of its publisher, or the combined one of all recorded publishers.
    """

    name: str
    schema: MessageSchema
    qos: QosProfile
    count: int = 0

    @property
    def message_type(self) -> str:
        """Name of the type, such as ``nav_msgs/msg/OccupancyGrid``."""
        return self.schema.name


@dataclass
class FileRecord:
    """A file of a bag: its name, and the log times of its first and last message [ns]."""

    path: str
    start_ns: int | None = None
    end_ns: int | None = None
    count: int = 0


def describe(
    files: Sequence[FileRecord], topics: Iterable[Topic], custom_data: Mapping[str, str]
) -> dict[str, Any]:
    """Return metadata without the root key, keys in rosbag2's order; files are oldest first."""
    starts = [item.start_ns for item in files if item.start_ns is not None]
    ends = [item.end_ns for item in files if item.end_ns is not None]
    span = _time_span(min(starts, default=None), max(ends, default=None))
    return {
        'version': VERSION,
        'storage_identifier': 'mcap',
        'duration': span['duration'],
        'starting_time': span['starting_time'],
        'message_count': sum(item.count for item in files),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': item.name,
                    'type': item.message_type,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': [item.qos.to_dict()],
                    'type_description_hash': item.schema.type_hash,
                },
                'message_count': item.count,
            }
            for item in topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [item.path for item in files],
        'files': [
            {
                'path': item.path,
                **_time_span(item.start_ns, item.end_ns),
                'message_count': item.count,
            }
            for item in files
        ],
        'custom_data': dict(custom_data),
        'ros_distro': ROS_DISTRO,
    }


def to_record(data: Mapping[str, Any]) -> dict[str, str]:
    """Convert metadata to the content of a file's ``rosbag2`` record, with a checksum."""
    text = to_text(data)
    return {_TEXT: text, CHECKSUM: _checksum(RECORD, text)}


def to_text(data: Mapping[str, Any]) -> str:
    """Convert metadata to YAML."""
    # lines are not folded, so that every YAML reader reads long values unchanged
    return dump_yaml(data, allow_unicode=True, width=2**31 - 1)


def is_whole(name: str, record: Mapping[str, str]) -> bool:
    """Return True if an MCAP metadata record matches its checksum or has none."""
    if CHECKSUM in record:
        return record[CHECKSUM] == _checksum(name, record.get(_TEXT, ''))
    return name != RECORD or _TEXT in record


class StoredMetadata(NamedTuple):
    """The part of metadata of any version that a reader needs.

    Attributes:
        files: Names of the files, oldest first.
        custom_data: Free text by name.
        counts: Number of messages by topic; empty if the metadata do not list topics.
        compression_mode: ``message`` or ``file`` of rosbag2, empty without compression by it.
    """

    files: tuple[str, ...]
    custom_data: dict[str, str]
    counts: Counter[str]
    compression_mode: str

    def check_readable(self, path: Path) -> None:
        """Raise LavaError if rosbag2 has compressed the messages or files; MCAP may do so."""
        if self.compression_mode:
            expected = 'none (compression in the MCAP file is fine); `ros2 bag convert` rewrites '
            expected += 'a bag whose metadata.yaml states its compression_mode and _format'
            raise LavaError(f'compression_mode of {path}', self.compression_mode, expected)


def read_metadata(path: Path) -> StoredMetadata:
    """Read a metadata.yaml.

    Raises:
        LavaError: If the file does not describe a bag in plain MCAP.
    """
    expected = 'metadata written by rosbag2; if the file is damaged, delete it: it is not needed'
    data = read_yaml('bag', path, expected)
    if not isinstance(data, Mapping) or ROOT not in data:
        raise LavaError('bag', str(path), f'{expected} (a mapping with the key {ROOT})')
    result = _parsed(data[ROOT], path)
    result.check_readable(path)
    return result


def parse_record(record: Mapping[str, str], path: Path) -> StoredMetadata:
    """Read the content of a ``rosbag2`` record.

    Raises:
        LavaError: If the content is not metadata of a bag in MCAP.
    """
    return _parsed(parse_yaml(f'record {RECORD} of {path}', record.get(_TEXT, '')), path)


def _parsed(data: object, path: Path) -> StoredMetadata:
    if not isinstance(data, Mapping):
        raise LavaError('bag', str(path), 'metadata written by rosbag2: a YAML mapping')
    storage = data.get('storage_identifier')
    if storage != 'mcap':
        expected = 'mcap; `ros2 bag convert` turns other bags into MCAP'
        raise LavaError(f'storage_identifier of {path}', storage, expected)
    names = data.get('relative_file_paths') or []
    custom_data = data.get('custom_data') or {}
    if not isinstance(names, list) or not isinstance(custom_data, Mapping):
        expected = 'metadata with a list relative_file_paths and a mapping custom_data'
        raise LavaError('bag', str(path), expected)
    texts = {str(key): str(value) for key, value in custom_data.items()}
    files = tuple(Path(str(item)).name for item in names)
    counts = _counts(data.get('topics_with_message_count') or [], path)
    mode = str(data.get('compression_mode') or '')
    return StoredMetadata(files, texts, counts, '' if mode.lower() == 'none' else mode)


def _counts(listed: object, path: Path) -> Counter[str]:
    counts: Counter[str] = Counter()
    expected = 'metadata with a name and a message_count for each topic; if damaged, delete it'
    with refusing('bag', str(path), expected, KeyError, TypeError):
        for item in listed:  # type: ignore[attr-defined]
            name = str(item['topic_metadata']['name'])
            field = f'message_count of {name} in {path}'
            counts[name] += whole(field, item['message_count'], at_least=0, at_most=2**63)
    return counts


def _checksum(name: str, text: str) -> str:
    return f'{zlib.crc32((name + text).encode()):08x}'


def _time_span(start_ns: int | None, end_ns: int | None) -> dict[str, Any]:
    if start_ns is None or end_ns is None:
        start_ns = end_ns = _NEVER
    return {
        'starting_time': {'nanoseconds_since_epoch': start_ns},
        'duration': {'nanoseconds': end_ns - start_ns},
    }
