# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ensemble runs, from the first member to the maps, resumable at any time."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
import gc
import pickle
from typing import Any
import warnings

import numpy as np

import lava_ros
from lava_ros import validation
from lava_ros.errors import LavaError, RefusalError, refusing
from lava_ros.files.optional import require
from lava_ros.forecast.assimilation import jaccard, Outline, weigh, Weights
from lava_ros.forecast.member_processes import count_processes, run_in_parts
from lava_ros.forecast.members import batch_of, Plan
from lava_ros.forecast.pool import DEATHS, Pool, process_number
from lava_ros.forecast.probability import (
    EnsembleAccumulator,
    Footprint,
    footprint_by,
)
from lava_ros.forecast.sampling import Member
from lava_ros.forecast.sentinels import is_sentinel, log_called, Sentinels
from lava_ros.forecast.store import Store
from lava_ros.layers.forecast import HazardMaps
from lava_ros.simulation.backend.threads import usable_cores

#: Minimum number of members for maps while other members still run.
FIRST_MAPS = 16

#: Minimum number of members on a GPU for several processes, which take about 3 s to start, and
#: maximum number of those that such a process runs as one part.
_MANY, _PART = 512, 128

#: Maximum wait for a reply from a scheduler [s].
PATIENCE = 30.0

#: Runs members, in any order, and yields the footprint of each.
Runner = Callable[[Plan, Sequence[Member]], Generator[Footprint, None, None]]


@dataclass(frozen=True, eq=False)
class Ensemble:
    """A finished ensemble.

    Attributes:
        maps: Maps of the members with equal weights.
        weights: Weights of the members according to an observed outline, None without one.
        weighted: Maps with these weights, None without an outline.
        resumed: Number of members that were already in the store.
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
    """Run the members that are not yet in the store, and merge all members.

    The maps depend only on the members, not on their order, the runner or interruptions. Sentinels
    run first. If a sentinel needs effects that are off, the store deletes all members, and they
    run again with these effects: at most once for each effect.

    Args:
        members: The first members of the ensemble.
        store: Contains the plan and the finished members.
        runner: Runs members.
        outline: Observed lava, by which the members are weighted in addition.
        on_finished: Called after each member with the number of finished members, and of those
            that were already in the store.
        on_maps: Called with the maps of the first members, in order of number, each time that
            their number has doubled and all sentinels have run. The members that finish first
            would show small eruptions, which are fast to simulate.

    Raises:
        LavaError: If a member fails, none agrees with the outline, or a file cannot be written.
    """
    if outline is not None:
        at_most = store.plan.horizon
        validation.number('observed.time', outline.time, at_most=at_most, unit='s')
    plan = store.plan
    tally = EnsembleAccumulator(plan)
    done: set[int] = set()
    ahead: dict[int, Footprint] = {}

    def take(footprint: Footprint) -> None:
        done.add(footprint.index)
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
    # the numerical error and the best member refer to all members
    error, agreement = tally.spacing_error, np.full(len(members), np.nan)
    for footprint in store.finished(len(members)):
        reached = footprint_by(footprint, plan, outline.time, error)
        agreement[footprint.index] = jaccard(reached, outline)
    weights = weigh(agreement, area_error=0.0 if error is None else error.area_error)
    weighted = EnsembleAccumulator(plan)
    done.clear()
    for footprint in store.finished(len(members)):
        done.add(footprint.index)
        weighted.add(footprint, int(weights.values[footprint.index]))
    _check_complete(done, members)
    return Ensemble(tally.maps(), weights, weighted.maps(), resumed)


def _check_complete(done: set[int], members: Sequence[Member]) -> None:
    missing = [member.index for member in members if member.index not in done]
    if missing:
        problem = f'Members {", ".join(map(str, missing))} have not run'
        raise RefusalError('members', problem, 'Repeat the command to run them')


def run_here(
    plan: Plan, members: Sequence[Member], *, device: str | None = None, sharing: int = 1
) -> Generator[Footprint, None, None]:
    """Run members in this process, and yield their footprints in order of completion.

    ``device`` is the Warp device; None for the first GPU, or the CPU without one. ``sharing`` is
    the number of processes that run members on it.
    """
    for footprint in run_in_parts(plan, members, device=device, sharing=sharing):
        if footprint is not None:
            yield footprint


def run_in_processes(
    plan: Plan, members: Sequence[Member], *, workers: int, device: str | None = None
) -> Generator[Footprint, None, None]:
    """Run members in up to ``workers`` processes of this machine, in any order.

    ``device`` is the Warp device of all; None distributes the processes over the GPUs, if any.

    Raises:
        LavaError: If a member fails or repeatedly ends its process.
    """
    devices = _gpus(device, plan.accuracy.method) or (device,)
    sharing = -(-workers // len(devices))
    # so that each process gets members
    batch = min(batch_of(plan, device, sharing), max(-(-len(members) // workers), 1))
    if sharing > 1:
        # a process sends its members at the end of a part
        batch = min(batch, _PART)
    parts = _parts(members, batch)
    work = partial(_run_in_process, plan, devices, sharing)
    with closing(Pool(work, min(workers, len(parts)))) as pool:
        for _, footprints in pool(parts):
            yield from footprints


def default_workers(plan: Plan, members: int, device: str | None = None) -> int:
    """Return the number of processes for some members of a plan on a device.

    On a CPU it is that of usable cores. On a GPU it is one; many members have several, because
    each process makes its members one by one while the GPU waits.
    """
    gpus = _gpus(device, plan.accuracy.method)
    if not gpus:
        return usable_cores()
    are_many = members >= _MANY * len(gpus)
    return len(gpus) * (count_processes(gpus[0], plan.accuracy.method) if are_many else 1)


def _run_in_process(
    plan: Plan, devices: Sequence[str | None], sharing: int, members: Sequence[Member]
) -> list[Footprint]:
    device = devices[process_number() % len(devices)]
    return list(run_here(plan, members, device=device, sharing=sharing))


def _parts(members: Sequence[Member], batch: int) -> list[Sequence[Member]]:
    return [members[start : start + batch] for start in range(0, len(members), batch)]


def _gpus(device: str | None, method: str) -> tuple[str, ...]:
    """Return the GPUs for members: all unless one is named, none if they run on a CPU."""
    # importing the solver keeps Warp from printing its devices
    from lava_ros.simulation.setup.defaults import device_of

    used = device_of(device, method)
    if not used.is_cuda:
        return ()
    if device is not None:
        return (str(used),)
    import warp as wp

    return tuple(map(str, wp.get_cuda_devices()))


def run_on_cluster(
    plan: Plan, members: Sequence[Member], *, scheduler: str, device: str | None = None
) -> Generator[Footprint, None, None]:
    """Run members on the workers of an existing Dask scheduler, in any order.

    Workers store nothing: a member is sent as a few numbers and returned as its footprint. Members
    of a worker that dies run again on another worker.

    ``scheduler`` is an address such as ``tls://host:8786``, and ``device`` the Warp device of
    every worker; None for its first GPU, or the CPU without one.

    Raises:
        LavaError: If Dask is not installed, the scheduler cannot be reached, or a member fails.
    """
    require('distributed', '--scheduler', scheduler)
    from distributed import as_completed, KilledWorker

    with _client(scheduler) as client:
        # a task, not data, because Dask repeats it if the worker with its result dies
        shared = client.submit(pickle.loads, pickle.dumps(plan), pure=False)
        running = {
            client.submit(_run_on_worker, shared, device, part, pure=False): part[0].index
            for part in _parts(members, batch_of(plan, device))
        }
        for future in as_completed(list(running)):
            member = f'member {running.pop(future)}'
            expected = 'a scheduler whose workers can run lava_ros'
            try:
                with refusing('--scheduler', scheduler, expected, ImportError, OSError):
                    footprints = future.result()
            except KilledWorker as error:
                problem = f'{DEATHS + 1} workers ended while they ran {member}'
                raise RefusalError(member, problem, 'Check their memory') from error
            yield from footprints
            future.release()


def check_cluster(scheduler: str) -> None:
    """Connect to a scheduler, and disconnect.

    Raises:
        LavaError: If it cannot be reached, or its workers lack this version of the package.
    """
    with _client(scheduler):
        pass


@contextmanager
def _client(scheduler: str) -> Iterator[Any]:
    """Connect to a scheduler whose workers have this version of the package."""
    from dask import config
    from distributed import Client

    # a client that failed to connect must not be collected while the next one holds Dask's lock
    gc.collect()
    settings = {'distributed.scheduler.allowed-failures': DEATHS}
    with config.set(settings), warnings.catch_warnings():
        # a terrain is larger than Dask expects for a task
        warnings.filterwarnings('ignore', message='Sending large graph')
        expected = (
            'the address of a Dask scheduler, such as tls://host:8786, with its certificates in '
            'DASK_CONFIG: docs/how_to/cluster.md'
        )
        with refusing('--scheduler', scheduler, expected, OSError, ValueError, TypeError):
            client = Client(scheduler, timeout=PATIENCE)
        with client:
            expected = 'a scheduler with workers that have lava_ros installed'
            # before Python 3.11 a TimeoutError of asyncio is not an OSError
            kinds = (TimeoutError, OSError, ImportError)
            with refusing('--scheduler', scheduler, expected, *kinds):
                client.wait_for_workers(1, timeout=PATIENCE)
                versions = client.run(_version)
            for worker, version in versions.items():
                if version != lava_ros.__version__:
                    expected = f'{lava_ros.__version__}, the version of this process'
                    raise LavaError(f'version of lava_ros on {worker}', version, expected)
            yield client


def _version() -> str:
    return lava_ros.__version__


def _run_on_worker(plan: Plan, device: str | None, members: Sequence[Member]) -> list[Footprint]:
    from lava_ros.simulation.backend.threads import use_threads

    use_threads(1)
    return list(run_here(plan, members, device=device))
