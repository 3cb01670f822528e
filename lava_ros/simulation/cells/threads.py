# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Threads of a step on cells: one on a CPU, and on a GPU those of all blocks of a world.

The C++ of a step has loops over the rows and columns of a window. On a CPU one thread takes all of
them, in loops that the compiler vectorises. On a GPU a world has a block or a cluster of blocks.
Each block has a band of rows, and each row of it a warp, or more if there are more warps than
rows.
"""

#: Number of threads of a block.
THREADS = 512

#: Names in C++: numbers of this thread's cells along a row (``lane``, ``lanes``) and of its rows
#: (``first_of``, ``last_of``, ``lines``), of those from ``top`` to ``bottom``; the same if each
#: row has one warp (``thread``, ``threads``, ``first_for_warp``, ``warps``), or one thread
#: (``first_for_one``, ``single``). ``together`` waits for all threads of the world and makes
#: their results readable. ``raise`` and, after that, ``raised`` find a maximum of positive
#: integers, ``largest`` that of a warp, ``mark`` sets a cleared number to 1 if any thread does,
#: and ``summed`` adds numbers of a warp.
SHARED = """
#if defined(__CUDA_ARCH__)
#define APART
    constexpr bool is_serial = false;
    const long threads = 32, thread = threadIdx.x & 31, warps = blockDim.x >> 5;
    const long rank = blockIdx.x % BLOCKS, band = (bottom - top + BLOCKS) / BLOCKS;
    const bool is_first_warp = rank == 0 && threadIdx.x < 32;
    const bool is_first = is_first_warp && thread == 0;
    int shift = 5;
    while (band << (shift + 1) <= blockDim.x) ++shift;
    const long lanes = 1 << shift, lane = threadIdx.x & (lanes - 1);
    const long lines = blockDim.x >> shift, line = threadIdx.x >> shift;
    const long band_0 = top + rank * band, band_1 = band_0 + band - 1;
    auto first_of = [&](long i) { return (i > band_0 ? i : band_0) + line; };
    auto first_for_warp = [&](long i) { return (i > band_0 ? i : band_0) + (threadIdx.x >> 5); };
    const long single = blockDim.x;
    auto first_for_one = [&](long i) { return (i > band_0 ? i : band_0) + threadIdx.x; };
    auto last_of = [&](long i) { return i < band_1 ? i : band_1; };
    auto together = [&] { TOGETHER };
    auto largest = [](int value) {
        for (int apart = 16; apart > 0; apart /= 2) {
            const int other = __shfl_xor_sync(~0u, value, apart);
            value = other > value ? other : value;
        }
        return value;
    };
    auto raise = [&](int* slot, int value) {
        value = largest(value);
        if (thread == 0 && value > 0) atomicMax(slot, value);
    };
    auto mark = [&](int* slot, int value) {
        if (__any_sync(~0u, value) && thread == 0) *slot = 1;
    };
    auto raised = [](int* slot) { return *(volatile int*)slot; };
    auto counted = [](int value) { return __popc(value); };
    auto summed = [](double value) {
        for (int apart = 16; apart > 0; apart /= 2)
            value += __shfl_xor_sync(~0u, value, apart);
        return value;
    };
#else
#define APART __restrict
    constexpr bool is_serial = true, is_first = true, is_first_warp = true;
    constexpr long lanes = 1, lane = 0, lines = 1, threads = 1, thread = 0, warps = 1;
    auto first_of = [](long i) { return i; };
    auto first_for_warp = [](long i) { return i; };
    constexpr long single = 1;
    auto first_for_one = [](long i) { return i; };
    auto last_of = [](long i) { return i; };
    auto together = [] {};
    auto largest = [](int value) { return value; };
    auto raise = [](int* slot, int value) { *slot = value > *slot ? value : *slot; };
    auto raised = [](int* slot) { return *slot; };
    auto mark = [](int* slot, int value) { *slot |= value; };
    auto counted = [](int value) { return __builtin_popcount(value); };
    auto summed = [](double value) { return value; };
#endif
"""

#: Maxima of a step (CUDA: of all threads, in memory that the next step clears). The heat, after
#: the step, has those of the next one.
SLOTS = """
#if defined(__CUDA_ARCH__)
    int* slots = s.slots.data + (s.counts.data[0] & 1) * 16;
    int* others = s.slots.data + (1 - (s.counts.data[0] & 1)) * 16;
#else
    int slots[16] = {0};
#endif
"""

#: Number of the maximum of the heat: 1 if any lava is colder than the solidus.
COLDEST = 15

#: Clears the maxima. ``WHICH`` is ``slots``, or ``others``, those of the preceding step.
CLEAR = """
#if defined(__CUDA_ARCH__)
    if (rank == 0 && threadIdx.x < 16) WHICH[threadIdx.x] = 0;
#endif
"""

_BARRIERS = {
    False: '__syncthreads();',
    True: (
        'asm volatile("barrier.cluster.arrive.release.aligned;\\n'
        'barrier.cluster.wait.acquire.aligned;" ::: "memory");'
    ),
}


def shared(blocks: int) -> str:
    """Return the C++ that shares the rows from ``top`` to ``bottom`` among threads.

    Args:
        blocks: Number of blocks of a world on a GPU.
    """
    return SHARED.replace('BLOCKS', str(blocks)).replace('TOGETHER', _BARRIERS[blocks > 1])
