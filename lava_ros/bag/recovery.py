# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Conversion of a truncated bag to a finished one that every tool reads."""

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from lava_ros.bag.checkpoints import Attachment, attachments_in
from lava_ros.bag.reader import BagReader
from lava_ros.bag.writer import BagWriter
from lava_ros.errors import LavaError


def recover(
    source: BagReader,
    directory: str | Path,
    *,
    on_progress: Callable[[str, float], None] | None = None,
) -> int:
    """Copy every readable message, with its definition, QoS and times, into a new bag.

    The new bag has the same files and the readable attachments, without the damaged parts that
    ``source.damage`` lists. ``on_progress`` is called with the name of the activity and the copied
    fraction of the recorded time.

    Returns:
        The number of messages copied.

    Raises:
        LavaError: If the directory exists, or a file can no longer be read; the messages before
            that point have then been copied.
        OSError: If the new bag cannot be written.
    """
    with BagWriter(directory, custom_data=source.custom_data) as writer:
        for index, file in enumerate(source.files):
            if index:
                writer.start_next_file()
            attachments = deque(attachments_in(file))
            for message in source.messages(file=file):
                while attachments and attachments[0].log_time_ns < message.stamp_ns:
                    _attach(writer, attachments.popleft())
                topic = source.topics[message.topic]
                writer.write(
                    topic.name,
                    topic.message_type,
                    message.data,
                    message.publish_ns,
                    qos=topic.qos,
                    schema=topic.schema,
                    log_time_ns=message.stamp_ns,
                )
                if on_progress is not None and source.start_ns is not None:
                    done = message.stamp_ns - source.start_ns
                    on_progress('copying', min(1.0, done / max(source.duration_ns, 1)))
            for item in attachments:
                _attach(writer, item)
        return writer.message_count


def _attach(writer: BagWriter, item: Attachment) -> None:
    # a damaged one is left out
    with suppress(LavaError):
        writer.attach(item.name, item.media_type, item.read(), item.log_time_ns)
