# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""How the kernels of a stage are compiled, and the few words that only the hardware knows.

What is done, why, and what it gains is in docs/PERFORMANCE.md:

* ``quick_kernel``: no loop over the grid (a thread has one particle, or its own loop), no adjoint,
  and on CUDA the hardware's own division, root and exponential in float32. Those are good to 2e-7,
  as is float32; a float64 is not touched by it, so the reference is not either.
* ``load4``, ``store4``: Warp knows no alignment and reads a vec4 as four numbers; here it is one
  access to 16 bytes. Reads go through the read-only cache: never read so what the kernel writes.
* ``after_the_former``: a kernel may begin before the one that it comes after has ended.
* ``unseen_one``: a step of a loop that no compiler unrolls further, for threads of a warp whose
  loops have different ends: what is left over of an unrolled one takes as long as the rest.
* ``announce``, ``wait_for``: what one thread does with what all have found needs no launch of its
  own, and is done while the others are at work that does not need it yet.
* ``cos_pi``, ``sin_pi``: of a float64 in half turns, which needs no table for large angles.
* ``raise_to``: a maximum over all particles. Each thread comparing and swapping one address is
  slower than the rest of the kernel; a warp of 32 finds its own maximum and asks once.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from inspect import signature
import linecache
from typing import Any

import warp as wp

# Warp reports every kernel it loads on stdout, where commands print their results.
wp.config.log_level = wp.LOG_WARNING

#: CUDA's type for some numbers that are read or written at once, and how often a vector has it.
_WIDE = {
    (wp.float32, 2): ('float2', 1),
    (wp.float32, 4): ('float4', 1),
    (wp.float64, 2): ('double2', 1),
    (wp.float64, 4): ('double2', 2),
}
#: Strides of a 2-D array are bytes.
_PATCH = """
    wp::mat_t<3, 3, NUMBER> patch;
    for (int n = 0; n < 3; ++n) {
        const NUMBER* row = reinterpret_cast<const NUMBER*>(
            reinterpret_cast<const char*>(values.data) + size_t(i + n) * values.strides[0]) + j;
        for (int m = 0; m < 3; ++m) {
#if defined(__CUDA_ARCH__)
            patch.data[n][m] = __ldg(row + m);
#else
            patch.data[n][m] = row[m];
#endif
        }
    }
    return patch;
"""
#: The threads of a particle are neighbours in a warp, and all of them are there.
_SUM = """
#if defined(__CUDA_ARCH__)
    const unsigned mask = ((1u << LANES) - 1u) << (threadIdx.x & 31u & ~(LANES - 1u));
    for (int apart = LANES / 2; apart > 0; apart /= 2)
        value += __shfl_xor_sync(mask, value, apart);
#endif
    return value;
"""
#: The hardware cuts a sum off at 0 and 1, which the compiler does not see.
_ONE_LESS = """
    float left;
    asm("fma.rn.ftz.sat.f32 %0, %1, %2, %3;" : "=f"(left) : "f"(-a), "f"(b), "f"(1.0f));
    return left;"""
_PAST_THE_CACHE = """
    int v;
    asm volatile("ld.relaxed.gpu.global.s32 %0, [%1];" : "=r"(v) : "l"(values.data + i));
    return v;
"""
#: Of the first block, which is started before any that waits for it. The fence also empties the
#: cache that it shares with others.
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
#: What those before have written can be read after it; only later GPUs begin before.
_WAIT = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    asm volatile("griddepcontrol.wait;" ::: "memory");
#endif
"""
#: What is no number raises nothing: positive floats are in the order of their bits.
_RAISE = {
    wp.float32: """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    const unsigned mask = __activemask();
    const unsigned bits = value > 0.0f ? __float_as_uint(value) : 0u;
    const unsigned most = __reduce_max_sync(mask, bits);
    unsigned* place = reinterpret_cast<unsigned*>(values.data + i);
    if ((threadIdx.x & 31u) == static_cast<unsigned>(__ffs(mask)) - 1u && most > __ldcg(place))
        atomicMax(place, most);
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
#: Warp's own is none for the threads of a CPU (threads.py).
_RAISE_ON_CPU = """
    auto most = values.data[i];
    __atomic_load(values.data + i, &most, __ATOMIC_RELAXED);
    while (value > most && !__atomic_compare_exchange(
        values.data + i, &most, &value, true, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {}
"""


#: Threads of a block, and how many blocks a processor has to hold of kernels of few threads. The
#: compiler would spare registers for more of them, and wait for each load before the next.
FEW_THREADS = 256, 4


def quick_kernel(
    function: Callable[..., None] | None = None,
    *,
    bounds: tuple[int, int] | None = None,
    fast_math: bool = True,
) -> Any:
    """Make a kernel of a function of the thread's number and more arguments; a decorator.

    The kernel takes the number of its first thread on a CPU (threads.py) as one more, the last.
    ``bounds`` are the threads of a block, and the blocks that a processor of a GPU must have
    registers for; ``fast_math`` lets CUDA compute float32 by the hardware's own functions.
    """
    if function is None:
        return partial(quick_kernel, bounds=bounds, fast_math=fast_math)
    _, *names = signature(function).parameters
    types = {name: function.__annotations__[name] for name in names}
    write = partial(_kernel_of, wp.func(function), function, bounds, fast_math)
    kernel = write(
        types | {'first': int},
        'thread = counted_from(first, wp.tid())',
        'after_the_former()',
        f'body(thread, {", ".join(names)})',
    )
    kernel.for_many = lru_cache(partial(_for_many, write, function, types))
    return kernel


def _for_many(
    write: Callable[..., Any], function: Callable[..., None], types: Mapping[str, Any],
    size: int, takes_turns: bool,
) -> tuple[Any, Any]:
    """Return the Warp struct of a member's arguments, and the kernel for many members at once.

    The kernel takes an array of them, and for each block of ``size`` threads the number of its
    member, its first thread and the end of its threads, each -1 where there is none. Where it
    ``takes_turns`` a block may have more threads than these: a large function needs more registers
    then.
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
        'after_the_former()',
        # no thread is before the end where there is no member
        f'{"while" if takes_turns else "if"} thread < block[2]:',
        '    member = members[block[0]]',
        f'    body(thread, {", ".join(f"member.{name}" for name in types)})',
        f'    thread += {size}',
    )
    # one that was compiled before with the same code has a struct of its own
    return kernel.adj.args[0].type.dtype, kernel


def _kernel_of(
    body: Any,
    function: Callable[..., None],
    bounds: tuple[int, int] | None,
    fast_math: bool,
    types: Mapping[str, Any],
    *lines: str,
) -> Any:
    """Write a kernel of a function: what it takes, by name, and the lines that call it."""
    heading = ', '.join(f'{name}: types["{name}"]' for name in types)
    source = '\n    '.join((f'def {function.__name__}({heading}):', *lines)) + '\n'
    file = f'<{function.__qualname__}: {source}>'
    # Warp reads the source of what it compiles
    linecache.cache[file] = len(source), None, source.splitlines(True), file
    found = globals() | {'types': types, 'body': body, '__name__': function.__module__}
    exec(compile(source, file, 'exec'), found)
    return wp.kernel(
        found[function.__name__],
        module='unique',
        enable_backward=False,
        grid_stride=False,
        launch_bounds=bounds,
        module_options={'fast_math': fast_math, 'enable_backward': False},
    )


def _on_cuda(snippet: str, otherwise: str) -> str:
    return f'#if defined(__CUDA_ARCH__)\n{snippet}\n#else\n    {otherwise}\n#endif\n'


@wp.func_native(_WAIT)
def after_the_former():
    """Wait for the kernels that this one comes after, and for what they have written."""


@lru_cache
def _access(real: Any, length: int) -> tuple[Any, Any]:
    """Return the device functions that read and write item i of an array of vectors."""
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

    @wp.func_native(_on_cuda(read, 'return values.data[i];'))
    def load(values: wp.array(dtype=vector), i: int) -> vector: ...

    @wp.func_native(_on_cuda(write, 'values.data[i] = v;'))
    def store(values: wp.array(dtype=vector), i: int, v: vector): ...

    return load, store


def load4(real: Any) -> Any:
    """Return the device function that reads item i of an array of vec4, which nothing writes."""
    return _access(real, 4)[0]


def store4(real: Any) -> Any:
    """Return the device function that writes item i of an array of vec4."""
    return _access(real, 4)[1]


def load2(real: Any) -> Any:
    """Return the device function that reads item i of an array of vec2, which nothing writes."""
    return _access(real, 2)[0]


def store2(real: Any) -> Any:
    """Return the device function that writes item i of an array of vec2."""
    return _access(real, 2)[1]


@lru_cache
def load1(kind: Any) -> Any:
    """Return the device function that reads item i >= 0 of an array, which nothing writes."""

    @wp.func_native(_on_cuda('return __ldg(values.data + i);', 'return values.data[i];'))
    def load(values: wp.array(dtype=kind), i: int) -> kind: ...

    return load


#: That of integers.
load_int = load1(wp.int32)


@wp.func_native(_on_cuda(_PAST_THE_CACHE, 'return values.data[i];'))
def past_the_cache(values: wp.array(dtype=wp.int32), i: int) -> int:
    """Read item i >= 0 of an array whose items others may change meanwhile; a device function.

    What lies beside it is not kept in the cache as it is now.
    """


@wp.func_native(
    _on_cuda('return blockIdx.x * blockDim.x + threadIdx.x;', 'return first + i;')
)
def counted_from(first: int, i: int) -> int:
    """Return the number of the thread i, on the CPU in a launch from ``first`` on (threads.py).

    On CUDA it counts itself: Warp's number is looked up as that of an array of any shape.
    """


@wp.func_native(_on_cuda('return blockIdx.x;', 'return i / size;'))
def block_number(size: int, i: int) -> int:
    """Return the number of the block of the thread i, of blocks of a size."""


@wp.func_native(_on_cuda('return threadIdx.x;', 'return i % size;'))
def number_in_block(size: int, i: int) -> int:
    """Return the number of the thread i in its block."""


@wp.func_native(_on_cuda('return blockDim.y;', 'return 1;'))
def unseen_one() -> int:
    """Return 1, which the compiler cannot know: it would unroll what is unrolled already."""


@wp.func_native(_on_cuda('return true;', 'return false;'))
def can_count() -> bool:
    """Whether many threads may count together: on the CPU Warp's atomics are none."""


@wp.func_native(_on_cuda('return __syncthreads_or(value);', 'return value;'))
def any_in_block(value: bool) -> bool:
    """Wait for all threads of a block, and say whether a value is true in any; a device function.

    What they have written before can be read then. On the CPU a block is one thread.
    """
    ...


@lru_cache
def load9(real: Any) -> Any:
    """Return the device function that reads rows i to i + 2, columns j to j + 2 of a 2-D array."""
    mat33 = wp.types.matrix((3, 3), real)

    @wp.func_native(_PATCH.replace('NUMBER', f'wp::{real.__name__}'))
    def load(values: wp.array2d(dtype=real), i: int, j: int) -> mat33: ...

    return load


@wp.func_native(_ANNOUNCE)
def announce(flag: wp.array(dtype=wp.int32)):
    """Let all threads of a CUDA kernel see what the first one has written.

    All threads of the first block have to come here. ``flag`` is 0 before and 1 after.
    """


@wp.func_native(_WAIT_FOR)
def wait_for(flag: wp.array(dtype=wp.int32)):
    """Wait for ``announce``.

    What was announced must not have been read before but by ``past_the_cache``.
    """


@wp.func_native(_on_cuda('return cospi(x);', 'return wp::cos(3.141592653589793 * x);'))
def cos_pi(x: wp.float64) -> wp.float64:
    """Return cos(pi x); a device function."""


@wp.func_native(_on_cuda('return sinpi(x);', 'return wp::sin(3.141592653589793 * x);'))
def sin_pi(x: wp.float64) -> wp.float64:
    """Return sin(pi x); a device function."""


@lru_cache
def one_less(real: Any) -> Any:
    """Return the device function max(1 - a b, 0), of a and b >= 0: one instruction of float32."""
    plain = 'return a * b < 1 ? 1 - a * b : 0;'

    @wp.func_native(_on_cuda(_ONE_LESS, plain) if real is wp.float32 else plain)
    def left(a: real, b: real) -> real: ...

    return left


@lru_cache
def exp2(real: Any) -> Any:
    """Return the device function 2^x."""
    cuda = 'return exp2f(x);' if real is wp.float32 else 'return exp2(x);'
    log2 = f'wp::{real.__name__}(0.6931471805599453)'

    @wp.func_native(_on_cuda(cuda, f'return wp::exp({log2} * x);'))
    def power(x: real) -> real: ...

    return power


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
    """Return the device function that raises item i of an array to a value, if that is larger."""

    @wp.func_native(_RAISE[real].replace('RAISE_ON_CPU', _RAISE_ON_CPU))
    def raised(values: wp.array(dtype=real), i: int, value: real): ...

    return raised
