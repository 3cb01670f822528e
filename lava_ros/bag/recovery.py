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
