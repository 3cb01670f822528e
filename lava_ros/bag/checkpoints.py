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

from pathlib import Path
from typing import NamedTuple

from lava_ros.bag.attachments import Attachment, attachments_of
from lava_ros.checkpoint import Checkpoint, from_bytes, MEDIA_TYPE, PREFIX_SIZE, summary_of
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
        refused: Newer ones that cannot be read, and why.
    """

    checkpoint: Checkpoint
    log_time_ns: int
    refused: tuple[LavaError, ...]


def checkpoints_of(bag: str | Path) -> list[StoredCheckpoint]:
    """The checkpoints of a bag, finished or not, oldest first; what they hold is not read.

    Args:
        bag: The bag's directory, or an .mcap file.

    Raises:
        LavaError: There is no such bag, it cannot be read, or a checkpoint is of a later version.
    """
    result = []
    for item in _attachments(bag):
        summary = summary_of(item.start(PREFIX_SIZE))
        result.append(
            StoredCheckpoint(summary.time, item.log_time_ns, summary.particle_count, item.size)
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
    for item in reversed(_attachments(bag)):
        try:
            return FoundCheckpoint(from_bytes(item.read()), item.log_time_ns, tuple(refused))
        except LavaError as error:
            refused.append(error)
    if refused:
        raise refused[0]
    raise LavaError('bag', str(bag), 'a bag with a checkpoint in it; this one has none')


def _attachments(bag: str | Path) -> list[Attachment]:
    return [item for item in attachments_of(bag) if item.media_type == MEDIA_TYPE]
