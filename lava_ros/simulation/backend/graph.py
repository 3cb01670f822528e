# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Launches that are repeated with the same arguments.

Warp takes 40 microseconds to check and pack the arguments of a launch, longer than a CPU takes to
process some hundred particles. With packed arguments a launch takes 15. All launches of a stage
can be recorded and replayed: on a GPU as a CUDA graph, on a CPU as a list of compiled functions,
each called with its packed arguments in less than 1 microsecond.
"""

from collections.abc import Callable, Sequence
import ctypes
from functools import lru_cache, partial
from typing import Any, NamedTuple

import warp as wp

from lava_ros.simulation.backend.programmatic_launch import overlap
from lava_ros.simulation.backend.streams import capture_lock

#: Maximum number of cached packed launches; they keep their arrays alive.
MOST = 256


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
    """

    def __init__(self, device: Any) -> None:
        """Initialize without any recorded launch."""
        self._device = device
        self._kept: dict[tuple[int, ...], list[Any]] = {}
        self._again: Callable[[], None] | None = None
        self._taken_down: list[Launch] | None = None
        self._captured: set[Any] = set()
        self.extent = self.forgotten = 0

    @property
    def is_capturing(self) -> bool:
        """Return True while CPU launches are recorded, for ``extent`` particles."""
        return self._taken_down is not None

    def can_replay(self, extent: int) -> bool:
        """Return True if ``replay`` has launches for this number of particles."""
        return self._again is not None and extent <= self.extent

    def capture(self, launch: Callable[[], None], extent: int) -> None:
        """Record what a function launches, without launching it, for ``replay``.

        On a GPU this records all its launches, on a CPU those through this object. They process at
        most ``extent`` particles.
        """
        self._again, self.extent = None, extent
        if self._device.is_cuda:
            self._captured.clear()
            with capture_lock, wp.ScopedCapture(device=self._device) as capture:
                launch()
            overlap(capture.graph, self._captured)
            self._again = partial(wp.capture_launch, capture.graph)
            return
        self._again = partial(_call, [
            _compiled(self._record(one.kernel, one.dim, [*one.arguments, 0]))
            for one in self.taken_down(launch, extent)
            if one.dim > 0
        ])

    def taken_down(self, launch: Callable[[], None], extent: int) -> list[Launch]:
        """Return what a function launches through here for ``extent`` particles, unlaunched."""
        taken_down = self._taken_down = list[Launch]()
        self.extent = extent
        try:
            launch()
        finally:
            self._taken_down = None
        return taken_down

    def replay(self) -> None:
        """Launch what ``capture`` has recorded."""
        assert self._again is not None
        self._again()

    def __call__(
        self,
        kernel: Any,
        arguments: Sequence[Any],
        *,
        dim: int = 1,
        block_dim: int | None = None,
        is_over_particles: bool = False,
    ) -> None:
        """Launch the first ``dim`` threads of a ``compiled.quick_kernel``.

        ``block_dim`` is the number of threads per GPU block, by default Warp's own.
        ``is_over_particles`` means that the last threads may have no particle yet, and no work.
        """
        if self._taken_down is not None:
            launch = Launch(kernel, dim, block_dim, is_over_particles, [*arguments])
            self._taken_down.append(launch)
        elif self._device.is_cuda:
            self._captured.add(kernel)
            wp.launch(kernel, dim, [*arguments, 0], device=self._device, block_dim=block_dim)
        elif dim > 0:
            self.packed(kernel, [*arguments, 0], dim=dim).launch()

    def packed(self, kernel: Any, arguments: list[Any], *, dim: int) -> Any:
        """Return a packed CPU launch; its ``launch()`` runs it."""
        key = (id(kernel), *map(id, arguments))
        kept = self._kept.get(key)
        if kept is None:
            if len(self._kept) >= MOST:
                self._kept.clear()
            # as long as they are kept alive no other object can have their ids
            kept = [dim, self._record(kernel, dim, arguments), kernel, arguments]
            self._kept[key] = kept
        if kept[0] != dim:
            kept[1].set_dim(dim)
            kept[0] = dim
        return kept[1]

    def forget(self) -> None:
        """Drop all cached launches and their arrays, which may have been replaced."""
        self._kept.clear()
        self._again = None
        self.forgotten += 1

    def _record(self, kernel: Any, dim: int, arguments: list[Any]) -> Any:
        return wp.launch(kernel, dim=dim, inputs=arguments, device=self._device, record_cmd=True)


@lru_cache
def _arguments(*types: Any) -> Any:
    """Return the structure in which a compiled function takes arguments of these ctypes."""
    fields = [(f'argument_{n}', one) for n, one in enumerate(types)]
    return type('Arguments', (ctypes.Structure,), {'_fields_': fields})


def _compiled(command: Any) -> tuple[Any, tuple[Any, ...], Any]:
    """Return the function that a CPU launch calls, its arguments, and an object to keep alive.

    Warp's own ``launch()`` calls the same function but packs the arguments again each time.
    """
    try:
        bounds, *values = command.params
        arguments = _arguments(*map(type, values))()
        for n, value in enumerate(values):
            setattr(arguments, f'argument_{n}', value)
        return command.hooks.forward, (ctypes.byref(bounds), ctypes.byref(arguments)), command
    except (AttributeError, TypeError):
        # this version of Warp packs in another way
        return command.launch, (), command


def _call(calls: list[tuple[Any, tuple[Any, ...], Any]]) -> None:
    for function, arguments, _ in calls:
        function(*arguments)
