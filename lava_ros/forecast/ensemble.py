# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""An ensemble from its first member to its maps, resumable at any moment."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import jaccard, Outline, weigh, Weights
from lava_ros.forecast.members import batch_of, Plan, running
from lava_ros.forecast.pool import Pool, process_number
from lava_ros.forecast.probability import Footprint, footprint_of, reached_by, Tally
from lava_ros.forecast.sampling import Member
from lava_ros.forecast.store import Store
from lava_ros.maps.forecast import HazardMaps
from lava_ros.simulation.backend.threads import usable_cores

#: Is told how many members there are, and how many of those were there before this run.
Finished = Callable[[int, int], None]

#: Fewest members of which maps are shown while others still run.
FIRST_MAPS = 16

#: Runs members, in any order, and gives what each did.
Runner = Callable[[Plan, Sequence[Member]], Iterable[Footprint]]


@dataclass(frozen=True, eq=False)
class Ensemble:
    """A finished ensemble.

    Attributes:
        maps: What it says about each cell.
        weights: What each member counts; None where all count the same.
        resumed: Members that were there already.
    """

    maps: HazardMaps
    weights: Weights | None
    resumed: int


def run_ensemble(
    plan: Plan,
    members: Sequence[Member],
    store: Store,
    *,
    runner: Runner,
    outline: Outline | None = None,
    on_finished: Finished | None = None,
    on_maps: Callable[[HazardMaps], object] | None = None,
) -> Ensemble:
    """Run the members that the store does not have yet, and merge all of them.

    The maps depend on the members alone, and not on the order in which they finish, on what ran
    them, or on how often that was interrupted.

    Args:
        plan: What the members have in common.
        members: The first members of the ensemble.
        store: Where finished ones are kept.
        runner: What runs them.
        outline: Where lava was seen; members then weigh by how well they agree.
        on_finished: Is told of each member as it finishes.
        on_maps: Gets the maps of the first members, those with the lowest numbers, each time that
            they have doubled, as long as no outline is there to weigh them. Cheap members end
            first: maps of these would be of small eruptions.

    Raises:
        LavaError: A member fails, none agrees with the outline, or a file cannot be written.
    """
    if outline is not None:
        validation.number('observed.time', outline.time, at_most=plan.horizon, unit='s')
    # weights are relative to the best member, so that all have to be there first
    tally = None if outline is not None else Tally(plan)
    agreement = np.full(len(members), np.nan)
    done: set[int] = set()
    ahead: dict[int, Footprint] = {}

    def take(footprint: Footprint) -> None:
        done.add(footprint.index)
        if tally is not None:
            ahead[footprint.index] = footprint
            while tally.count in ahead:
                tally.add(ahead.pop(tally.count))
        if outline is not None:
            reached = reached_by(footprint, plan, outline.time)
            agreement[footprint.index] = jaccard(reached, outline)

    for footprint in store.finished(len(members)):
        take(footprint)
    resumed = len(done)
    missing = [member for member in members if member.index not in done]
    next_maps = FIRST_MAPS if tally is None else max(FIRST_MAPS, 2 * tally.count)
    for footprint in runner(plan, missing) if missing else ():
        store.write(footprint)
        take(footprint)
        if on_finished is not None:
            on_finished(len(done), resumed)
        if tally is not None and next_maps <= tally.count < len(members):
            next_maps = 2 * tally.count
            if on_maps is not None:
                on_maps(tally.maps())
    _check_complete(done, members)
    if tally is not None:
        return Ensemble(tally.maps(), None, resumed)
    weights = weigh(agreement)
    return Ensemble(_weighed(plan, members, store, weights), weights, resumed)


def _weighed(
    plan: Plan, members: Sequence[Member], store: Store, weights: Weights
) -> HazardMaps:
    """The maps of members that do not count alike."""
    tally = Tally(plan)
    done = set()
    for footprint in store.finished(len(members)):
        tally.add(footprint, int(weights.values[footprint.index]))
        done.add(footprint.index)
    _check_complete(done, members)
    return tally.maps()


def _check_complete(done: set[int], members: Sequence[Member]) -> None:
    missing = [member.index for member in members if member.index not in done]
    if missing:
        raise LavaError('members', missing, 'every member; the same command again runs these')


def run_here(
    plan: Plan, members: Sequence[Member], *, device: str | None = None
) -> Iterable[Footprint]:
    """Run members in this process, and give what each did as they finish, in any order.

    ``device`` is the Warp device; None for the first GPU, or the CPU without one.
    """
    for fields in running(plan, members, device=device):
        if fields is not None:
            yield footprint_of(fields, plan)


def run_in_processes(
    plan: Plan,
    members: Sequence[Member],
    *,
    workers: int,
    device: str | None = None,
    batch: int | None = None,
) -> Iterable[Footprint]:
    """Run members in processes of this machine, in any order.

    Args:
        plan: What they have in common.
        members: The members.
        workers: Most processes.
        device: Warp device of all; they share the GPUs out, if there are any, when left out.
        batch: Members that a process is given at once; by the device when left out.

    Raises:
        LavaError: A member fails, or takes processes with it again and again.
    """
    if batch is None:
        # each process has some
        batch = min(batch_of(plan, device), max(-(-len(members) // workers), 1))
    parts = batches(plan, members, device, batch)
    devices = (device,) if device else _gpus() or (None,)
    work = partial(_run_in_process, plan, devices)
    with closing(Pool(work, min(workers, len(parts)))) as pool:
        for _, footprints in pool(parts):
            yield from footprints


def default_workers() -> int:
    """One for each GPU, or else for each core of this machine that we may use."""
    return len(_gpus()) or usable_cores()


def _run_in_process(
    plan: Plan, devices: Sequence[str | None], members: Sequence[Member]
) -> list[Footprint]:
    return list(run_here(plan, members, device=devices[process_number() % len(devices)]))


def batches(
    plan: Plan, members: Sequence[Member], device: str | None, batch: int | None = None
) -> list[Sequence[Member]]:
    """Members in parts that run side by side; by the device when their number is left out."""
    batch = batch_of(plan, device) if batch is None else batch
    return [members[start : start + batch] for start in range(0, len(members), batch)]


def _gpus() -> tuple[str, ...]:
    # importing the solver keeps Warp from printing what it finds
    import warp as wp

    import lava_ros.simulation  # noqa: F401

    return tuple(map(str, wp.get_cuda_devices()))
