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

"""What a GPU that had no memory left leaves behind."""

from contextlib import suppress
from typing import Any

import warp as wp


def forget_failure(device: Any) -> None:
    """Take away the error of an allocation that failed, which a GPU keeps for whoever asks next.

    Warp raises for the allocation and leaves the error with the CUDA runtime. The next scan or
    sort finds it there and fails in its place ("invalid device ordinal"): that of the simulation
    which still has all it needs, or of the new one after a reset. A scan of one number takes it.

    Args:
        device: The Warp device; nothing is done on the CPU.
    """
    if device.is_cuda:
        with suppress(RuntimeError):
            number = wp.zeros(1, dtype=wp.int32, device=device)
            wp.utils.array_scan(number, number)
