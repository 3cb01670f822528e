# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A run of an ensemble from its first member to its maps, resumable at any moment."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
import pickle
from typing import Any
import warnings

import numpy as np

import lava_ros
from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files.optional import require
from lava_ros.forecast.assimilation import jaccard, Outline, weigh, Weights
from lava_ros.forecast.members import batch_of, Plan, running
from lava_ros.forecast.pool import DEATHS, Pool, process_number
from lava_ros.forecast.probability import Footprint, footprint_of, reached_by, Tally
from lava_ros.forecast.sampling import Member
from lava_ros.forecast.sentinels import is_sentinel, log_called, Sentinels
from lava_ros.forecast.store import Store
from lava_ros.maps.forecast import HazardMaps
from lava_ros.simulation.backend.threads import usable_cores

#: Fewest members of which maps are shown while others still run.
FIRST_MAPS = 16

#: Time for a scheduler to answer [s].
PATIENCE = 30.0

#: Runs members, in any order, and gives the footprint of each.
Runner = Callable[[Plan, Sequence[Member]], Generator[Footprint, None, None]]


@dataclass(frozen=True, eq=False)
class Ensemble:
    """A finished ensemble.

    Attributes:
        maps: The maps of its members, which all count the same.
        weights: Weights of the members by an observed outline; None without one.
        weighted: The maps with these weights; None without an outline.
        resumed: Number of members that were in the store before.
    """

    maps: HazardMaps
    weights: Weights | None
    weighted: HazardMaps | None
    resumed: int


def run_ensemble(
    members: Sequence[Member],
    store: Store,
    *,
    runner: Runner,
    outline: Outline | None = None,
    on_finished: Callable[[int, int], None] | None = None,
    on_maps: Callable[[HazardMaps], object] | None = None,
) -> Ensemble:
    """Run the members that the store does not have yet, and merge all of them.

    The maps depend on the members alone, and not on the order in which they finish, on what ran
    them, or on how often that was interrupted. If a sentinel calls for effects that are off, the
    store drops all members, and they run again with these effects: at most as often as there are
    effects. Sentinels run first.

    Args:
        members: The first members of the ensemble.
        store: Where finished ones and the plan are kept.
        runner: What runs them.
        outline: Where lava was seen; the members are then also weighted by how well they agree.
        on_finished: Called after each member with the number of finished members, and of those
            that the store had before.
        on_maps: Called with the maps of the first members, in order of number, each time that
            their number has doubled; never before all sentinels have run.
            Cheap members finish first: maps of those would be of small eruptions.

    Raises:
        LavaError: A member fails, none agrees with the outline, or a file cannot be written.
    """
    if outline is not None:
        at_most = store.plan.horizon
        validation.number('observed.time', outline.time, at_most=at_most, unit='s')
    plan = store.plan
    tally = Tally(plan)
    agreement = np.full(len(members), np.nan)
    done: set[int] = set()
    ahead: dict[int, Footprint] = {}

    def take(footprint: Footprint) -> None:
        done.add(footprint.index)
        if outline is not None:
            reached = reached_by(footprint, plan, outline.time)
            agreement[footprint.index] = jaccard(reached, outline)
        ahead[footprint.index] = footprint
        while tally.count in ahead:
            tally.add(ahead.pop(tally.count))

    for footprint in store.finished(len(members)):
        take(footprint)
    resumed, next_maps = len(done), max(FIRST_MAPS, 2 * tally.count)
    missing = [member for member in members if member.index not in done]
    missing.sort(key=lambda member: not is_sentinel(member.index))
    sentinels = Sentinels(member.index for member in missing)
    with closing(runner(plan, missing)) if missing else nullcontext(()) as footprints:
        for footprint in footprints:
            sentinels.note(footprint.index, footprint.called)
            if sentinels.called:
                break
            if footprint.called:
                continue
            store.write(footprint)
            take(footprint)
            if on_finished is not None:
                on_finished(len(done), resumed)
            is_due = sentinels.are_done and next_maps <= tally.count < len(members)
            if on_maps is not None and is_due:
                next_maps = 2 * tally.count
                on_maps(tally.maps())
    if sentinels.called:
        log_called(sentinels.called)
        store.restart(sentinels.called)
        return run_ensemble(
            members, store, runner=runner, outline=outline, on_finished=on_finished,
            on_maps=on_maps,
        )
    _check_complete(done, members)
    if outline is None:
        return Ensemble(tally.maps(), None, None, resumed)
    # weights are relative to the best member, so that all have to be there first
    weights, weighted = weigh(agreement), Tally(plan)
    done.clear()
    for footprint in store.finished(len(members)):
        done.add(footprint.index)
        weighted.add(footprint, int(weights.values[footprint.index]))
    _check_complete(done, members)
    return Ensemble(tally.maps(), weights, weighted.maps(), resumed)


def _check_complete(done: set[int], members: Sequence[Member]) -> None:
    missing = [member.index for member in members if member.index not in done]
    if missing:
        raise LavaError('missing members', missing, 'none; the same command runs them')


def run_here(
    plan: Plan, members: Sequence[Member], *, device: str | None = None
) -> Generator[Footprint, None, None]:
    """Run members in this process, and give their footprints as they finish, in any order.

    ``device`` is the Warp device; None for the first GPU, or the CPU without one.
    """
    for fields in running(plan, members, device=device):
        if fields is not None:
            yield footprint_of(fields, plan)


def run_in_processes(
    plan: Plan, members: Sequence[Member], *, workers: int, device: str | None = None
) -> Generator[Footprint, None, None]:
    """Run members in up to ``workers`` processes of this machine, in any order.

    ``device`` is the Warp device of all; with None they share the GPUs out, if there are any.

    Raises:
        LavaError: A member fails, or takes processes with it again and again.
    """
    # each process has some
    batch = min(batch_of(plan, device), max(-(-len(members) // workers), 1))
    parts = _parts(members, batch)
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


def _parts(members: Sequence[Member], batch: int) -> list[Sequence[Member]]:
    return [members[start : start + batch] for start in range(0, len(members), batch)]


def _gpus() -> tuple[str, ...]:
    # importing the solver keeps Warp from printing what it finds
    import warp as wp

    import lava_ros.simulation  # noqa: F401

    return tuple(map(str, wp.get_cuda_devices()))


def run_on_cluster(
    plan: Plan, members: Sequence[Member], *, scheduler: str, device: str | None = None
) -> Generator[Footprint, None, None]:
    """Run members on the workers of a Dask scheduler that somebody else has started, in any order.

    Workers keep nothing: a member goes to one as a few numbers and comes back as its footprint.
    Another worker runs the members of one that dies again.

    ``scheduler`` is an address such as ``tcp://host:8786``, and ``device`` the Warp device of
    every worker; with None a worker uses its first GPU, or the CPU without one.

    Raises:
        LavaError: Dask is not installed, the scheduler is out of reach, or a member fails.
    """
    require('distributed', '--scheduler', scheduler)
    from distributed import as_completed, KilledWorker

    with _client(scheduler) as client:
        # a task and no data: where the worker that holds it dies, it is made again
        shared = client.submit(pickle.loads, pickle.dumps(plan), pure=False)
        running = {
            client.submit(_run_on_worker, shared, device, part, pure=False): part[0].index
            for part in _parts(members, batch_of(plan, device))
        }
        for future in as_completed(list(running)):
            index = running.pop(future)
            try:
                yield from future.result()
            except KilledWorker as error:
                right = f'one that does not end its worker; {DEATHS + 1} died (too little memory?)'
                raise LavaError(f'member {index}', str(error), right) from error
            except (ImportError, OSError) as error:
                right = f'workers that can run lava_ros ({error})'
                raise LavaError('--scheduler', scheduler, right) from error
            future.release()


@contextmanager
def _client(scheduler: str) -> Iterator[Any]:
    """A client of a scheduler that has workers with this version of the package."""
    from dask import config
    from distributed import Client

    settings = {'distributed.scheduler.allowed-failures': DEATHS}
    with config.set(settings), warnings.catch_warnings():
        # a terrain is large for a task
        warnings.filterwarnings('ignore', message='Sending large graph')
        try:
            client = Client(scheduler, timeout=PATIENCE)
        except (OSError, ValueError, TypeError) as error:
            right = f'the address of a Dask scheduler, such as tcp://host:8786 ({error})'
            raise LavaError('--scheduler', scheduler, right) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=PATIENCE)
                versions = client.run(_version)
            except (TimeoutError, OSError) as error:
                raise LavaError('--scheduler', scheduler, 'a scheduler with workers') from error
            except ImportError as error:
                right = 'workers with lava_ros installed'
                raise LavaError('--scheduler', scheduler, right) from error
            for worker, version in versions.items():
                if version != lava_ros.__version__:
                    right = f'lava_ros {lava_ros.__version__}, as here'
                    raise LavaError(f'lava_ros of worker {worker}', version, right)
            yield client


def _version() -> str:
    return lava_ros.__version__


def _run_on_worker(plan: Plan, device: str | None, members: Sequence[Member]) -> list[Footprint]:
    from lava_ros.simulation.backend.threads import use_threads

    use_threads(1)
    return list(run_here(plan, members, device=device))
