# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Launches that are repeated with the same arguments, and graphs whose kernels may start early.

Warp takes 40 microseconds to check and pack the arguments of a launch, longer than a CPU takes to
process some hundred particles. With packed arguments a launch takes 15, and in a graph less than
1. All launches of a stage are therefore captured and replayed as a graph.

Between two kernels a GPU is idle for a microsecond while the results of the first are written and
the threads of the second are started. With few particles, most of a stage is such idle time.
NVIDIA's programmatic dependent launch starts the second kernel where threads of the first have
finished, and lets it wait there (``compiled.after_previous_kernel``) until all results are
readable. In a graph this is a type of edge between two nodes, which Warp does not create:
``overlap`` replaces the edges to kernels that can wait. Graphs that allocate memory cannot be
changed and stay as is.
"""

from collections.abc import Callable, Collection, Sequence
import ctypes
from functools import lru_cache, partial
from itertools import chain
import threading
from typing import Any, NamedTuple

import warp as wp

#: Maximum number of cached packed launches; they keep their arrays alive.
MAX_CACHED = 256

#: Held while a graph is captured and while a thread waits for an event: Warp refuses to wait
#: during a capture, even by another thread.
capture_lock = threading.Lock()

#: Minimum compute capability of a GPU that supports programmatic launches.
_MIN_ARCH = 90

#: Constants of the driver: success, a kernel among the nodes of a graph, and the port and type of
#: an edge for programmatic launches.
_SUCCESS = 0
_KERNEL_NODE = 0
_PROGRAMMATIC = 1

#: Suffix that Warp appends to a kernel's name.
_ENDING = '_cuda_kernel_forward'


class Launch(NamedTuple):
    """One launch of a ``compiled.quick_kernel``, with the parameters of ``Launches``."""

    kernel: Any
    dim: int
    block_dim: int | None
    is_over_particles: bool
    arguments: list[Any]


class Launches:
    """The launches of a device. On a CPU they are cached in packed form.

    Arguments are cached by identity, not by value. Do not modify a struct after launching with it.

    Attributes:
        extent: Maximum number of particles that the captured launches process.
        forgotten: Number of calls of ``forget``; anything recorded before the last one is invalid.
        launched: Number of launches by this object; None once a batch launches what it recorded.
    """

    def __init__(self, device: Any) -> None:
        """Initialize without any recorded launch."""
        self._device = device
        self._packed: dict[tuple[int, ...], list[Any]] = {}
        self._again: Callable[[], None] | None = None
        self._recorded: list[Launch] | None = None
        self._captured: set[Any] = set()
        self.extent = self.forgotten = 0
        self.launched: int | None = 0

    @property
    def is_capturing(self) -> bool:
        """Return True while CPU launches are recorded, for ``extent`` particles."""
        return self._recorded is not None

    def can_replay(self, extent: int) -> bool:
        """Return True if ``replay`` has launches for this number of particles."""
        return self._again is not None and extent <= self.extent

    def capture(self, launch: Callable[[], None], extent: int) -> None:
        """Capture what a function launches, without launching it, for ``replay``.

        On a GPU this takes all its launches, on a CPU those through this object. They process at
        most ``extent`` particles.
        """
        self._again, self.extent = None, extent
        self._captured.clear()
        recorded = [] if self._device.is_cuda else self.record(launch, extent)
        with capture_lock, wp.ScopedCapture(device=self._device) as capture:
            if self._device.is_cuda:
                launch()
            for one in recorded:
                if one.dim > 0:
                    arguments = [*one.arguments, 0]
                    wp.launch(one.kernel, dim=one.dim, inputs=arguments, device=self._device)
        if self._device.is_cuda:
            overlap(capture.graph, self._captured)
        self._again = partial(wp.capture_launch, capture.graph)

    def record(self, launch: Callable[[], None], extent: int) -> list[Launch]:
        """Return the launches of a function for ``extent`` particles, without running them."""
        recorded = self._recorded = list[Launch]()
        self.extent = extent
        try:
            launch()
        finally:
            self._recorded = None
        return recorded

    def replay(self) -> None:
        """Launch what ``capture`` has recorded."""
        assert self._again is not None
        self.note_launch()
        self._again()

    def note_launch(self) -> None:
        """Count a launch, or another change of the arrays of a state."""
        if self.launched is not None:
            self.launched += 1

    def __call__(
        self, kernel: Any, arguments: Sequence[Any], *, dim: int = 1, block_dim: int | None = None,
        is_over_particles: bool = False,
    ) -> None:
        """Launch the first ``dim`` threads of a ``compiled.quick_kernel``.

        ``block_dim`` is the number of threads per GPU block, by default Warp's own.
        ``is_over_particles`` means that the last threads may have no particle yet, and no work.
        """
        if self._recorded is not None:
            launch = Launch(kernel, dim, block_dim, is_over_particles, [*arguments])
            self._recorded.append(launch)
        elif self._device.is_cuda:
            self.note_launch()
            self._captured.add(kernel)
            wp.launch(kernel, dim, [*arguments, 0], device=self._device, block_dim=block_dim)
        elif dim > 0:
            self.packed(kernel, [*arguments, 0], dim=dim).launch()

    def packed(self, kernel: Any, arguments: list[Any], *, dim: int) -> Any:
        """Return a packed CPU launch; its ``launch()`` runs it."""
        self.note_launch()
        key = (id(kernel), *map(id, arguments))
        packed = self._packed.get(key)
        if packed is None:
            if len(self._packed) >= MAX_CACHED:
                self._packed.clear()
            # as long as they are kept alive no other object can have their ids
            command = wp.launch(
                kernel, dim=dim, inputs=arguments, device=self._device, record_cmd=True
            )
            packed = self._packed[key] = [dim, command, kernel, arguments]
        if packed[0] != dim:
            packed[1].set_dim(dim)
            packed[0] = dim
        return packed[1]

    def forget(self) -> None:
        """Drop all cached launches and their arrays, which may have been replaced."""
        self._packed.clear()
        self._again = None
        self.forgotten += 1


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
    """Let kernels of a captured graph start before their predecessors have ended.

    Only those in ``kernels`` (of ``compiled.quick_kernel``) do; other nodes wait until all
    predecessors have ended. Call this before Warp's ``graph`` is first launched.

    Returns:
        Number of replaced edges of the graph; 0 if the GPU or its driver does not support it.

    Raises:
        RuntimeError: If the driver removes an edge and can neither replace nor restore it.
    """
    driver = _driver()
    if driver is None or graph.device.arch < _MIN_ARCH:
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
    """Return CUDA's driver library, or None if it does not support such edges."""
    try:
        driver = ctypes.CDLL('libcuda.so.1')
        for name in ('GraphGetEdges_v2', 'GraphAddDependencies_v2', 'FuncGetName'):
            getattr(driver, f'cu{name}')
    except (OSError, AttributeError):
        return None
    return driver


def _edges(driver: Any, graph: Any) -> list[tuple[int, int]]:
    """Return the nodes at both ends of each edge; empty if the driver does not report them."""
    count = ctypes.c_size_t(0)
    if driver.cuGraphGetEdges_v2(graph, None, None, None, ctypes.byref(count)) != _SUCCESS:
        return []
    nodes = [(ctypes.c_void_p * count.value)() for _ in range(2)]
    data = (_EdgeData * count.value)()
    if driver.cuGraphGetEdges_v2(graph, *nodes, data, ctypes.byref(count)) != _SUCCESS:
        return []
    # edges that already do more than order two nodes are not changed
    return [
        (before, after)
        for before, after, one in zip(*nodes, data, strict=True)
        if before and after and one.type == 0
    ]


def _kernel_name(driver: Any, node: int) -> str | None:
    """Return the name of a node's kernel; None for other nodes."""
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
    """Add or remove an edge; return True if the driver accepted."""
    ends = [(ctypes.c_void_p * 1)(node) for node in (before, after)]
    function = getattr(driver, f'cuGraph{what}Dependencies_v2')
    code = function(graph, *ends, ctypes.byref(data), ctypes.c_size_t(1))
    return bool(code == _SUCCESS)
