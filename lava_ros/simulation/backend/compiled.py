# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compilation of the kernels of a stage, and device functions that use features of the hardware.

docs/PERFORMANCE.md describes each technique, its reason and its gain:

* ``quick_kernel``: no loop over the grid (a thread has one particle, or its own loop), no adjoint,
  and on CUDA the hardware's own division, root and exponential in float32. Those are accurate to
  2e-7, as is float32; float64, and with it the reference, is not affected.
* ``access``: Warp reads a vec4 as four numbers without alignment; here it is one
  access to 16 bytes. Reads use the read-only cache: never read this way what the kernel writes.
* ``after_previous_kernel``: a kernel may start before its predecessor has ended.
* ``announce``, ``wait_for``: one thread can process the results of all threads without a launch of
  its own, while the other threads do work that does not depend on it.
* ``raise_to``: a maximum over all particles. Atomic updates of one address by each thread would be
  slower than the rest of the kernel; a warp of 32 finds its own maximum and updates it once.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from inspect import signature
import linecache
from typing import Any

import warp as wp

# Warp reports every kernel it loads on stdout, where commands print their results.
wp.config.log_level = wp.LOG_WARNING

#: CUDA's type for several numbers that are accessed together, and how many of it make a vector.
_WIDE = {
    (wp.float32, 2): ('float2', 1),
    (wp.float32, 4): ('float4', 1),
    (wp.float64, 2): ('double2', 1),
    (wp.float64, 4): ('double2', 2),
}
#: All threads of a particle are active, and adjacent in a warp.
_SUM = """
#if defined(__CUDA_ARCH__)
    const unsigned mask = ((1u << LANES) - 1u) << (threadIdx.x & 31u & ~(LANES - 1u));
    for (int apart = LANES / 2; apart > 0; apart /= 2)
        value += __shfl_xor_sync(mask, value, apart);
#endif
    return value;
"""
_LOAD_UNCACHED = """
    int v;
    asm volatile("ld.relaxed.gpu.global.s32 %0, [%1];" : "=r"(v) : "l"(values.data + i));
    return v;
"""
#: Runs in the first block, which starts before any block that waits for it. The fence also
#: invalidates the cache that it shares with other blocks.
_ANNOUNCE = """
#if defined(__CUDA_ARCH__)
    if (threadIdx.x == 0) {
        __threadfence();
        asm volatile("st.relaxed.gpu.global.s32 [%0], 1;" :: "l"(flag.data) : "memory");
    }
    __syncthreads();
#endif
"""
_WAIT_FOR = """
#if defined(__CUDA_ARCH__)
    int is_there;
    do
        asm volatile("ld.relaxed.gpu.global.s32 %0, [%1];"
            : "=r"(is_there) : "l"(flag.data) : "memory");
    while (!is_there);
#endif
"""
#: Makes all writes of the preceding kernels visible; only GPUs of compute capability 9.0 and later
#: start early.
_WAIT = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    asm volatile("griddepcontrol.wait;" ::: "memory");
#endif
"""
#: NaN raises nothing: positive floats are in the order of their bits. Integers rarely change.
_RAISE = {
    wp.int32: """
#if defined(__CUDA_ARCH__)
    if (value > *reinterpret_cast<volatile int*>(values.data + i))
        atomicMax(values.data + i, value);
#else
    RAISE_ON_CPU
#endif
""",
    wp.float32: """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    const unsigned mask = __activemask();
    const unsigned bits = value > 0.0f ? __float_as_uint(value) : 0u;
    const unsigned largest = __reduce_max_sync(mask, bits);
    unsigned* place = reinterpret_cast<unsigned*>(values.data + i);
    if ((threadIdx.x & 31u) == static_cast<unsigned>(__ffs(mask)) - 1u && largest > __ldcg(place))
        atomicMax(place, largest);
#elif defined(__CUDA_ARCH__)
    wp::atomic_max(values.data + i, value > 0.0f ? value : 0.0f);
#else
    RAISE_ON_CPU
#endif
""",
    wp.float64: """
#if defined(__CUDA_ARCH__)
    wp::atomic_max(values.data + i, value > 0.0 ? value : 0.0);
#else
    RAISE_ON_CPU
#endif
""",
}
#: Warp's own is not atomic for the threads of a CPU (threads.py).
_RAISE_ON_CPU = """
    auto largest = values.data[i];
    __atomic_load(values.data + i, &largest, __ATOMIC_RELAXED);
    while (value > largest && !__atomic_compare_exchange(
        values.data + i, &largest, &value, true, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {}
"""


#: Threads per block, and blocks that a processor must hold, for kernels of few threads. With its
#: own bounds the compiler would save registers and wait for each load before the next.
FEW_THREADS = 256, 4


#: Called with each new kernel: tests compare its arrays with their table (docs/kernels.py).
on_new_kernel: list[Callable[[Any], None]] = []


def quick_kernel(*, bounds: tuple[int, int] | None = None, fast_math: bool = True) -> Any:
    """Make a kernel of a function of the thread's number and further arguments; a decorator.

    The kernel takes one more, last argument: the number of its first thread on a CPU
    (threads.py). ``bounds`` are the threads per block, and the blocks per GPU processor for which
    registers must suffice; ``fast_math`` makes CUDA use the hardware's float32 functions.
    """

    def make(function: Callable[..., None]) -> Any:
        _, *names = signature(function).parameters
        types = {name: function.__annotations__[name] for name in names}
        body = wp.func(function)
        write = partial(_kernel_of, body, function, bounds, fast_math)
        kernel = write(
            types | {'first': int},
            'thread = counted_from(first, wp.tid())',
            'after_previous_kernel()',
            f'body(thread, {", ".join(names)})',
        )
        kernel.for_many = lru_cache(partial(_for_many, write, function, types))
        kernel.body = body
        for react in on_new_kernel:
            react(kernel)
        return kernel

    return make


def _for_many(
    write: Callable[..., Any], function: Callable[..., None], types: Mapping[str, Any],
    size: int, takes_turns: bool,
) -> tuple[Any, Any]:
    """Return the Warp struct of a member's arguments, and the kernel for many members at once.

    The kernel takes an array of them, and for each block of ``size`` threads the index of its
    member, its first thread and the end of its threads, each -1 for none. With ``takes_turns`` a
    block may serve more threads than it has, one after the other; a large function then needs
    more registers.
    """
    kind = type(function.__name__, (), {
        '__annotations__': dict(types), '__module__': function.__module__,
        '__qualname__': f'{function.__qualname__}_arguments',
    })
    arguments = wp.struct(kind)
    kernel = write(
        {'members': wp.array(dtype=arguments), 'blocks': wp.array(dtype=wp.vec3i)},
        f'block = blocks[block_number({size}, wp.tid())]',
        f'thread = block[1] + number_in_block({size}, wp.tid())',
        'after_previous_kernel()',
        # without a member, no thread is before the end
        f'{"while" if takes_turns else "if"} thread < block[2]:',
        '    member = members[block[0]]',
        f'    body(thread, {", ".join(f"member.{name}" for name in types)})',
        f'    thread += {size}',
    )
    # a kernel compiled earlier from the same code has its own struct
    return kernel.adj.args[0].type.dtype, kernel


def _kernel_of(
    body: Any, function: Callable[..., None], bounds: tuple[int, int] | None, fast_math: bool,
    types: Mapping[str, Any], *lines: str,
) -> Any:
    """Write a kernel of a function: arguments by name, and the lines that call the function."""
    return wp.kernel(
        write_function(
            function, types, ''.join(f'\n    {line}' for line in lines),
            globals() | {'body': body},
        ),
        module='unique',
        enable_backward=False,
        grid_stride=False,
        launch_bounds=bounds,
        module_options={'fast_math': fast_math, 'enable_backward': False},
    )


def write_function(
    origin: Any, types: Mapping[str, Any], body: str, names: Mapping[str, Any]
) -> Any:
    """Write a Python function for Warp.

    Args:
        origin: Function of which the written one has the name.
        types: Type of each argument, by name.
        body: Source of its body, indented.
        names: Values of the other names in it.
    """
    heading = ', '.join(f'{name}: types["{name}"]' for name in types)
    source = f'def {origin.__name__}({heading}):{body}\n'
    file = f'<{origin.__qualname__}: {" ".join(source.split())}>'
    # Warp reads the source of the functions that it compiles
    linecache.cache[file] = len(source), None, source.splitlines(True), file
    found = {**names, 'types': types, '__name__': origin.__module__}
    exec(compile(source, file, 'exec'), found)
    return found[origin.__name__]


def on_cuda(snippet: str, otherwise: str) -> str:
    """Return C++ of a device function: a snippet for CUDA, and another one for the CPU."""
    return f'#if defined(__CUDA_ARCH__)\n{snippet}\n#else\n    {otherwise}\n#endif\n'


def callable_name(function: Any) -> str:
    """Give a device function the name by which C++ calls it, and return that.

    Warp numbers all functions of a process. With such a number in its source a kernel would be
    compiled again in each process that has made other functions before.
    """
    function.native_func = f'called_{function.func.__name__}'
    return str(function.native_func)


@wp.func_native(_WAIT)
def after_previous_kernel():
    """Wait for the preceding kernels, until their writes are visible."""


@lru_cache
def access(real: Any, length: int) -> tuple[Any, Any]:
    """Return the device functions that read and write item i of an array of vec2 or vec4.

    An array that is read must be read-only for the kernel.
    """
    vector = wp.types.vector(length, real)
    wide, count = _WIDE[real, length]
    size = length // count
    loads = ', '.join(f'v{n} = __ldg(from + {n})' for n in range(count))
    numbers = ', '.join(f'v{n}.{axis}' for n in range(count) for axis in 'xyzw'[:size])
    stores = (
        f'to[{n}] = make_{wide}({", ".join(f"v[{size * n + m}]" for m in range(size))});'
        for n in range(count)
    )
    read = f"""
    const {wide}* from = reinterpret_cast<const {wide}*>(values.data) + {count} * i;
    const {wide} {loads};
    return wp::vec_t<{length}, wp::{real.__name__}>({numbers});"""
    write = f"""
    {wide}* to = reinterpret_cast<{wide}*>(values.data) + {count} * i;
    {' '.join(stores)}"""

    @wp.func_native(on_cuda(read, 'return values.data[i];'))
    def load(values: wp.array(dtype=vector), i: int) -> vector: ...

    @wp.func_native(on_cuda(write, 'values.data[i] = v;'))
    def store(values: wp.array(dtype=vector), i: int, v: vector): ...

    return load, store


@lru_cache
def load1(kind: Any) -> Any:
    """Return the device function that reads item i >= 0 of a read-only array."""

    @wp.func_native(on_cuda('return __ldg(values.data + i);', 'return values.data[i];'))
    def load(values: wp.array(dtype=kind), i: int) -> kind: ...

    return load


#: Device function that reads item i >= 0 of a read-only array of integers.
load_int = load1(wp.int32)


@wp.func_native(on_cuda(_LOAD_UNCACHED, 'return values.data[i];'))
def load_uncached(values: wp.array(dtype=wp.int32), i: int) -> int:
    """Read item i >= 0 of an array that other threads may change; a device function.

    It bypasses the cache, which could otherwise keep outdated values of adjacent items.
    """


@wp.func_native(on_cuda('return blockIdx.x * blockDim.x + threadIdx.x;', 'return first + i;'))
def counted_from(first: int, i: int) -> int:
    """Return the number of thread i, which on the CPU counts from ``first`` (threads.py).

    CUDA computes it directly: Warp's own number takes a look-up for arrays of any shape.
    """


@wp.func_native(on_cuda('return blockIdx.x;', 'return i / size;'))
def block_number(size: int, i: int) -> int:
    """Return the number of the block that contains thread i, for blocks of a size."""


@wp.func_native(on_cuda('return threadIdx.x;', 'return i % size;'))
def number_in_block(size: int, i: int) -> int:
    """Return the number of thread i within its block."""


@wp.func_native(_ANNOUNCE)
def announce(flag: wp.array(dtype=wp.int32)):
    """Publish the writes of the first thread to all threads of a CUDA kernel.

    All threads of the first block must call it. ``flag`` is 0 before and 1 after.
    """


@wp.func_native(_WAIT_FOR)
def wait_for(flag: wp.array(dtype=wp.int32)):
    """Wait for ``announce``.

    Before it, the announced values may be read only with ``load_uncached``.
    """


@lru_cache
def sum_over(real: Any, lanes: int) -> Any:
    """Return the device function that sums a value over the threads that share a particle."""

    @wp.func_native(_SUM.replace('LANES', str(lanes)))
    def total(value: real) -> real: ...

    @wp.func
    def itself(value: real) -> real:
        return value

    return itself if lanes == 1 else total


@lru_cache
def raise_to(real: Any) -> Any:
    """Return the device function that raises item i of an array to a value, if it is larger."""

    @wp.func_native(_RAISE[real].replace('RAISE_ON_CPU', _RAISE_ON_CPU))
    def raised(values: wp.array(dtype=real), i: int, value: real): ...

    return raised
