# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Launches that are made again and again with the same arguments.

Warp takes 40 microseconds to look at the arguments of a launch and to pack them, longer than a CPU
takes for what some hundred particles do in it. Packed once, a launch takes 15. What a stage
launches can be taken down whole and made again: a GPU has its graphs for that, and on a CPU it is
a list of compiled functions, each called with what was packed for it, in less than 1.
"""

from collections.abc import Callable, Sequence
import ctypes
from functools import lru_cache, partial
from typing import Any, NamedTuple

import warp as wp

from lava_ros.simulation.backend.programmatic_launch import overlap
from lava_ros.simulation.backend.streams import capture_lock

#: Packed launches that are kept; they keep their arrays too.
MOST = 256


class Launch(NamedTuple):
    """A launch of a ``compiled.quick_kernel``, as ``Launches`` takes it."""

    kernel: Any
    dim: int
    block_dim: int | None
    is_over_particles: bool
    arguments: list[Any]


class Launches:
    """The launches of a device. On a CPU they are kept as they were packed.

    Arguments are told by what they are, not by what is in them: a struct that was launched with
    must not be changed afterwards.

    Attributes:
        extent: Particles that what was captured takes.
        forgotten: How often ``forget`` was called: what was taken down before is of no use.
    """

    def __init__(self, device: Any) -> None:
        """Begin without any."""
        self._device = device
        self._kept: dict[tuple[int, ...], list[Any]] = {}
        self._again: Callable[[], None] | None = None
        self._taken_down: list[Launch] | None = None
        self._captured: set[Any] = set()
        self.extent = self.forgotten = 0

    @property
    def is_capturing(self) -> bool:
        """Whether launches on a CPU are taken down, for as many particles as ``extent`` says."""
        return self._taken_down is not None

    def can_replay(self, extent: int) -> bool:
        """Whether there is something for ``replay``, and it takes as many particles."""
        return self._again is not None and extent <= self.extent

    def capture(self, launch: Callable[[], None], extent: int) -> None:
        """Take down what a function launches, in place of launching it, for ``replay``.

        On a GPU that is all that it does there, on a CPU all that goes through here. It takes
        ``extent`` particles at most.
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
        """What a function launches through here for ``extent`` particles, and is not launched."""
        taken_down = self._taken_down = list[Launch]()
        self.extent = extent
        try:
            launch()
        finally:
            self._taken_down = None
        return taken_down

    def replay(self) -> None:
        """Launch what was captured."""
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
        """Launch some threads of a ``compiled.quick_kernel``, from its first one on.

        ``block_dim`` is the threads to a block of a GPU, Warp's own number when left out.
        ``is_over_particles`` says that the last threads have no particle yet, and nothing to do.
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
        """A launch of some threads on the CPU that is made by its ``launch()``."""
        key = (id(kernel), *map(id, arguments))
        kept = self._kept.get(key)
        if kept is None:
            if len(self._kept) >= MOST:
                self._kept.clear()
            # as long as they are here nothing else has their numbers
            kept = [dim, self._record(kernel, dim, arguments), kernel, arguments]
            self._kept[key] = kept
        if kept[0] != dim:
            kept[1].set_dim(dim)
            kept[0] = dim
        return kept[1]

    def forget(self) -> None:
        """Keep none any more, nor their arrays: those that are there now may be others."""
        self._kept.clear()
        self._again = None
        self.forgotten += 1

    def _record(self, kernel: Any, dim: int, arguments: list[Any]) -> Any:
        return wp.launch(kernel, dim=dim, inputs=arguments, device=self._device, record_cmd=True)


@lru_cache
def _arguments(*types: Any) -> Any:
    """The structure in which a compiled function takes arguments of some ctypes."""
    fields = [(f'argument_{n}', one) for n, one in enumerate(types)]
    return type('Arguments', (ctypes.Structure,), {'_fields_': fields})


def _compiled(command: Any) -> tuple[Any, tuple[Any, ...], Any]:
    """What a launch on the CPU calls, with what, and what has to be kept for that.

    It is what Warp's own ``launch()`` calls, which packs the arguments anew each time.
    """
    try:
        bounds, *values = command.params
        arguments = _arguments(*map(type, values))()
        for n, value in enumerate(values):
            setattr(arguments, f'argument_{n}', value)
        return command.hooks.forward, (ctypes.byref(bounds), ctypes.byref(arguments)), command
    except (AttributeError, TypeError):
        # a Warp that packs in another way
        return command.launch, (), command


def _call(calls: list[tuple[Any, tuple[Any, ...], Any]]) -> None:
    for function, arguments, _ in calls:
        function(*arguments)
