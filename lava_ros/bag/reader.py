# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Reading of rosbag2 MCAP bags, also of truncated recordings."""

from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
import logging
from pathlib import Path
import re
from typing import NamedTuple

from lava_ros.bag import metadata as bag_metadata
from lava_ros.bag import qos as bag_qos
from lava_ros.bag.mcap_file import has_begun, McapFile, open_mcap
from lava_ros.bag.metadata import Topic
from lava_ros.bag.qos import QosProfile
from lava_ros.bag.run_bag import bag_in
from lava_ros.bag.schemas import MessageSchema
from lava_ros.errors import LavaError
from lava_ros.files import similar_file

_LOG = logging.getLogger(__name__)


class BagMessage(NamedTuple):
    """A message of a bag, in CDR: ``stamp_ns`` is the log time at which it is played [ns]."""

    topic: str
    stamp_ns: int
    publish_ns: int
    data: bytes


class BagReader:
    """Reads a bag without loading it: only chunks that overlap in time are in memory.

    The reader keeps no file open: each iteration opens the files again.

    Attributes:
        path: The path given by the caller.
        files: The bag's MCAP files, oldest first; without a last one that was truncated before
            its first record.
        contents: Contents of each file.
        topics: Topics by name.
        custom_data: Description of the recording: free text by name.
        recovered: Whether a file is unfinished. Everything before its end is read.
        damage: A sentence for each damaged part that is left out, for messages in metadata.yaml
            that are missing, and for each part that a caller could not use
            (``report_damage``). The sentences are also logged.
        start_ns, end_ns: Log time of the first and last message [ns], None without messages.
        size: Total size of the files [bytes].
    """

    def __init__(self, path: str | Path) -> None:
        """Read the contents of a bag directory, an .mcap file or the folder of a run.

        An unfinished file is read once from start to end.

        Raises:
            LavaError: If ``path`` is not a readable bag.
        """
        self.path = Path(path)
        if not self.path.exists():
            expected = f'a bag directory or an .mcap file that exists{similar_file(self.path)}'
            raise LavaError('bag', str(path), expected)
        yaml_path = bag_in(path) / bag_metadata.FILE_NAME
        stored = bag_metadata.read_metadata(yaml_path) if yaml_path.exists() else None
        self.files = mcap_files(self.path, None if stored is None else stored.files)
        was_begun = stored is not None or len(self.files) == 1 or has_begun(self.files[-1])
        if not was_begun:
            self.files = self.files[:-1]
        self.contents = [open_mcap(item) for item in self.files]
        self.damage = tuple(text for item in self.contents for text in item.damage)
        self.topics = _topics(self.contents)
        described, unreadable = _described(self.contents)
        last = self.contents[-1]
        record = last.metadata.get(bag_metadata.RECORD, {})
        is_checked = not last.damage and bag_metadata.CHECKSUM in record
        self.custom_data = described if stored is None else stored.custom_data
        if stored is None:
            self.damage += unreadable
        elif is_checked and described != self.custom_data:
            self.damage += (
                f'custom_data of {yaml_path} is damaged or changed: the last file differs',
            )
        if stored is not None:
            self.damage += _missing(stored.counts, self.topics, yaml_path)
        self.recovered = not (was_begun and all(item.finished for item in self.contents))
        starts = [item.start_ns for item in self.contents if item.start_ns is not None]
        ends = [item.end_ns for item in self.contents if item.end_ns is not None]
        self.start_ns, self.end_ns = min(starts, default=None), max(ends, default=None)
        self.size = sum(item.size for item in self.contents)
        for text in self.damage:
            _LOG.warning('%s', text)
        for item in self.contents:
            if item.rest:
                message = '%s was cut off: its last %d bytes, an incomplete record, are ignored'
                _LOG.info(message, item.path, item.rest)

    def warn_if_cut_off(self) -> None:
        """Log a warning if the recording was cut off; a command then exits with status 1."""
        if self.recovered:
            _LOG.warning(
                '%s was cut off, or is still being recorded; lava bag recover makes a finished '
                'bag of it', self.path,
            )

    def report_damage(self, text: str) -> None:
        """Add a sentence about a part that is left out to ``damage``, and log it."""
        self.damage += (text,)
        _LOG.warning('%s', text)

    @property
    def duration_ns(self) -> int:
        """Log time from the first message to the last [ns]."""
        return (self.end_ns or 0) - (self.start_ns or 0)

    @property
    def message_count(self) -> int:
        """Number of messages in the bag."""
        return sum(topic.count for topic in self.topics.values())

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        *,
        file: Path | None = None,
    ) -> Iterator[BagMessage]:
        """Yield messages of some topics, None for all, in order of log time, file by file.

        Topics that the bag lacks are ignored. ``start_ns`` is the earliest log time [ns]; ``file``
        is the one of ``files`` to read, None for all.

        Raises:
            LavaError: If a file is damaged or cannot be read.
        """
        for contents in self.contents:
            if file is None or contents.path == file:
                names = _channel_topics(contents, topics)
                for item in contents.messages(names, start_ns or 0):
                    yield BagMessage(
                        names[item.channel_id], item.log_time, item.publish_time, item.data
                    )

    def newest(self, topics: Collection[str], before_ns: int) -> list[BagMessage]:
        """Return the newest message of each topic before a log time [ns], oldest first.

        Raises:
            LavaError: If a file is damaged or cannot be read.
        """
        found: dict[str, BagMessage] = {}
        for contents in reversed(self.contents):
            names = _channel_topics(contents, [item for item in topics if item not in found])
            here = contents.newest(names, before_ns).values()
            # a topic may have several channels
            for item in sorted(here, key=lambda message: message.log_time, reverse=True):
                name = names[item.channel_id]
                message = BagMessage(name, item.log_time, item.publish_time, item.data)
                found.setdefault(name, message)
        return sorted(found.values(), key=lambda item: item.stamp_ns)


def mcap_files(bag: Path, names: Sequence[str] | None = None) -> tuple[Path, ...]:
    """Return the files of a bag (a single .mcap file, a directory, or a run), oldest first.

    Without ``names``, the number in the file name sets the order: 2 is before 10.

    Raises:
        LavaError: If the directory has no .mcap files.
    """

    def order(path: Path) -> list[tuple[int, str]]:
        parts = re.split(r'(\d+)', path.name)
        return [(int(part) if part.isdigit() else -1, part) for part in parts]

    bag = bag_in(bag)
    if not bag.is_dir():
        return (bag,)
    named = sorted(bag.glob('*.mcap'), key=order) if names is None else [bag / n for n in names]
    if not named:
        raise LavaError('bag', str(bag), 'a directory with .mcap files; this one has none')
    return tuple(named)


def _channel_topics(contents: McapFile, topics: Collection[str] | None) -> dict[int, str]:
    return {
        channel.id: channel.topic
        for channel in contents.channels.values()
        if topics is None or channel.topic in topics
    }


def _topics(files: list[McapFile]) -> dict[str, Topic]:
    schemas: dict[str, MessageSchema] = {}
    profiles: defaultdict[str, list[QosProfile]] = defaultdict(list)
    counts: Counter[str] = Counter()
    for contents in files:
        for channel in contents.channels.values():
            name, schema = channel.topic, contents.schemas.get(channel.schema_id)
            where = f'topic {name} of {contents.path}'
            if channel.message_encoding != 'cdr' or schema is None:
                expected = 'messages in the cdr encoding that ROS 2 uses, with a schema'
                raise LavaError(where, channel.message_encoding, expected)
            text = schema.data.decode(errors='replace')
            type_hash = channel.metadata.get('topic_type_hash', '')
            found = MessageSchema(schema.name, text, type_hash, schema.encoding)
            known = schemas.setdefault(name, found)
            if known.name != schema.name:
                raise LavaError(where, schema.name, f'{known.name} as before')
            offered = channel.metadata.get('offered_qos_profiles', '')
            profiles[name] += bag_qos.profiles_from_yaml(offered)
            counts[name] += contents.counts.get(channel.id, 0)
    return {
        name: Topic(name, schema, bag_qos.merge(profiles[name]), counts[name])
        for name, schema in sorted(schemas.items())
    }


def _missing(listed: Counter[str], topics: Mapping[str, Topic], path: Path) -> tuple[str, ...]:
    """Describe messages that the metadata list and the files lack; empty if all are present."""
    lost = listed - Counter({name: topic.count for name, topic in topics.items()})
    if not lost:
        return ()
    by_topic = ', '.join(f'{count} of {name}' for name, count in sorted(lost.items()))
    return (
        f'{lost.total()} of the {listed.total()} messages that {path} lists are missing: '
        f'{by_topic}',
    )


def _described(files: list[McapFile]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the newest readable custom data, and the errors of newer records.

    Raises:
        LavaError: If rosbag2 has compressed the messages.
    """
    unreadable: tuple[str, ...] = ()
    for contents in reversed(files):
        record = contents.metadata.get(bag_metadata.RECORD)
        if record is not None:
            try:
                stored = bag_metadata.parse_record(record, contents.path)
            except LavaError as error:
                unreadable += (str(error),)
            else:
                # `ros2 bag reindex` writes a metadata.yaml without the compression
                stored.check_readable(contents.path)
                return stored.custom_data, unreadable
    return {}, unreadable
