# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Folder of an ensemble: its description, its finished members, and the maps made from them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, fields
import hashlib
import json
import logging
import os
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

import lava_ros
from lava_ros.errors import LavaError, RefusalError, refusing
from lava_ros.files import open_input, write_output, writing
from lava_ros.files.npz import read_arrays
from lava_ros.files.yaml import parse_json
from lava_ros.forecast.assimilation import UNIT, Weights
from lava_ros.forecast.members import Plan
from lava_ros.forecast.probability import EnsembleAccumulator, Footprint, NEVER
from lava_ros.forecast.sampling import Susceptibility
from lava_ros.forecast.sentinels import CalledEffect
from lava_ros.layers.forecast import HazardMaps
from lava_ros.layers.places import Places
from lava_ros.layers.spacing_error import SpacingPair
from lava_ros.runs.provenance import description, program
from lava_ros.runs.store import is_usable, known_record, RecordedFolder
from lava_ros.scene import MAX_ELEVATION, scene_to_dict
from lava_ros.scene.ranges import describe_inputs
from lava_ros.simulation import MODEL
from lava_ros.simulation.output.inundation import TOUCHED

_LOG = logging.getLogger(__name__)

#: File with the weights of the members, if any, and folder of the bag of the maps.
WEIGHTS, BAG = 'weights.json', 'atlas'

#: File with the description of an ensemble of version 0.1.0, in place of ``run.json``.
EARLIER_FILE = 'ensemble.json'

#: Kind of the run in ``run.json``.
ENSEMBLE = 'ensemble'

_USABLE = 'a folder that is new, empty, or of this ensemble'

#: Keys of ``run.json`` that the members of a folder have in common.
_COMMON = ('scene', 'quantities', 'elevation', 'plan', 'seed', 'susceptibility')

#: Folder of the files of the members.
_MEMBERS = 'members'

#: Digests in ``run.json``, with the name of the input for errors.
_DIGESTS = {
    'elevation': 'elevation',
    'plan.covered': 'outline from which the members start',
    'susceptibility': 'map of --susceptibility',
}


class Store(RecordedFolder):
    """A folder with the finished members of one ensemble, one file each.

    Attributes:
        plan: Plan of all members, with the effects that sentinels have switched on.
    """

    def __init__(
        self,
        folder: str | Path,
        plan: Plan,
        *,
        seed: int = 0,
        susceptibility: Susceptibility | None = None,
        parents: str | None = None,
        settings: Mapping[str, Any] = {},
        inputs: Sequence[Mapping[str, Any]] = (),
        identity: str = '',
    ) -> None:
        """Create the folder of an ensemble, or reopen it.

        Args:
            folder: The folder.
            plan: Plan of the members.
            seed: Seed of the random numbers.
            susceptibility: Likelihood that the vent opens in a cell, if any.
            parents: Digest of the members near which these are drawn (``parents_digest``), if any.
            settings: Choices of the user, for ``run.json``.
            inputs: Path, size and digest of each input file, for ``run.json``.
            identity: Identity of the ensemble, by which a command without a folder finds it.

        Raises:
            LavaError: If the folder cannot be written, or contains another ensemble or other
                files.
        """
        folder = Path(folder)
        self._drawn: dict[str, Any] = {
            'seed': seed, 'susceptibility': susceptibility, 'parents': parents,
        }
        self.plan = plan_in(folder, plan, **self._drawn)
        self._members = folder / _MEMBERS
        begun = {
            'kind': ENSEMBLE, **description(plan.scene, identity, settings, inputs),
            **_described(self.plan, **self._drawn), 'maps': BAG,
        }
        if known := _usable_record(folder):
            earlier, now = (item['program'].get('commit') for item in (known, begun))
            if earlier != now:
                _LOG.warning(
                    f'the members in {folder} were computed by commit {earlier} of lava_ros, and '
                    f'further ones by {now}: delete the folder to compute all by one'
                )
            begun |= {name: known.get(name) for name in ('program', 'begun', 'numerical_error')}
        super().__init__(folder, begun)
        with refusing('--output', str(folder), 'a writable folder', OSError):
            self._members.mkdir(exist_ok=True)
        self.put({})

    def restart(self, called: Sequence[CalledEffect]) -> None:
        """Delete all members, and add effects to the plan.

        Raises:
            LavaError: If the folder cannot be written.
        """
        self.plan = self.plan.switching_on(called)
        with refusing('--output', str(self.path), 'a writable folder', OSError):
            # delete members first, because the new description does not apply to them
            for path in self._members.glob('*.npz'):
                path.unlink()
        # the error was measured with other effects
        self.put({
            **_described(self.plan, **self._drawn), 'numerical_error': None, 'program': program(),
        })

    def write(self, footprint: Footprint) -> None:
        """Write a member.

        Raises:
            LavaError: If it cannot be written.
        """
        with writing('--output', self._path(footprint.index)) as fresh, fresh.open('wb') as file:
            np.savez_compressed(
                file,
                look=footprint.first_sample,
                half=footprint.half_sample,
                inundated=footprint.inundated,
                millimetres=footprint.millimetres,
                corner=np.array(footprint.corner, dtype=np.int32),
                left=np.array([footprint.left]),
                pair=np.array(() if footprint.pair is None else footprint.pair.numbers),
            )

    def keep_weights(self, weights: Weights | None, folder: Path) -> None:
        """Write the weights of the members to a folder of maps; None for equal weights.

        Raises:
            LavaError: If they cannot be written.
        """
        path = folder / WEIGHTS
        if weights is None:
            path.unlink(missing_ok=True)
        else:
            write_output('--output', path, json.dumps(weights.values.tolist()) + '\n')

    def finished(self, count: int) -> Iterator[Footprint]:
        """Read those of the first ``count`` members that are finished, in order.

        A damaged member is logged and skipped, so that it runs again.
        """
        def log(error: LavaError) -> None:
            _LOG.warning('a member is damaged and runs again: %s', error)

        return stored_members(self.path, count, self.plan, on_refused=log)

    def _path(self, index: int) -> Path:
        return _member_path(self.path, index)


def plan_in(
    folder: Path, plan: Plan, *, seed: int = 0, susceptibility: Susceptibility | None = None,
    parents: str | None = None,
) -> Plan:
    """Return the plan of the members in a folder, which a ``Store`` can use.

    The arguments are those of ``Store``, and nothing is written. The plan has the effects that
    sentinels have switched on in the folder.

    Raises:
        LavaError: If the folder contains another ensemble or other files.
    """
    known = _usable_record(folder)
    plan = plan.switching_on(_switched_on(known))
    if not known:
        return plan
    described = _described(plan, seed=seed, susceptibility=susceptibility, parents=parents)
    for name, value in (('lava_ros', lava_ros.__version__), ('model', MODEL)):
        _check_same(known['program'].get(name), value, folder, name)
    for name in _COMMON:
        _check_same(known.get(name), described[name], folder, name)
    if known.get('parents') != parents:
        problem = f'The members in {folder} were drawn near other members, or after another '
        problem += 'observation'
        remedy = 'Delete this folder, or choose another --output'
        raise RefusalError('--posterior', problem, remedy)
    return plan


def _usable_record(folder: Path) -> dict[str, Any]:
    """Read the description of an ensemble; empty for a folder without members."""
    known = known_record(folder)
    is_free = not known and is_usable(folder, known, '')
    if not is_free and known.get('kind') != ENSEMBLE:
        raise LavaError('--output', str(folder), _USABLE)
    # a command that was refused before its first member leaves none
    return known if any((folder / _MEMBERS).glob('*.npz')) else {}


def _described(
    plan: Plan, *, seed: int, susceptibility: Susceptibility | None, parents: str | None
) -> dict[str, Any]:
    """Return the description of members, without which nothing can be read or added."""
    covered = {} if plan.covered is None else {'covered': _digest(plan.covered)}
    plain = {
        'scene': scene_to_dict(plan.scene),
        'quantities': describe_inputs(plan.scene),
        'elevation': _digest(plan.scene.terrain.elevation),
        'plan': {
            'horizon_s': plan.horizon,
            'accuracy': asdict(plan.accuracy),
            'forced': plan.forced,
            'effects': asdict(plan.effects),
            'switched_on': [asdict(item) for item in plan.switched_on],
            'inundation_threshold_m': plan.threshold,
            'looks': plan.samples,
            'start_s': None if plan.start is None else plan.start.time,
            **covered,
        },
        'seed': seed,
        'susceptibility': None if susceptibility is None else susceptibility.digest,
        'parents': parents,
    }
    # converted to the types with which it will be read
    return dict(json.loads(json.dumps(plain)))


def _digest(grid: np.ndarray) -> str:
    return hashlib.blake2b(np.ascontiguousarray(grid).tobytes(), digest_size=16).hexdigest()


def is_ensemble(path: str | Path) -> bool:
    """Return True if a path is the folder of an ensemble.

    Raises:
        LavaError: If its description cannot be read.
    """
    path = Path(path)
    is_earlier = os.path.isfile(path / EARLIER_FILE)
    return known_record(path).get('kind', ENSEMBLE * is_earlier) == ENSEMBLE


def ensemble_record(folder: Path) -> dict[str, Any]:
    """Read the description of an ensemble, also one of version 0.1.0.

    Raises:
        LavaError: If it cannot be read.
    """
    if known := known_record(folder):
        return known
    expected = 'an ensemble whose description is undamaged'
    with refusing('ensemble', str(folder), expected, OSError, KeyError, TypeError, ValueError):
        with open_input(folder / EARLIER_FILE) as file:
            known = parse_json(EARLIER_FILE, file.read())
        program = {'lava_ros': known.pop('lava_ros', lava_ros.__version__)}
        inputs = {'quantities': known.pop('inputs')} if 'inputs' in known else {}
        return {**known, **inputs, 'program': program}


def stored_spacing(folder: Path) -> float | None:
    """Return the particle spacing of the members in a folder [m]; None for a new folder.

    Raises:
        LavaError: If the description cannot be read, or an ensemble cannot use the folder.
    """
    known = _usable_record(folder)
    if not known:
        return None
    expected = 'the folder of an ensemble'
    with refusing('--output', str(folder), expected, KeyError, TypeError, ValueError):
        return float(known['plan']['accuracy']['spacing'])


def maps_at(folder: Path, plan: Plan, places: Places, *, members: int) -> HazardMaps:
    """Recompute the maps of an ensemble in a folder, with the arrival of lava at places.

    Args:
        folder: Folder of the maps, with the weights, if any. The members are in it or in its
            parent.
        plan: Plan of the members.
        places: Places on its terrain.
        members: Number of members in its maps.

    Raises:
        LavaError: If a member is missing or damaged, or the weights cannot be read.
    """
    weights = [1] * members
    file = folder / WEIGHTS
    with (
        refusing('ensemble', str(file), 'the weights of the members'),
        suppress(FileNotFoundError),
        open_input(file) as opened,
    ):
        weights = json.loads(opened.read())
        if not all(type(weight) is int and 0 <= weight <= UNIT for weight in weights):
            raise ValueError(f'a weight is not a whole number from 0 to {UNIT}')
    tally = EnsembleAccumulator(plan, places)
    where = folder if (folder / _MEMBERS).is_dir() else folder.parent

    def refuse(error: LavaError) -> NoReturn:
        raise error

    stored = stored_members(where, members, plan, on_refused=refuse)
    for footprint, weight in zip(stored, weights, strict=False):
        tally.add(footprint, weight)
    if not tally.count == members == len(weights):
        problem = f'The maps in {folder} are of {members} members, but it has {tally.count} and '
        problem += f'{len(weights)} weights'
        raise RefusalError('ensemble', problem, 'Run the ensemble again')
    return tally.maps()


def stored_members(
    folder: Path, count: int, plan: Plan, *, on_refused: Callable[[LavaError], object]
) -> Iterator[Footprint]:
    """Read those of the first ``count`` members in a folder that are finished, in order.

    ``on_refused`` is called with the error of each damaged member.
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
    """Read a member; raise LavaError, with file and array, if it does not fit the plan."""
    stored = read_arrays('member', path)

    def array(name: str, dtype: type, shape: tuple[int, ...] | None = None) -> np.ndarray:
        field, values = f'{name} of {path}', stored.get(name)
        expected = f'{np.dtype(dtype)} of shape {shape or "[rows, columns]"}'
        if values is None:
            raise LavaError(field, None, expected)
        is_shaped = values.ndim == 2 if shape is None else values.shape == shape
        if values.dtype != dtype or not is_shaped:
            raise LavaError(field, f'{values.dtype} of shape {values.shape}', expected)
        return values

    def check(name: str, is_valid: np.ndarray, expected: str) -> None:
        if not is_valid.all():
            raise LavaError(f'{name} of {path}', stored[name][~is_valid][0].item(), expected)

    look = array('look', np.uint16)
    half = array('half', np.uint16, look.shape)
    inundated = array('inundated', np.uint8, look.shape)
    millimetres = array('millimetres', np.uint32, look.shape)
    corner, left = array('corner', np.int32, (2,)), array('left', np.float64, (1,))
    has_pair = stored.get('pair') is None or stored['pair'].size > 0
    pair = array('pair', np.float64, (len(fields(SpacingPair)),) if has_pair else (0,))
    check('pair', np.isfinite(pair), 'a finite number')
    for name, samples in (('look', look), ('half', half)):
        is_valid = (samples < plan.samples) | (samples == NEVER)
        check(name, is_valid, f'less than {plan.samples}, or {NEVER}')
    parts = round(1.0 / TOUCHED)
    check('inundated', inundated <= parts, f'a part of a cell, at most {parts}')
    maximum = round(1e3 * MAX_ELEVATION)
    check('millimetres', millimetres <= maximum, f'a thickness of at most {maximum} mm')
    check('left', (left >= 0.0) & (left <= 1.0), 'a fraction from 0 to 1')
    cells = plan.scene.terrain.shape
    inside = (corner >= 0) & (corner.astype(np.int64) + look.shape <= cells)
    check('corner', inside, f'a part of {look.shape} cells inside a terrain of {cells} cells')
    place = int(corner[0]), int(corner[1])
    return Footprint(
        index, place, look, half, inundated, millimetres, float(left[0]),
        pair=SpacingPair(*pair.tolist()) if has_pair else None,
    )


def _member_path(folder: Path, index: int) -> Path:
    return folder / _MEMBERS / f'{index:07d}.npz'


def _switched_on(manifest: Any) -> tuple[CalledEffect, ...]:
    try:
        return tuple(map(CalledEffect.from_dict, manifest['plan']['switched_on']))
    except (KeyError, TypeError, ValueError):
        return ()


def _check_same(old: Any, new: Any, folder: Path, name: str = '') -> None:
    """Raise LavaError, with the first difference, if a folder belongs to another ensemble."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in {**old, **new}:
            inner = f'{name}.{key}' if name else key
            _check_same(old.get(key), new.get(key), folder, inner)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, pair in enumerate(zip(old, new, strict=True)):
            _check_same(*pair, folder, f'{name}[{index}]')
    elif (isinstance(old or new, list | dict) or name in _DIGESTS) and old != new:
        words = _DIGESTS.get(name, name)
        expected = f'the folder of an ensemble with the same {words}, or another folder'
        raise LavaError('--output', str(folder), expected)
    elif old != new:
        expected = f'{old!r}, the value of the members in {folder}, or another folder'
        raise LavaError(name, new, expected)
