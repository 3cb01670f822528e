# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Kernels of a graph that begin before those they come after have ended.

Between two kernels a GPU is idle for a microsecond: the first one's results are written, the next
one's threads are started. With few particles a stage is little else. NVIDIA's programmatic
dependent launch lets the next one start where the first one's threads leave room, and wait there
(``compiled.after_the_former``) until all that is written can be read. In a graph that is a kind
of edge between two nodes, which Warp does not make: here the edges to kernels that wait are
replaced by such. Graphs that allocate memory cannot be changed and stay as they are.
"""

from collections.abc import Collection
import ctypes
from functools import lru_cache
from itertools import chain
from typing import Any

#: Compute capability from which on GPUs know it.
_LEAST_ARCH = 90

#: Numbers of the driver: success, a kernel among the nodes of a graph, and
#: the port and the type of an edge for programmatic launches.
_SUCCESS = 0
_KERNEL_NODE = 0
_PROGRAMMATIC = 1

#: What Warp appends to a kernel's name.
_ENDING = '_cuda_kernel_forward'


class _EdgeData(ctypes.Structure):
    """CUgraphEdgeData."""

    _fields_ = (
        ('from_port', ctypes.c_ubyte),
        ('to_port', ctypes.c_ubyte),
        ('type', ctypes.c_ubyte),
        ('reserved', ctypes.c_ubyte * 5),
    )


class _KernelParams(ctypes.Structure):
    """CUDA_KERNEL_NODE_PARAMS_v2."""

    _fields_ = (
        ('function', ctypes.c_void_p),
        ('dimensions', ctypes.c_uint * 7),
        ('params', ctypes.c_void_p),
        ('extra', ctypes.c_void_p),
        ('kernel', ctypes.c_void_p),
        ('context', ctypes.c_void_p),
    )


def overlap(graph: Any, kernels: Collection[Any]) -> int:
    """Let kernels of a captured graph start before those that they come after have ended.

    They are those of ``compiled.quick_kernel``; others wait for the end of what is before them.
    Warp's ``graph`` has not been launched yet.

    Returns:
        How many edges of the graph were replaced; 0 where the GPU or its driver cannot do it.

    Raises:
        RuntimeError: The driver leaves an edge neither as it was nor as it should be.
    """
    driver = _driver()
    if driver is None or graph.device.arch < _LEAST_ARCH:
        return 0
    names = {kernel.get_mangled_name() for kernel in kernels}
    edges, replaced = _edges(driver, graph.graph), 0
    found = {node: _kernel_name(driver, node) for node in chain.from_iterable(edges)}
    for before, after in edges:
        name = found[after]
        if found[before] is None or name is None or name.removesuffix(_ENDING) not in names:
            continue
        plain = _EdgeData()
        if not _change(driver, 'Remove', graph.graph, before, after, plain):
            break
        early = _EdgeData(from_port=_PROGRAMMATIC, type=_PROGRAMMATIC)
        if _change(driver, 'Add', graph.graph, before, after, early):
            replaced += 1
        elif not _change(driver, 'Add', graph.graph, before, after, plain):
            raise RuntimeError('an edge of a CUDA graph is lost')
    return replaced


@lru_cache
def _driver() -> Any:
    """CUDA's driver, if it knows graphs with such edges."""
    try:
        driver = ctypes.CDLL('libcuda.so.1')
        for name in ('GraphGetEdges_v2', 'GraphAddDependencies_v2', 'FuncGetName'):
            getattr(driver, f'cu{name}')
    except (OSError, AttributeError):
        return None
    return driver


def _edges(driver: Any, graph: Any) -> list[tuple[int, int]]:
    """Nodes at both ends of each edge; none where the driver does not say."""
    count = ctypes.c_size_t(0)
    if driver.cuGraphGetEdges_v2(graph, None, None, None, ctypes.byref(count)) != _SUCCESS:
        return []
    nodes = [(ctypes.c_void_p * count.value)() for _ in range(2)]
    data = (_EdgeData * count.value)()
    if driver.cuGraphGetEdges_v2(graph, *nodes, data, ctypes.byref(count)) != _SUCCESS:
        return []
    # what is more than an order already stays
    return [
        (before, after)
        for before, after, one in zip(*nodes, data, strict=True)
        if before and after and one.type == 0
    ]


def _kernel_name(driver: Any, node: int) -> str | None:
    """Name of a node's kernel; None for other nodes."""
    kind = ctypes.c_int(-1)
    driver.cuGraphNodeGetType(ctypes.c_void_p(node), ctypes.byref(kind))
    if kind.value != _KERNEL_NODE:
        return None
    params, name = _KernelParams(), ctypes.c_char_p()
    driver.cuGraphKernelNodeGetParams_v2(ctypes.c_void_p(node), ctypes.byref(params))
    if params.function:
        driver.cuFuncGetName(ctypes.byref(name), ctypes.c_void_p(params.function))
    return (name.value or b'').decode()


def _change(driver: Any, what: str, graph: Any, before: int, after: int, data: _EdgeData) -> bool:
    """Add or remove an edge, if the driver does."""
    ends = [(ctypes.c_void_p * 1)(node) for node in (before, after)]
    function = getattr(driver, f'cuGraph{what}Dependencies_v2')
    code = function(graph, *ends, ctypes.byref(data), ctypes.c_size_t(1))
    return bool(code == _SUCCESS)
