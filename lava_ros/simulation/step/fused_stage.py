# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Choice of a stage, and emission, by the first block of threads of the motion.

Work of a single thread, once all rates are known, would cost a GPU two kernel starts. The sums of
the Green's function do not depend on it: the first block of their threads chooses the stage while
the other blocks sum; these wait for it before they move their particles, and the first block emits
particles while they do. With few particles, where kernel starts dominate a stage, the plain motion
does the same; with many particles the other blocks would wait too long, so the block is a separate
launch. A GPU starts blocks in the order of their numbers, and the first one waits for none.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation.backend.compiled import announce, FEW_THREADS, quick_kernel
from lava_ros.simulation.particles.layout import arguments_type
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.step.outlets import Outlets
from lava_ros.simulation.step.timestep import (
    choice_function,
    FIRST_BLOCK,
    StageChoice,
    StepLimits,
)

#: Threads per block and minimum number of blocks per GPU processor, by whether there are few
#: particles, alone or in a batch. The first block's work needs more registers than the rest and
#: keeps some values in local memory, which delays nothing else. With few particles these are 8 to
#: 24 bytes, stored once in a stage and read once for each vent that emits; no other block has any.
BOUNDS = {True: FEW_THREADS, False: (FIRST_BLOCK, 6)}


@lru_cache
def _function(real: Any, choose: Any, emission: Any, emitters: int) -> Any:
    @wp.func
    def choose_and_emit(
        thread: int, limits: StepLimits, outlets: Outlets, m: arguments_type(real)
    ):
        if thread == 0:
            choose(limits, m)
        announce(m.chosen)
        if wp.static(emission is not None):  # noqa: SIM102, the static test decides
            if thread < wp.static(emitters):
                emission(thread, wp.static(emitters), outlets, m)

    return choose_and_emit


@lru_cache
def _kernel(real: Any, function: Any) -> Any:
    @quick_kernel()
    def choose_stage(thread: int, limits: StepLimits, outlets: Outlets, m: arguments_type(real)):
        function(thread, limits, outlets, m)

    return choose_stage


def is_within_the_motion(state: State, *, sums_up: bool) -> bool:
    """Return True if the motion chooses its stage; ``sums_up``: it sums before it moves.

    With momentum the stage must be known before the forces of the motion are computed.
    """
    is_worth_it = state.is_short or (state.device.is_cuda and sums_up)
    return is_worth_it and not state.form.has_velocity


def stage_choice(
    state: State, limits: Any, outlets: Any, emission: Any, arguments: Any, *, sums_up: bool
) -> StageChoice:
    """Return the choice of a stage by its motion, or after a launch of one block has made it.

    Either also emits by an ``emission_function``, unless it is None.
    """
    choose = choice_function(state.form, state.effects.any('freezes'))
    # one number for any vents: each different one would be another kernel
    threads = state.emitting_threads(FIRST_BLOCK)
    function = _function(state.real, choose, emission, threads)
    if is_within_the_motion(state, sums_up=sums_up):
        has_long_sums = state.is_short or state.lanes < state.parts
        return StageChoice(limits, outlets, function, BOUNDS[has_long_sums])
    block = FIRST_BLOCK if state.device.is_cuda else 1
    kernel = _kernel(state.real, function)
    state.launches(kernel, [limits, outlets, arguments], dim=block, block_dim=block)
    return StageChoice(limits, outlets)
