# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""An ensemble from its first member to its maps, kept in a folder, resumable at any moment."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import asdict, dataclass
from functools import partial
import hashlib
import json
import logging
from pathlib import Path
import pickle
from typing import Any, NoReturn
import warnings

import numpy as np

import lava_ros
from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files import open_input, write_output, writing
from lava_ros.files.npz import read_arrays
from lava_ros.files.optional import require
from lava_ros.files.yaml import parse_json
from lava_ros.forecast.assimilation import jaccard, Outline, UNIT, weigh, Weights
from lava_ros.forecast.members import batch_of, Plan, running
from lava_ros.forecast.pool import DEATHS, Pool, process_number
from lava_ros.forecast.probability import Footprint, footprint_of, NEVER, reached_by, Tally
from lava_ros.forecast.sampling import Member, Susceptibility
from lava_ros.forecast.sentinels import CalledEffect, is_sentinel, log_called, Sentinels
from lava_ros.maps.forecast import HazardMaps
from lava_ros.maps.places import Places
from lava_ros.scene import MAX_ELEVATION, scene_to_dict
from lava_ros.simulation.backend.threads import usable_cores

_LOG = logging.getLogger(__name__)

#: Fewest members of which maps are shown while others still run.
FIRST_MAPS = 16

#: Time for a scheduler to answer [s].
PATIENCE = 30.0

#: Version of the format of a folder.
VERSION = 3

#: The file in a folder that describes its ensemble, and that with the weights of its members where
#: an outline has weighed them.
MANIFEST, WEIGHTS = 'ensemble.json', 'weights.json'

#: Runs members, in any order, and gives the footprint of each.
Runner = Callable[[Plan, Sequence[Member]], Generator[Footprint, None, None]]


class Store:
    """A folder with the finished members of one ensemble, a file each.

    Attributes:
        plan: What the members have in common, with the effects that sentinels have called for.
    """

    def __init__(
        self,
        folder: str | Path,
        plan: Plan,
        *,
        seed: int = 0,
        susceptibility: Susceptibility | None = None,
    ) -> None:
        """Create the folder of an ensemble, or reopen it.

        Raises:
            LavaError: The folder cannot be written, or holds another ensemble or other files.
        """
        self.plan = plan
        self._folder = folder = Path(folder)
        self._members = folder / 'members'
        self._seed, self._susceptibility = seed, susceptibility
        path = folder / MANIFEST
        try:
            if path.exists():
                known = json.loads(path.read_text(encoding='utf-8'))
                self.plan = plan.switching_on(_switched_on(known))
                _check_same(known, self._manifest(), folder)
            elif folder.exists() and any(folder.iterdir()):
                right = 'a folder that is new, empty, or of this ensemble'
                raise LavaError('--output', str(folder), right)
            self._members.mkdir(parents=True, exist_ok=True)
            self.write_manifest(folder)
        except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
            right = f'a folder to write to ({error})'
            raise LavaError('--output', str(folder), right) from error

    def restart(self, called: Sequence[CalledEffect]) -> None:
        """Drop all members, and take those of a plan with further effects from now on.

        Raises:
            LavaError: The folder cannot be written.
        """
        self.plan = self.plan.switching_on(called)
        try:
            # members first: none may be left beside a description that is not theirs
            for path in self._members.glob('*.npz'):
                path.unlink()
        except OSError as error:
            right = f'a folder to write to ({error})'
            raise LavaError('--output', str(self._folder), right) from error
        self.write_manifest(self._folder)

    def write(self, footprint: Footprint) -> None:
        """Keep a member.

        Raises:
            LavaError: It cannot be written.
        """
        with writing('--output', self._path(footprint.index)) as fresh, fresh.open('wb') as file:
            np.savez_compressed(
                file,
                look=footprint.look,
                millimetres=footprint.millimetres,
                corner=np.array(footprint.corner, dtype=np.int32),
                left=np.array([footprint.left]),
            )

    def keep_weights(self, weights: Weights | None, folder: Path) -> None:
        """Keep what each member counts in a folder of maps; None: all count the same.

        Raises:
            LavaError: It cannot be written.
        """
        path = folder / WEIGHTS
        if weights is None:
            path.unlink(missing_ok=True)
        else:
            write_output('--output', path, json.dumps(weights.values.tolist()) + '\n')

    def finished(self, count: int) -> Iterator[Footprint]:
        """Read those of the first members that are there and undamaged, in order.

        A damaged one is logged; it runs again.
        """
        def log(error: LavaError) -> None:
            _LOG.warning('a member is damaged and runs again: %s', error)

        return stored_members(self._folder, count, self.plan, on_refused=log)

    def _path(self, index: int) -> Path:
        return _member_path(self._folder, index)

    def write_manifest(self, folder: Path) -> None:
        """Write the description of the ensemble, which the readers of its maps need.

        Raises:
            LavaError: If it cannot be written.
        """
        text = json.dumps(self._manifest(), indent=1) + '\n'
        write_output('--output', folder / MANIFEST, text)

    def _manifest(self) -> dict[str, Any]:
        plan, susceptibility = self.plan, self._susceptibility
        elevation = np.ascontiguousarray(plan.scene.terrain.elevation)
        manifest = {
            'version': VERSION,
            'lava_ros': lava_ros.__version__,
            'scene': scene_to_dict(plan.scene),
            'elevation': hashlib.blake2b(elevation.tobytes(), digest_size=16).hexdigest(),
            'plan': {
                'horizon_s': plan.horizon,
                'accuracy': asdict(plan.accuracy),
                'forced': plan.forced,
                'effects': asdict(plan.effects),
                'switched_on': [asdict(item) for item in plan.switched_on],
                'threshold_m': plan.threshold,
                'looks': plan.looks,
                'start_s': None if plan.start is None else plan.start.time,
            },
            'seed': self._seed,
            'susceptibility': None if susceptibility is None else susceptibility.digest,
        }
        # as it will be read back
        return json.loads(json.dumps(manifest))


def maps_at(folder: Path, plan: Plan, places: Places, *, members: int) -> HazardMaps:
    """Make the maps of an ensemble in a folder again, with the arrival of lava at places.

    Args:
        folder: The folder, with the members in it or beside it, and the weights if they have any.
        plan: What its members have in common.
        places: Places on its terrain.
        members: Number of members in its maps.

    Raises:
        LavaError: A member is missing or damaged, or the weights cannot be read.
    """
    weights = [1] * members
    try:
        with open_input(folder / WEIGHTS) as file:
            weights = parse_json(WEIGHTS, file.read().decode())
        if not all(type(weight) is int and 0 <= weight <= UNIT for weight in weights):
            raise ValueError(f'a weight is not a whole number from 0 to {UNIT}')
    except FileNotFoundError:
        pass
    except (OSError, TypeError, ValueError) as error:
        right = f'the weights of the members ({error})'
        raise LavaError('ensemble', str(folder / WEIGHTS), right) from error
    tally = Tally(plan, places)
    where = folder if (folder / 'members').is_dir() else folder.parent

    def refuse(error: LavaError) -> NoReturn:
        raise error

    stored = stored_members(where, members, plan, on_refused=refuse)
    for footprint, weight in zip(stored, weights, strict=False):
        tally.add(footprint, weight)
    if not tally.count == members == len(weights):
        right = f'a folder with {members} members, as many as in its maps'
        raise LavaError('ensemble', f'{folder}: {tally.count} members', right)
    return tally.maps()


def stored_members(
    folder: Path, count: int, plan: Plan, *, on_refused: Callable[[LavaError], object]
) -> Iterator[Footprint]:
    """Read those of the first members in a folder that are there and undamaged, in order.

    ``on_refused`` is called with the error of each damaged one.
    """
    for index in range(count):
        path = _member_path(folder, index)
        if path.exists():
            try:
                footprint = _read_member(path, index, plan)
            except LavaError as error:
                on_refused(error)
            else:
                yield footprint


def _read_member(path: Path, index: int, plan: Plan) -> Footprint:
    """Read a member; LavaError, which names file and array, where it cannot be one of the plan."""
    stored = read_arrays('member', path)

    def array(name: str, dtype: type, shape: tuple[int, ...] | None = None) -> np.ndarray:
        field, values = f'{name} of {path}', stored.get(name)
        right = f'{np.dtype(dtype)} of shape {shape or "[rows, columns]"}'
        if values is None:
            raise LavaError(field, None, right)
        is_shaped = values.ndim == 2 if shape is None else values.shape == shape
        if values.dtype != dtype or not is_shaped:
            raise LavaError(field, f'{values.dtype} of shape {values.shape}', right)
        return values

    def check(name: str, is_good: np.ndarray, right: str) -> None:
        if not is_good.all():
            raise LavaError(f'{name} of {path}', stored[name][~is_good][0].item(), right)

    look = array('look', np.uint16)
    millimetres = array('millimetres', np.uint32, look.shape)
    corner, left = array('corner', np.int32, (2,)), array('left', np.float64, (1,))
    check('look', (look < plan.looks) | (look == NEVER), f'less than {plan.looks}, or {NEVER}')
    most = round(1e3 * MAX_ELEVATION)
    check('millimetres', millimetres <= most, f'a thickness of at most {most} mm')
    check('left', (left >= 0.0) & (left <= 1.0), 'a fraction from 0 to 1')
    cells = plan.scene.terrain.shape
    inside = (corner >= 0) & (corner.astype(np.int64) + look.shape <= cells)
    check('corner', inside, f'a part of {look.shape} cells inside a terrain of {cells} cells')
    return Footprint(index, (int(corner[0]), int(corner[1])), look, millimetres, float(left[0]))


def _member_path(folder: Path, index: int) -> Path:
    return folder / 'members' / f'{index:07d}.npz'


def _switched_on(manifest: Any) -> tuple[CalledEffect, ...]:
    """Read the effects that sentinels have called for; none of a file without such a list."""
    try:
        return tuple(map(CalledEffect.from_dict, manifest['plan']['switched_on']))
    except (KeyError, TypeError, ValueError):
        return ()


def _check_same(old: Any, new: Any, folder: Path, name: str = '') -> None:
    """Refuse a folder whose members are of another ensemble, and name the first difference."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in {**old, **new}:
            inner = f'{name}.{key}' if name else key
            _check_same(old.get(key), new.get(key), folder, inner)
    elif old != new:
        right = f'{old!r}, as the members in {folder} have it, or another folder'
        raise LavaError(name, new, right)


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
