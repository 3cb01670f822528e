# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Exclusive sums over an array of integers, in one launch.

On a GPU this is the decoupled look-back of Merrill & Garland (2016, Single-pass Parallel Prefix
Scan with Decoupled Look-back, NVIDIA): a block of threads sums a tile, publishes the sum, and
derives the sum of all earlier tiles from those already published. Blocks start in order of their
numbers, so none waits for a block that cannot start.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.backend.graph import Launches

#: Threads of a block.
_THREADS = 1024

#: Groups of four items per thread, by maximum number of items. With few items many blocks are
#: faster; with many items the look-back over their tiles is long.
_FOURS = ((1 << 19, 1), (1 << 21, 2), (math.inf, 8))

#: Groups of four items per thread in a batch, whose scans together have enough tiles.
_FOURS_TOGETHER = 4

#: A tile's word holds its state: (1, its sum), then (2, the sum up to its end), and in every
#: second scan (3, ...) and (4, ...), so that no word has to be cleared between scans. The word
#: after the last tile holds the parity of the scan. The last tile flips it: it ends only after
#: all others have read it.
_SCAN = """
#if defined(__CUDA_ARCH__)
    __shared__ int sums[32];
    __shared__ int start_of_tile;
    const unsigned all = 0xffffffffu;
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
    const int tile = thread / THREADS, last = tiles.shape[0] - 2;
    const int first = 32 * FOURS * (32 * tile + warp) + lane, end = sizes.shape[0] / 4;
    typedef unsigned long long word_t;
    volatile word_t* words = reinterpret_cast<word_t*>(tiles.data);
    const unsigned turn = last > 0 ? static_cast<unsigned>(words[last + 1]) : 0;
    int4 items[FOURS];
    for (int n = 0; n < FOURS; ++n) {
        const int at = first + 32 * n;
        items[n] = make_int4(0, 0, 0, 0);
        if (at < end)
            items[n] = reinterpret_cast<const int4*>(sizes.data)[at];
    }
    int starting[FOURS], total = 0;
    for (int n = 0; n < FOURS; ++n) {
        const int own = items[n].x + items[n].y + items[n].z + items[n].w;
        int sum = own;
        for (int apart = 1; apart < 32; apart *= 2) {
            const int former = __shfl_up_sync(all, sum, apart);
            sum += lane >= apart ? former : 0;
        }
        starting[n] = total + sum - own;
        total += __shfl_sync(all, sum, 31);
    }
    if (lane == 0)
        sums[warp] = total;
    __syncthreads();
    int before = lane < warp ? sums[lane] : 0;
    for (int apart = 16; apart > 0; apart /= 2)
        before += __shfl_xor_sync(all, before, apart);
    if (last > 0) {
        if (warp == 0) {
            int whole = sums[lane];
            for (int apart = 16; apart > 0; apart /= 2)
                whole += __shfl_xor_sync(all, whole, apart);
            if (lane == 0)
                words[tile] = word_t(turn + (tile == 0 ? 2 : 1)) << 32 | unsigned(whole);
            int earlier = 0;
            for (int nearest = tile - 1; nearest >= 0; nearest -= 32) {
                const int at = nearest - lane;
                word_t word = word_t(turn + 2) << 32;
                if (at >= 0)
                    do
                        word = words[at];
                    while (unsigned(word >> 32) - turn - 1 > 1);
                const unsigned is_whole = __ballot_sync(all, word >> 32 == turn + 2);
                int part = static_cast<int>(word & all);
                part = lane < (is_whole ? __ffs(is_whole) : 32) ? part : 0;
                for (int apart = 16; apart > 0; apart /= 2)
                    part += __shfl_xor_sync(all, part, apart);
                earlier += part;
                if (is_whole)
                    break;
            }
            if (lane == 0) {
                start_of_tile = earlier;
                if (tile > 0)
                    words[tile] = word_t(turn + 2) << 32 | unsigned(earlier + whole);
                if (tile == last)
                    words[last + 1] = 2 - turn;
            }
        }
        __syncthreads();
        before += start_of_tile;
    }
    for (int n = 0; n < FOURS; ++n) {
        const int at = first + 32 * n, start = before + starting[n];
        const int4 item = items[n];
        if (at < end)
            reinterpret_cast<int4*>(starts.data)[at] = make_int4(
                start, start + item.x, start + item.x + item.y, start + item.x + item.y + item.z);
    }
#else
    int start = 0;
    for (int n = 0; n < sizes.shape[0]; ++n) {
        starts.data[n] = start;
        start += sizes.data[n];
    }
#endif
"""


@lru_cache
def _kernel(fours: int) -> Any:
    @wp.func_native(_SCAN.replace('FOURS', str(fours)).replace('THREADS', str(_THREADS)))
    def sum_up(
        thread: int, sizes: wp.array(dtype=wp.int32), starts: wp.array(dtype=wp.int32),
        tiles: wp.array(dtype=wp.uint64),
    ): ...

    @quick_kernel()
    def scan(
        thread: int, sizes: wp.array(dtype=wp.int32), starts: wp.array(dtype=wp.int32),
        tiles: wp.array(dtype=wp.uint64),
    ):
        """Sum all items before each item; on the CPU in one thread."""
        sum_up(thread, sizes, starts, tiles)

    return scan


class Scan:
    """Exclusive sums of arrays of one ``length``."""

    def __init__(self, length: int, device: Any) -> None:
        """Prepare for arrays of this length, a multiple of 4."""
        self.length, self._device = length, device
        self._fours = next(fours for max_count, fours in _FOURS if length < max_count)
        #: Words of the tiles, by groups of four per thread.
        self._words: dict[int, Any] = {}

    def __call__(self, launches: Launches, sizes: Any, starts: Any) -> None:
        """Write the sum of all ``sizes`` before each of them into ``starts``."""
        fours = _FOURS_TOGETHER if launches.is_capturing else self._fours
        tiles = math.ceil(self.length / (4 * fours * _THREADS))
        if fours not in self._words:
            self._words[fours] = wp.zeros(tiles + 1, dtype=wp.uint64, device=self._device)
        launches(
            _kernel(fours),
            [sizes, starts, self._words[fours]],
            dim=tiles * _THREADS if self._device.is_cuda else 1,
            block_dim=_THREADS,
        )
