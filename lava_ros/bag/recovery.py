"""Rewrites a bag whose recording was cut off into a finished one that every tool reads."""

from pathlib import Path

from lava_ros.bag.reader import BagReader
from lava_ros.bag.writer import BagWriter


def recover(source: BagReader, directory: str | Path) -> int:
    """Copy every message that can be read, with its definition, QoS and time, into a new bag.

    Args:
        source: The bag, finished or not.
        directory: The new bag.

    Returns:
        How many messages were copied.

    Raises:
        LavaError: The directory exists, or a chunk in the middle of the source is damaged; what
            comes before it has been copied then.
        OSError: The new bag cannot be written.
    """
    with BagWriter(directory, custom_data=source.custom_data) as writer:
        for message in source.messages():
            topic = source.topics[message.topic]
            writer.write(
                topic.name,
                topic.message_type,
                message.data,
                message.stamp_ns,
                qos=topic.qos,
                schema=topic.schema,
            )
        return writer.message_count
