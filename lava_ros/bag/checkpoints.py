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

"""The checkpoints in a bag: attachments that a simulation can go on from."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from lava_ros.bag.attachments import attachments_of
from lava_ros.checkpoint import Checkpoint, from_bytes, MEDIA_TYPE, summary_of
from lava_ros.errors import LavaError

#: Name of the attachments.
NAME = 'lava checkpoint'


class StoredCheckpoint(NamedTuple):
    """What a list of checkpoints says of one.

    Attributes:
        time: Simulated time [s].
        log_time_ns: ROS time at which it was taken [ns].
        particle_count: Particles there are.
        size: Size in the bag [bytes].
    """

    time: float
    log_time_ns: int
    particle_count: int
    size: int


class FoundCheckpoint(NamedTuple):
    """The newest checkpoint that can be read.

    Attributes:
        checkpoint: The checkpoint.
        log_time_ns: ROS time at which it was taken [ns].
        refused: Newer attachments that cannot be read, and why.
    """

    checkpoint: Checkpoint
    log_time_ns: int
    refused: tuple[LavaError, ...]


def checkpoints_of(
    bag: str | Path, on_refused: Callable[[LavaError], None] | None = None
) -> list[StoredCheckpoint]:
    """The checkpoints of a bag, finished or not, oldest first; what they hold is not unpacked.

    Args:
        bag: The bag's directory, or an .mcap file.
        on_refused: Is told of each attachment that is damaged, or of a later version.

    Raises:
        LavaError: There is no such bag, or it cannot be read.
    """
    result = []
    for item in attachments_of(bag):
        try:
            data = item.read()
            # a damaged one may no longer say that it is a checkpoint
            if item.media_type != MEDIA_TYPE:
                continue
            summary = summary_of(data)
        except LavaError as error:
            if on_refused is not None:
                on_refused(error)
        else:
            result.append(
                StoredCheckpoint(
                    summary.time, item.log_time_ns, summary.particle_count, item.size
                )
            )
    return result


def newest_checkpoint(bag: str | Path) -> FoundCheckpoint:
    """Read the newest checkpoint of a bag, finished or not, that is not damaged.

    Args:
        bag: The bag's directory, or an .mcap file.

    Raises:
        LavaError: There is no such bag, or no checkpoint in it that can be read.
    """
    refused: list[LavaError] = []
    for item in reversed(attachments_of(bag)):
        try:
            data = item.read()
            if item.media_type == MEDIA_TYPE:
                return FoundCheckpoint(from_bytes(data), item.log_time_ns, tuple(refused))
        except LavaError as error:
            refused.append(error)
    if refused:
        raise refused[0]
    raise LavaError('bag', str(bag), 'a bag with a checkpoint in it; this one has none')
