# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The choice of a stage, and emission, by one block of threads: the first of the motion's.

What one thread does when all rates are known takes a GPU as long as two starts of kernels. The
Green's function's sums need nothing of it: the first block of their threads chooses the stage
while the others sum up, which wait for it before they move, and lets the vents emit while those
move. So does that of the motion alone with few particles, where a stage is little else than such
starts; with many the others would wait, and the block is a launch of its own. A GPU starts blocks
in the order of their numbers, and the first one waits for none.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import warp as wp

from lava_ros.simulation.backend.compiled import announce, FEW_THREADS, quick_kernel
from lava_ros.simulation.emission import emitters, Outlets
from lava_ros.simulation.motion_arguments import arguments_type
from lava_ros.simulation.state import State
from lava_ros.simulation.timestep import choice_of, pace_type
from lava_ros.simulation.vents import VentSet

#: Threads of the block.
DIRECTORS = FEW_THREADS[0]

#: By whether there are few particles, alone or in a batch: threads of a block, and how many blocks
#: a processor of a GPU must hold. What the first one does would take the registers of all; with
#: many particles it keeps some of its numbers in local memory, and nobody waits for that.
BOUNDS = {True: FEW_THREADS, False: (DIRECTORS, 6)}


class StageChoice(NamedTuple):
    """How a motion gets its stage.

    Attributes:
        pace: What the choice of a stage reads and writes (timestep.py).
        outlets: The tables of the vents.
        function: Device function for the first block of its threads; None where other launches
            choose and emit.
        bounds: What ``quick_kernel`` takes; None without the function.
    """

    pace: Any
    outlets: Any
    function: Any = None
    bounds: tuple[int, int] | None = None

    @property
    def threads(self) -> int:
        """Threads before those of the particles."""
        return 0 if self.function is None else DIRECTORS


@lru_cache
def _function(real: Any, choose: Any, emission: Any, emitters: int) -> Any:
    @wp.func
    def choose_and_emit(
        thread: int, pace: pace_type(real), outlets: Outlets, m: arguments_type(real)
    ):
        if thread == 0:
            choose(pace)
        announce(pace.chosen)
        if wp.static(emission is not None):  # noqa: SIM102, the static test decides
            if thread < wp.static(emitters):
                emission(thread, wp.static(emitters), outlets, m)

    return choose_and_emit


@lru_cache
def _kernel(real: Any, function: Any) -> Any:
    @quick_kernel
    def choose_stage(
        thread: int, pace: pace_type(real), outlets: Outlets, m: arguments_type(real)
    ):
        function(thread, pace, outlets, m)

    return choose_stage


def is_within_the_motion(state: State, *, sums_up: bool) -> bool:
    """Whether the motion chooses its stage: ``sums_up`` says whether it sums before it moves.

    With inertia the stage has to be known before the forces that it moves by.
    """
    is_worth_it = state.is_short or (state.device.is_cuda and sums_up)
    return is_worth_it and 'inertia' not in state.effects


def choice_within_motion(state: State, pace: Any, vents: VentSet) -> StageChoice:
    """Let a motion choose its stage; the vents emit then, if it puts particles into cells."""
    emission = vents.emission_on(state) if state.bins_in_motion else None
    # one number for any vents: each would be another kernel
    threads = emitters(state, DIRECTORS)
    function = _function(state.real, choice_of(state), emission, threads)
    has_long_sums = state.is_short or state.lanes < state.parts
    return StageChoice(pace, vents.outlets, function, BOUNDS[has_long_sums])


def choose_before_motion(state: State, choice: StageChoice, way: Any) -> StageChoice:
    """Do before a motion what ``choice`` would do within it, in a launch of one block.

    Returns:
        What the motion takes then.
    """
    threads = DIRECTORS if state.device.is_cuda else 1
    arguments = [choice.pace, choice.outlets, way]
    kernel = _kernel(state.real, choice.function)
    state.launches(kernel, arguments, dim=threads, block_dim=threads)
    return StageChoice(choice.pace, choice.outlets)
